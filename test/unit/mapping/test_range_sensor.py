import numpy as np
import pytest

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.cone import EchoCone
from usmap_ros.geometry import Pose
from usmap_ros.mapping.range_sensor import RangeSensorFusion, occupied_probability
from usmap_ros.parameters import MappingParameters


def cone(*ranges_m: float, y_m: float = 0.0) -> EchoCone:
    ranges = np.array(ranges_m, dtype=np.float32)
    return EchoCone(
        stamp_ns=7,
        frame_id="map",
        child_frame_id="sonar",
        pose=Pose.planar(0.0, y_m, 0.0),
        transducer=Transducer(
            Pulse(PulseShape.HANN_BURST, 50e3, 3e-4),
            BeamPattern(np.array([0.0, 0.7]), np.array([1.0, 0.0])), 0.1, 3.0,
        ),
        attenuation_db_m=0.0,
        ranges_m=ranges,
        range_stds_m=np.full_like(ranges, 1e-3),
        amplitudes=np.ones_like(ranges),
        amplitude_stds=np.full_like(ranges, 1e-2),
        limit_step_m=0.03125,
        detection_limits=np.zeros(93, dtype=np.uint8),
        residual=0.0,
    )  # fmt: skip


def test_a_reading_frees_what_is_before_it_and_fills_what_is_at_it() -> None:
    before, at, behind, beside = occupied_probability(
        np.array([0.5, 1.0, 1.2, 1.0]), np.array([0.0, 0.0, 0.0, 1.0]), 1.0, 0.05
    )
    assert before < 0.1
    assert at > 0.75
    assert behind == beside == 0.5


def test_silence_frees_the_whole_beam() -> None:
    probability = occupied_probability(np.array([0.5, 1.0]), np.zeros(2), np.inf, 0.05)
    assert (probability < 0.5).all()


@pytest.mark.parametrize("others", [(), (1.5, 2.0)])
def test_only_the_first_echo_counts(others: tuple[float, ...]) -> None:
    fusion = RangeSensorFusion(MappingParameters())
    fusion.fuse(cone(0.825, *others))
    occupancy = fusion.occupancy_map()
    x, _ = occupancy.geometry.cell_centers_m(
        *np.nonzero(occupancy.observed & (occupancy.probability() > 0.65))
    ).T
    assert x.max() < 0.9
    assert (occupancy.frame_id, occupancy.stamp_ns) == ("map", 7)
