"""A path of straight legs."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from usmap_ros.numerics.arrays import FloatArray

#: Bounded, so that neither infinity nor NaN gets through.
Coordinate = Annotated[float, Field(ge=-1e5, le=1e5)]
Point = tuple[Coordinate, Coordinate]


@dataclass(frozen=True)
class Polyline:
    """Straight legs from waypoint to waypoint."""

    #: (n, 2) array: n is 1 or more; one waypoint means to stay there.
    waypoints_m: FloatArray
    #: Whether a last leg leads back to the first waypoint and the path begins again. Otherwise it
    #: is walked once, and whoever walks it stays at its end.
    loop: bool = False

    @property
    def corners_m(self) -> FloatArray:
        """Waypoints, the first one again at the end of a loop."""
        if self.loop:
            return np.concatenate([self.waypoints_m, self.waypoints_m[:1]])
        return self.waypoints_m

    def at(self, travelled_m: float) -> tuple[FloatArray, float]:
        """Position (2,) and direction (rad) after a distance along the path."""
        corners = self.corners_m
        legs = np.diff(corners, axis=0)
        lengths = np.linalg.norm(legs, axis=-1)
        total = float(lengths.sum())
        if total == 0.0:
            return corners[0], 0.0
        distance = travelled_m % total if self.loop else min(max(travelled_m, 0.0), total)
        reached = np.cumsum(lengths)
        leg = min(int(np.searchsorted(reached, distance)), len(legs) - 1)
        fraction = 1.0 - (reached[leg] - distance) / lengths[leg]
        position = corners[leg] + fraction * legs[leg]
        return position, float(np.arctan2(legs[leg, 1], legs[leg, 0]))
