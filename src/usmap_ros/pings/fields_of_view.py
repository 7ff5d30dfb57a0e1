"""What pings looked at: where each stood, which way it faced, and how wide and far it reached."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.pings.cone import EchoCone


class Beam(NamedTuple):
    """Which way a ping faced, how wide it was and how far it reached."""

    #: Of the beam axis in the plane.
    yaw_rad: float
    #: Of the cone; π or more looks all around.
    half_angle_rad: float
    #: Beyond which nothing was listened for.
    max_range_m: float

    @classmethod
    def of(cls, cone: EchoCone) -> Beam:
        """The beam of the ping that a cone stems from."""
        transducer = cone.transducer
        return cls(cone.pose.yaw_rad, transducer.beam.half_angle_rad, transducer.max_range_m)


@dataclass(frozen=True)
class PingViews:
    """Positions and beams of a number of pings.

    Parameters
    ----------
    positions_m : (pings, 2) array
        x, y of each.
    beams : (pings, 3) array
        The numbers of its `Beam`.
    """

    positions_m: FloatArray
    beams: FloatArray

    @classmethod
    def of(cls, cones: Iterable[EchoCone]) -> PingViews:
        """What the pings looked at that cones stem from."""
        pings = [(*cone.pose.position_m[:2], *Beam.of(cone)) for cone in cones]
        numbers = np.reshape(np.array(pings, dtype=float), (-1, 5))
        return cls(numbers[:, :2], numbers[:, 2:])

    def __len__(self) -> int:
        return len(self.positions_m)
