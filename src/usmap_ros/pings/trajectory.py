"""Where something was, ping by ping."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.geometry import Pose


@dataclass(frozen=True)
class Trajectory:
    """Poses in the order of their stamps."""

    #: (n,) int64 array: nanoseconds since the epoch, ascending.
    stamps_ns: NDArray[np.int64]
    #: (n, 3) array: x, y, z.
    positions_m: FloatArray
    #: (n, 4) array: unit quaternions x, y, z, w.
    orientations: FloatArray

    @classmethod
    def of_poses(cls, stamped: Iterable[tuple[int, Pose]]) -> Trajectory:
        """From poses with their stamps, in any order; of those with one stamp the first counts."""
        poses: dict[int, Pose] = {}
        for stamp_ns, pose in stamped:
            poses.setdefault(stamp_ns, pose)
        stamps_ns = np.array(sorted(poses), dtype=np.int64)
        return cls(
            stamps_ns,
            np.array([poses[int(one)].position_m for one in stamps_ns]).reshape(-1, 3),
            np.array([poses[int(one)].orientation for one in stamps_ns]).reshape(-1, 4),
        )

    @classmethod
    def planar(cls, stamps_ns: NDArray[np.int64], poses: FloatArray) -> Trajectory:
        """From x, y (m) and yaw (rad), shape (n, 3)."""
        half = 0.5 * poses[:, 2]
        zero = np.zeros(len(poses))
        return cls(
            np.asarray(stamps_ns, dtype=np.int64),
            np.column_stack([poses[:, :2], zero]),
            np.column_stack([zero, zero, np.sin(half), np.cos(half)]),
        )

    def begun_at(self, start: Pose) -> FloatArray:
        """Places (x, y) in the plane, shape (n, 2), were its first pose another one."""
        first = Pose(self.positions_m[0], self.orientations[0])
        turn_rad = start.yaw_rad - first.yaw_rad
        cosine, sine = np.cos(turn_rad), np.sin(turn_rad)
        off_m = self.positions_m[:, :2] - first.position_m[:2]
        turned = off_m @ np.array([[cosine, sine], [-sine, cosine]])
        return np.asarray(start.position_m[:2] + turned)

    def __len__(self) -> int:
        """Number of poses."""
        return len(self.stamps_ns)

    def at(self, rows: NDArray[np.intp]) -> Trajectory:
        """Those of some rows."""
        return Trajectory(self.stamps_ns[rows], self.positions_m[rows], self.orientations[rows])
