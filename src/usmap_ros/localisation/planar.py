"""Poses in the plane as rows of x (m), y (m) and yaw (rad)."""

from collections.abc import Sequence

import numpy as np

from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.geometry import wrapped
from usmap_ros.pings.cone import EchoCone


def told_poses(cones: Sequence[EchoCone]) -> tuple[FloatArray, FloatArray]:
    """Poses that pings state, (n, 3), and their covariances, (n, 3, 3)."""
    poses = np.array([[*one.pose.position_m[:2], one.pose.yaw_rad] for one in cones])
    return poses, np.array([one.pose.planar_covariance for one in cones])


def compose(outer: FloatArray, inner: FloatArray) -> FloatArray:
    """Poses of what is at `inner` as seen from `outer`, both (..., 3)."""
    cosine, sine = np.cos(outer[..., 2]), np.sin(outer[..., 2])
    return np.stack(
        [
            outer[..., 0] + cosine * inner[..., 0] - sine * inner[..., 1],
            outer[..., 1] + sine * inner[..., 0] + cosine * inner[..., 1],
            wrapped(outer[..., 2] + inner[..., 2]),
        ],
        axis=-1,
    )


def between(first: FloatArray, second: FloatArray) -> FloatArray:
    """Poses of `second` as seen from `first`, both (..., 3)."""
    cosine, sine = np.cos(first[..., 2]), np.sin(first[..., 2])
    x_m, y_m = second[..., 0] - first[..., 0], second[..., 1] - first[..., 1]
    return np.stack(
        [
            cosine * x_m + sine * y_m,
            cosine * y_m - sine * x_m,
            wrapped(second[..., 2] - first[..., 2]),
        ],
        axis=-1,
    )


def derivatives(first: FloatArray, second: FloatArray) -> FloatArray:
    """How `between` changes with both poses, shape (..., 3, 6)."""
    cosine, sine = np.cos(first[..., 2]), np.sin(first[..., 2])
    seen = between(first, second)
    change = np.zeros((*first.shape[:-1], 3, 6))
    change[..., 0, 0] = change[..., 1, 1] = -cosine
    change[..., 0, 1], change[..., 1, 0] = -sine, sine
    change[..., 0, 2], change[..., 1, 2] = seen[..., 1], -seen[..., 0]
    change[..., 2, 2] = -1.0
    change[..., 0, 3] = change[..., 1, 4] = cosine
    change[..., 0, 4], change[..., 1, 3] = sine, -sine
    change[..., 2, 5] = 1.0
    return change


def turned_into(first: FloatArray) -> FloatArray:
    """Matrices, (..., 3, 3), that turn changes of x, y, yaw into a pose's own axes."""
    cosine, sine = np.cos(first[..., 2]), np.sin(first[..., 2])
    turn = np.zeros((*first.shape[:-1], 3, 3))
    turn[..., 0, 0] = turn[..., 1, 1] = cosine
    turn[..., 0, 1], turn[..., 1, 0] = sine, -sine
    turn[..., 2, 2] = 1.0
    return turn
