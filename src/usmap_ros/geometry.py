"""Poses in space and their projection onto the map plane."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from usmap_ros.arrays import FloatArray
from usmap_ros.errors import MalformedMessageError

#: How far the norm of a quaternion may be from 1 (tf2 and nav2 use a like tolerance).
QUATERNION_TOLERANCE = 1e-2

#: Rows and columns of x, y and yaw in the 6 × 6 covariance of a ROS pose.
PLANAR_AXES = (0, 1, 5)


@dataclass(frozen=True)
class Pose:
    """Position and orientation of a frame, with the covariance that ROS gives them.

    Parameters
    ----------
    position_m : (3,) array
        x, y, z in metres.
    orientation : (4,) array
        Unit quaternion x, y, z, w.
    covariance : (6, 6) array
        Of x, y, z (m) and the rotations about the fixed axes x, y, z (rad); zeros mean exact.
    """

    position_m: FloatArray
    orientation: FloatArray
    covariance: FloatArray = field(default_factory=lambda: np.zeros((6, 6)))

    @classmethod
    def planar(
        cls,
        x_m: float,
        y_m: float,
        yaw_rad: float,
        z_m: float = 0.0,
        planar_covariance: FloatArray | None = None,
    ) -> Pose:
        """Pose in the plane, with an optional (3, 3) covariance of x, y and yaw."""
        covariance = np.zeros((6, 6))
        if planar_covariance is not None:
            covariance[np.ix_(PLANAR_AXES, PLANAR_AXES)] = planar_covariance
        half = yaw_rad / 2.0
        orientation = np.array([0.0, 0.0, np.sin(half), np.cos(half)])
        return cls(np.array([x_m, y_m, z_m], dtype=float), orientation, covariance)

    @property
    def yaw_rad(self) -> float:
        """Heading of the x axis in the plane, in (-π, π]."""
        x, y, z, w = self.orientation
        return float(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))

    @property
    def planar_covariance(self) -> FloatArray:
        """Covariance of x (m), y (m) and yaw (rad), shape (3, 3)."""
        return self.covariance[np.ix_(PLANAR_AXES, PLANAR_AXES)]

    def validate(self) -> None:
        """Raise `MalformedMessageError` unless finite, turned by a unit, and of known error."""
        if not np.all(np.isfinite(self.position_m)):
            raise MalformedMessageError("pose.position", "is not finite")
        if not np.all(np.isfinite(self.orientation)):
            raise MalformedMessageError("pose.orientation", "is not finite")
        norm = float(np.linalg.norm(self.orientation))
        if abs(norm - 1.0) > QUATERNION_TOLERANCE:
            raise MalformedMessageError("pose.orientation", f"has norm {norm:.3g} instead of 1")
        if not np.all(np.isfinite(self.covariance)):
            raise MalformedMessageError("pose.covariance", "is not finite")
        if np.any(np.diagonal(self.covariance) < 0.0):
            raise MalformedMessageError("pose.covariance", "has a negative variance")
