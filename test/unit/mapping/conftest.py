"""Cones as reconstruction would hand them over, made by hand."""

from collections.abc import Callable

import numpy as np
import pytest
from two_objects import OBJECTS, VIEWS

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.cone import EchoCone, encode_limits
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.simulation import Scenario, simulate

LIMIT_STEP_M = 0.03125

MakeCone = Callable[..., EchoCone]


@pytest.fixture(scope="session")
def make_cone() -> MakeCone:
    """Give a function that makes a cone from ranges, or from pairs of range and amplitude."""

    def make(
        *echoes: float | tuple[float, float],
        x_m: float = 0.0,
        y_m: float = 0.0,
        yaw_rad: float = 0.0,
        planar_covariance: np.ndarray | None = None,
        beam: BeamPattern | None = None,
        min_range_m: float = 0.1,
        max_range_m: float = 3.0,
        amplitude_std: float = 0.005,
        limit: float = 0.01,
        attenuation_db_m: float = 0.0,
        frame_id: str = "map",
        stamp_ns: int = 7,
    ) -> EchoCone:
        pairs = np.array(
            [echo if isinstance(echo, tuple) else (echo, 1.0) for echo in echoes], dtype=np.float32
        ).reshape(-1, 2)
        bins = int(np.ceil((max_range_m - min_range_m) / LIMIT_STEP_M))
        return EchoCone(
            stamp_ns=stamp_ns,
            frame_id=frame_id,
            child_frame_id="sonar",
            pose=Pose.planar(x_m, y_m, yaw_rad, planar_covariance=planar_covariance),
            transducer=Transducer(
                Pulse(PulseShape.HANN_BURST, 50e3, 3e-4),
                beam or BeamPattern.linear(),
                min_range_m,
                max_range_m,
            ),
            attenuation_db_m=attenuation_db_m,
            ranges_m=pairs[:, 0],
            range_stds_m=np.full(len(pairs), 1e-3, dtype=np.float32),
            amplitudes=pairs[:, 1],
            amplitude_stds=np.full(len(pairs), amplitude_std, dtype=np.float32),
            limit_step_m=LIMIT_STEP_M,
            detection_limits=encode_limits(np.full(bins, limit)),
            residual=0.0,
        )

    return make


@pytest.fixture(scope="session")
def cone_of_objects(make_cone: MakeCone) -> MakeCone:
    """Give a function that makes the cone in which objects (x, y, reflectivity) are heard.

    The arguments are those of `make_cone`; nothing hides anything.
    """

    def make(*objects: tuple[float, float, float], **others: float) -> EchoCone:
        beam = BeamPattern.linear()
        echoes = []
        for x_m, y_m, reflectivity in objects:
            east_m, north_m = x_m - others.get("x_m", 0.0), y_m - others.get("y_m", 0.0)
            bearing_rad = np.arctan2(north_m, east_m) - others.get("yaw_rad", 0.0)
            range_m = float(np.hypot(east_m, north_m))
            gain = float(beam.gain((bearing_rad + np.pi) % (2.0 * np.pi) - np.pi))
            if gain > 0.0 and range_m < others.get("max_range_m", 3.0):
                echoes.append((range_m, reflectivity * gain / range_m**2))
        return make_cone(*sorted(echoes), **others)

    return make


@pytest.fixture(scope="session")
def views(cone_of_objects: MakeCone) -> list[EchoCone]:
    """Give what is heard of two objects."""
    return [cone_of_objects(*OBJECTS, stamp_ns=number, **view) for number, view in enumerate(VIEWS)]


@pytest.fixture(scope="session")
def cone(request: pytest.FixtureRequest) -> EchoCone:
    """Give any cone."""
    scenario = Scenario.load(request.config.rootpath / "config/scenarios/poles.yaml")
    return Pipeline().reconstruct(next(simulate(scenario))[1])
