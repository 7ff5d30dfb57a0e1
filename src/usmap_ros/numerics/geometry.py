"""Poses in space: put one into the other, and see points from them; which way segments face."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from usmap_ros import bounds
from usmap_ros.errors import MalformedMessageError
from usmap_ros.numerics.arrays import FloatArray

#: How much a covariance may be beyond what its variances allow, m² or rad².
COVARIANCE_TOLERANCE = 1e-6
#: How far the norm of a quaternion may be from 1 (tf2 and nav2 use a like tolerance).
QUATERNION_TOLERANCE = 1e-2

#: Variance of a place from which on it stands for one that is not known, m².
UNKNOWN_M2 = 1e4
#: Rows and columns of x, y and yaw in the 6 × 6 covariance of a ROS pose.
PLANAR_AXES = (0, 1, 5)
_PLANE = np.ix_(PLANAR_AXES, PLANAR_AXES)


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
            covariance[_PLANE] = planar_covariance
        half = yaw_rad / 2.0
        orientation = np.array([0.0, 0.0, np.sin(half), np.cos(half)])
        return cls(np.array([x_m, y_m, z_m], dtype=float), orientation, covariance)

    @classmethod
    def turned(
        cls, position_m: FloatArray, yaw_rad: float, pitch_rad: float, roll_rad: float
    ) -> Pose:
        """Exact pose that is turned about its own z axis, then about its y, then about its x."""
        (cz, sz), (cy, sy), (cx, sx) = (
            (math.cos(angle / 2.0), math.sin(angle / 2.0))
            for angle in (yaw_rad, pitch_rad, roll_rad)
        )
        orientation = [
            sx * cy * cz - cx * sy * sz,
            cx * sy * cz + sx * cy * sz,
            cx * cy * sz - sx * sy * cz,
            cx * cy * cz + sx * sy * sz,
        ]
        return cls(position_m, np.array(orientation))

    @cached_property
    def rotation(self) -> FloatArray:
        """Matrix that turns from the frame's own axes to those it is given in, shape (3, 3)."""
        x, y, z, w = (self.orientation / np.linalg.norm(self.orientation)).tolist()
        return np.array(
            [
                [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
                [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
                [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
            ]
        )

    @cached_property
    def yaw_rad(self) -> float:
        """Heading of the x axis in the plane, in (-π, π]."""
        return float(np.arctan2(self.rotation[1, 0], self.rotation[0, 0]))

    @property
    def planar_covariance(self) -> FloatArray:
        """Covariance of x (m), y (m) and yaw (rad), shape (3, 3)."""
        return self.covariance[_PLANE]

    @cached_property
    def planar_variances(self) -> tuple[float, float, float]:
        """Variances of x (m), y (m) and yaw (rad)."""
        x, y, yaw = (float(self.covariance[axis, axis]) for axis in PLANAR_AXES)
        return x, y, yaw

    def compose(self, inner: Pose) -> Pose:
        """Pose in the frame that this one is given in, of what is at `inner` in this one's frame.

        The covariance of `inner` is turned along; that of this pose is not added.
        """
        turn = np.kron(np.eye(2), self.rotation)
        return Pose(
            position_m=self.position_m + self.rotation @ inner.position_m,
            orientation=_one_turn_after_another(inner.orientation, self.orientation),
            covariance=turn @ inner.covariance @ turn.T,
        )

    @property
    def is_tilted(self) -> bool:
        """Whether the x axis points up or down."""
        return bool(abs(self.rotation[2, 0]) > 1e-9)

    def inverse(self) -> Pose:
        """Pose of the frame that this one is given in, in this one's frame; exact."""
        back = self.orientation * np.array([-1.0, -1.0, -1.0, 1.0])
        return Pose(position_m=-self.rotation.T @ self.position_m, orientation=back)

    def polar(self, points_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Where points are, as seen from here along the x axis.

        Parameters
        ----------
        points_m : (..., 3) or (..., 2) array
            In the frame that the pose is given in; without z, at the height of the pose.

        Returns
        -------
        ranges_m : (...) array
            Distance of each point from the pose's position.
        bearings_rad : (...) array
            Angle off the x axis in [-π, π], negative to the right: of a point at the height of a
            pose that is not tilted, its bearing in the plane.
        """
        offsets_m = [
            np.asarray(points_m, dtype=float)[..., axis] - self.position_m[axis]
            for axis in range(np.shape(points_m)[-1])
        ]
        # Axis by axis, because a matrix product of so narrow arrays takes thrice as long.
        ahead_m, left_m, up_m = (
            sum(offset_m * turn for offset_m, turn in zip(offsets_m, column, strict=False))
            for column in self.rotation.T
        )
        off_axis_m = np.copysign(np.hypot(left_m, up_m), left_m)
        range_m = np.sqrt(sum(offset_m**2 for offset_m in offsets_m))
        return range_m, np.arctan2(off_axis_m, ahead_m)

    def validate(self) -> None:
        """Raise `MalformedMessageError` unless finite, turned by a unit, and of known error."""
        # For every ping: of three or four numbers, Python's own take a fifth of the time.
        position_m, orientation = self.position_m.tolist(), self.orientation.tolist()
        if not all(map(math.isfinite, position_m)):
            raise MalformedMessageError("pose.position", "is not finite")
        if max(map(abs, position_m)) > bounds.POSITION.greatest:
            bounds.check_all("pose.position", self.position_m, bounds.POSITION)
        bounds.check("pose.position.z", position_m[2], bounds.HEIGHT)
        if not all(map(math.isfinite, orientation)):
            raise MalformedMessageError("pose.orientation", "is not finite")
        norm = math.hypot(*orientation)
        if abs(norm - 1.0) > QUATERNION_TOLERANCE:
            raise MalformedMessageError("pose.orientation", f"has norm {norm:.3g} instead of 1")
        if not self.covariance.any():
            return
        if not np.isfinite(self.covariance).all():
            raise MalformedMessageError("pose.covariance", "is not finite")
        variances = np.diagonal(self.covariance)
        if (variances < 0.0).any():
            raise MalformedMessageError("pose.covariance", "has a negative variance")
        bounds.check_all("pose.covariance", variances, bounds.VARIANCE)
        # Rounding may make a correlation a little greater than 1.
        most = 1.01 * np.sqrt(np.outer(variances, variances)) + COVARIANCE_TOLERANCE
        if (np.abs(self.covariance) > most).any():
            raise MalformedMessageError("pose.covariance", "has a correlation beyond 1")


def _one_turn_after_another(first: FloatArray, second: FloatArray) -> FloatArray:
    """Unit quaternion of both turns: the product of the second one and the first."""
    vector, scalar = first[:3], first[3]
    after, after_scalar = second[:3], second[3]
    turned = after_scalar * vector + scalar * after + np.cross(after, vector)
    both = np.append(turned, scalar * after_scalar - after @ vector)
    unit: FloatArray = both / np.linalg.norm(both)
    return unit


def on_base(base: Pose, mount: Pose) -> Pose:
    """Pose of what is mounted on a base, with the covariance that the base's gives it.

    Other than by `Pose.compose`, what the base's heading is off moves what sits beside its centre.

    Parameters
    ----------
    base : Pose
        Of the base, which may be off.
    mount : Pose
        On the base, exact.
    """
    pose = base.compose(mount)
    arm_x_m, arm_y_m = (pose.position_m - base.position_m)[:2].tolist()
    lever = np.eye(6)
    lever[0, 5], lever[1, 5] = -arm_y_m, arm_x_m
    return Pose(pose.position_m, pose.orientation, lever @ base.covariance @ lever.T)


def told_covariance(covariance: FloatArray) -> FloatArray:
    """A covariance as messages have it; zeros if it says that nothing is known.

    That is -1 in the first place, as ``sensor_msgs`` have it, or variances of no place on earth
    such as 1e6, as others do: poses without a place would not have been sent.

    Parameters
    ----------
    covariance : (36,) array
        Row by row.
    """
    x_m2, y_m2 = covariance[0], covariance[7]
    is_known = x_m2 != -1.0 and not min(x_m2, y_m2) >= UNKNOWN_M2
    return covariance.reshape(6, 6) if is_known else np.zeros((6, 6))


def at_height(places_m: FloatArray, height_m: float | FloatArray) -> FloatArray:
    """Points in space, shape (n, 3), over places in the plane, shape (n, 2)."""
    heights_m = np.broadcast_to(height_m, len(places_m))
    return np.column_stack([places_m, heights_m])


def wrapped(angles_rad: FloatArray) -> FloatArray:
    """Angles in [-π, π)."""
    return np.asarray(angles_rad - 2.0 * np.pi * np.floor(angles_rad / (2.0 * np.pi) + 0.5))


def way_between(first: Pose, second: Pose) -> tuple[float, float]:
    """How far a pose lies from another in the plane (m), and is turned from it (rad)."""
    way_m = math.dist(first.position_m[:2].tolist(), second.position_m[:2].tolist())
    return way_m, abs(math.remainder(second.yaw_rad - first.yaw_rad, 2.0 * math.pi))


def left_normals(starts_m: FloatArray, ends_m: FloatArray) -> FloatArray:
    """Unit vectors across segments in the plane, to the left of the way along them.

    Parameters
    ----------
    starts_m, ends_m : (n, 2) arrays
        x, y of where the segments begin and end.
    """
    along = ends_m - starts_m
    left = np.stack([-along[:, 1], along[:, 0]], axis=-1)
    return np.asarray(left / np.linalg.norm(along, axis=-1, keepdims=True))
