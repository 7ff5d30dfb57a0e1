"""Robots among poles: pings without a simulator."""

from dataclasses import replace
from typing import Any

import numpy as np

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.cone import EchoCone, encode_limits

TRANSDUCER = Transducer(Pulse(PulseShape.TONE_BURST, 50e3, 4e-4), BeamPattern.linear(), 0.1, 5.0)
Ping = tuple[str, EchoCone]


def cone(pose: Pose, ranges_m: Any = (), stamp_ns: int = 1, **others: Any) -> EchoCone:
    """A ping with echoes as loud as at 1 m."""
    ranges = np.sort(np.asarray(ranges_m, dtype=np.float32))
    few = np.full(len(ranges), 0.003, np.float32)
    made = EchoCone(
        stamp_ns=stamp_ns,
        frame_id="map",
        child_frame_id="robot1/sonar",
        pose=pose,
        transducer=TRANSDUCER,
        attenuation_db_m=0.0,
        ranges_m=ranges,
        range_stds_m=few,
        amplitudes=(1.0 / np.maximum(ranges, 0.1) ** 2).astype(np.float32),
        amplitude_stds=few,
        limit_step_m=0.05,
        detection_limits=encode_limits(np.full(98, 0.01)),
        residual=0.0,
    )
    return replace(made, **others)


def circle(count: int) -> np.ndarray:
    """True poses on a way that goes round, (count, 3)."""
    angle = np.linspace(0.0, 5.0 * np.pi, count)
    return np.column_stack([3.0 + 1.5 * np.cos(angle), 3.0 + 1.5 * np.sin(angle), angle + 0.5])


def poles() -> np.ndarray:
    """Where poles stand, (n, 2)."""
    return np.random.default_rng(5).uniform(0.2, 5.8, (30, 2))


def heard(pose: Pose, places_m: np.ndarray) -> np.ndarray:
    """Ranges of the poles in the beam."""
    ranges_m, bearings_rad = pose.polar(places_m)
    is_heard = (np.abs(bearings_rad) < 0.7) & (ranges_m > 0.2) & (ranges_m < 4.5)
    return ranges_m[is_heard]
