"""Pings of places that are known, made by hand."""

import math
from collections.abc import Callable

import pytest

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.pings.cone import EchoCone

#: A mirror faces robots that look north: its distance, and amplitude reflectivity.
MIRROR_M, MIRROR = 1.5, 0.9


@pytest.fixture(scope="session")
def mirror_m() -> float:
    """Give how far north of the origin the mirror stands."""
    return MIRROR_M


@pytest.fixture(scope="session")
def mirror_pings_at(make_cone: Callable[..., EchoCone]) -> Callable[..., list[EchoCone]]:
    """Give a function that makes what robots hear of it, each one echo from the foot."""

    def make(east_m: float = 0.0, north_m: float = 0.0) -> list[EchoCone]:
        beam, cones = BeamPattern.linear(), []
        for number in range(24):
            x_m, y_m = 0.1 * number, 0.25 * math.sin(0.7 * number)
            yaw_rad = 0.5 * math.pi + 0.3 * math.sin(1.3 * number)
            across_m = MIRROR_M - y_m
            gain = float(beam.gain(0.5 * math.pi - yaw_rad))
            echo = across_m, MIRROR * gain / (2.0 * across_m)
            pose = {"x_m": x_m + east_m, "y_m": y_m + north_m, "yaw_rad": yaw_rad}
            cones.append(make_cone(echo, stamp_ns=number, **pose))
        return cones

    return make


@pytest.fixture(scope="session")
def mirror_pings(mirror_pings_at: Callable[..., list[EchoCone]]) -> list[EchoCone]:
    """Give what robots hear of the mirror."""
    return mirror_pings_at()
