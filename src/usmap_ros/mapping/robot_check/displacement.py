"""In which way a robot may have pinged from elsewhere than it says."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from usmap_ros.mapping.robot_check.sightings import Sightings, sightings_of
from usmap_ros.pings.cone import EchoCone

Kind = Literal["turned", "late", "moved"]


class Displacement(NamedTuple):
    """What may be wrong with a robot's poses.

    Parameters
    ----------
    kind : str
        ``turned``, ``late`` or ``moved``.
    x, y : float
        By how much: rad, s; or the way in metres.
    """

    kind: Kind
    x: float
    y: float = 0.0

    def in_words(self) -> str:
        """Under which condition its pings fit."""
        words = {
            "turned": f"if it faces {math.degrees(self.x):+.0f}° from there",
            "late": f"if its poses are {self.x:+.1f} s late",
            "moved": f"if it is {math.hypot(self.x, self.y):.1f} m from there",
        }
        return words[self.kind]


#: Those that are looked for; and places, m, first on a coarse grid, and then around the best.
SHARP = (
    *(Displacement("turned", math.radians(by)) for by in range(-160, 181, 20) if by),
    *(Displacement("late", delay_s) for delay_s in (-1.0, -0.5, 0.5, 1.0)),
)
_GRID_M = [0.2 * step for step in range(-6, 7)]
COARSE = tuple(
    Displacement("moved", x_m, y_m)
    for x_m in _GRID_M
    for y_m in _GRID_M
    if 0.25 < math.hypot(x_m, y_m) < 1.3
)
FINE_M = (-0.1, -0.05, 0.0, 0.05, 0.1)


class Way:
    """A robot's pings, and where it would have heard them from.

    Parameters
    ----------
    cones : sequence of EchoCone
        In the order of their stamps.
    """

    def __init__(self, cones: Sequence[EchoCone]) -> None:
        self.told = sightings_of(cones)
        self._stamps_s = (np.array([cone.stamp_ns for cone in cones]) - cones[0].stamp_ns) * 1e-9
        self._yaw_rad = np.unwrap([cone.pose.yaw_rad for cone in cones])

    def displaced(self, by: Displacement) -> Sightings:
        """The pings as they would be; those of which nothing is known then reach nowhere."""
        told = self.told
        if by.kind == "moved":
            return told._replace(x_m=told.x_m + by.x, y_m=told.y_m + by.y)
        if by.kind == "turned":
            yaw_rad = self._yaw_rad + by.x
            return told._replace(axis_x=np.cos(yaw_rad), axis_y=np.sin(yaw_rad))
        then_s = self._stamps_s + by.x
        is_known = (then_s >= self._stamps_s[0]) & (then_s <= self._stamps_s[-1])
        yaw_rad = np.interp(then_s, self._stamps_s, self._yaw_rad)
        return told._replace(
            x_m=np.interp(then_s, self._stamps_s, told.x_m),
            y_m=np.interp(then_s, self._stamps_s, told.y_m),
            axis_x=np.cos(yaw_rad),
            axis_y=np.sin(yaw_rad),
            greatest_m=np.where(is_known, told.greatest_m, 0.0),
        )
