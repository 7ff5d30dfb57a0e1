"""Messages that no sensor in air can have sent are refused before they cost memory or a map."""

from dataclasses import replace

import numpy as np
import pytest

from usmap_ros import bounds
from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.propagation import Channel
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.errors import MalformedMessageError
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.runs.pipeline import Pipeline

TRANSDUCER = Transducer(Pulse(PulseShape.HANN_BURST, 40e3, 4e-4), BeamPattern.linear(), 0.2, 6.0)
TRACE = EchoTrace.from_signal(
    np.zeros(1000, complex),
    25e3,
    pose=Pose.planar(0.0, 0.0, 0.0),
    transducer=TRANSDUCER,
    channel=Channel(343.0),
)
NONE = np.zeros(0, np.float32)
CONE = EchoCone(
    0, "map", "sonar", Pose.planar(0.0, 0.0, 0.0), TRANSDUCER, 1.0, NONE, NONE, NONE, NONE,
    0.1, np.zeros(60, np.uint8), 0.0,
)  # fmt: skip


def high(z_m: float) -> Pose:
    return Pose(np.array([0.0, 0.0, z_m]), np.array([0.0, 0.0, 0.0, 1.0]))


def spread(variance: float, correlation: float = 0.0) -> Pose:
    both = np.array([[variance, correlation, 0], [correlation, variance, 0], [0, 0, 0.0]])
    return Pose.planar(0.0, 0.0, 0.0, planar_covariance=both)


def echoes(count: int, amplitude: float = 1.0) -> dict[str, np.ndarray]:
    ones = np.ones(count, np.float32)
    loud = ones * np.float32(amplitude)
    return {"ranges_m": ones, "range_stds_m": ones, "amplitudes": loud, "amplitude_stds": ones}


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"pose": high(1e30)}, "pose.position"),
        ({"pose": high(1e5)}, "pose.position.z"),
        ({"pose": Pose(np.zeros(3), np.array([0.0, 0.0, 1e300, 1.0]))}, "pose.orientation"),
        ({"pose": spread(1e15)}, "pose.covariance"),
        ({"pose": spread(1.0, 2.0)}, "pose.covariance"),
        ({"transducer": replace(TRANSDUCER, max_range_m=1e3)}, "transducer.max_range"),
        (
            {"transducer": replace(TRANSDUCER, pulse=Pulse(PulseShape.TONE_BURST, 40e3, 1.0))},
            "transducer.pulse_duration",
        ),
        (
            {"transducer": replace(TRANSDUCER, beam=BeamPattern.linear(1.0))}
            | {"frame_id": "x" * 300},
            "header.frame_id",
        ),
    ],
)
def test_no_message_says_what_cannot_be(change: dict[str, object], field: str) -> None:
    for message in (TRACE, CONE):
        with pytest.raises(MalformedMessageError) as raised:
            replace(message, **change).validate()
        assert raised.value.field == field
        assert len(str(raised.value)) < 200


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"start_delay_s": 1e15}, "start_delay"),
        ({"channel": Channel(343.0, attenuation_db_m=1e100)}, "attenuation"),
        ({"channel": Channel(343.0, attenuation_db_m=100.0)}, "attenuation"),
        ({"channel": Channel(343.0, floor_height_m=1e6)}, "floor_height"),
        ({"noise_std": 1e30}, "noise_std"),
        ({"samples": np.full(1000, 1e30, np.float32)}, "samples"),
        ({"samples": np.zeros(bounds.MAX_SAMPLES + 2, np.float32)}, "samples"),
    ],
)
def test_no_trace_says_what_cannot_be(change: dict[str, object], field: str) -> None:
    TRACE.validate()
    with pytest.raises(MalformedMessageError) as raised:
        replace(TRACE, **change).validate()
    assert raised.value.field == field


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"limit_step_m": 1e-12}, "limit_step"),
        ({"attenuation_db_m": 1e100}, "attenuation"),
        ({"residual": float("nan")}, "residual"),
        ({"object_rise_m": 1e9}, "object_rise"),
        ({"detection_limits": np.zeros(10**6, np.uint8)}, "detection_limits"),
        (echoes(3000), "ranges"),
        (echoes(3, amplitude=1e30), "amplitudes"),
    ],
)
def test_no_cone_says_what_cannot_be(change: dict[str, object], field: str) -> None:
    CONE.validate()
    with pytest.raises(MalformedMessageError) as raised:
        replace(CONE, **change).validate()
    assert raised.value.field == field


def test_no_ping_covers_more_cells_than_memory_is_for() -> None:
    far = replace(CONE, transducer=replace(TRANSDUCER, max_range_m=190.0))
    far.validate()
    pipeline = Pipeline()
    with pytest.raises(MalformedMessageError, match=r"reaches 5\.8e\+07 cells of 0\.05 m"):
        pipeline.fuse(far)
    pipeline.fuse(CONE)
