"""Ranges to walls in the normal equations of knots, the walls eliminated."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from usmap_ros.localisation.echo_table import Echoes
from usmap_ros.localisation.landmarks import Knots
from usmap_ros.localisation.walls import Heard, Walls
from usmap_ros.numerics.arrays import FloatArray

#: Shares that are less say nothing.
_LEAST_SHARE = 0.02
#: How far a wall may turn (rad) and move (m) at once, standard deviations.
_MAY_TURN_RAD, _MAY_MOVE_M = 0.2, 0.3


class WallEquations:
    """What echoes of walls add to the equations of knots.

    Walls are unknowns as well, a direction and a distance each.  They do not know one another, so
    that they are eliminated (Schur complement), and follow from the knots afterwards.

    Parameters
    ----------
    walls, heard : Walls, Heard
        What stands, and whose each echo is.
    echoes : Echoes
        Of all pings.
    poses : (pings, 3) array
        x, y (m) and yaw (rad).
    knots : Knots
        Between which knots each ping is.
    count : int
        Of knots.
    weight : float
        Of an echo, per m².
    """

    def __init__(
        self,
        walls: Walls,
        heard: Heard,
        echoes: Echoes,
        poses: FloatArray,
        knots: Knots,
        count: int,
        weight: float,
    ) -> None:
        self._walls = walls
        kept = np.flatnonzero(heard.shares > _LEAST_SHARE)
        echo, wall = heard.echo[kept], heard.wall[kept]
        ping, rows = echoes.ping[echo], np.arange(len(echo))
        weights = heard.shares[kept] * echoes.weight[echo] * weight * heard.precision[kept]
        off_m, along_m = heard.off_m[kept], heard.along_m[kept]
        number, lines = len(walls.normals_rad), len(echo)
        # Walls turn about the middle of their feet.
        total = np.bincount(wall, weights, number)
        middle = np.bincount(wall, weights * along_m, number)
        self._middle_m = middle / np.maximum(total, 1e-12)
        is_free = knots.before[ping] >= 0
        before, share = np.maximum(knots.before[ping], 0), knots.share[ping]
        after, normals = np.minimum(before + 1, count - 1), walls.normals()[:, wall]
        parts = np.stack([1.0 - share, share]) * is_free
        changes = np.vstack([normals, heard.per_rad_m[kept]])
        values = (parts[:, np.newaxis] * changes).reshape(6, -1)
        columns = np.stack([3 * knot + axis for knot in (before, after) for axis in range(3)])
        by_pose = sparse.csr_matrix(
            (values.ravel(), (np.tile(rows, 6), columns.ravel())), (lines, 3 * count)
        )
        turns = np.concatenate([along_m - self._middle_m[wall], -np.ones(lines)])
        columns = np.concatenate([2 * wall, 2 * wall + 1])
        by_wall = sparse.csr_matrix((turns, (np.tile(rows, 2), columns)), (lines, 2 * number))
        weighed = sparse.diags(weights) @ by_pose
        self._matrix = (by_pose.T @ weighed).toarray()
        self._right = -np.asarray(by_pose.T @ (weights * off_m))
        own = (by_wall.T @ sparse.diags(weights) @ by_wall).toarray()
        own += np.diag(np.tile([_MAY_TURN_RAD**-2, _MAY_MOVE_M**-2], number))
        self._to_walls = np.linalg.solve(own, (by_wall.T @ weighed).toarray())
        self._alone = np.linalg.solve(own, -np.asarray(by_wall.T @ (weights * off_m)))
        self._coupling = (weighed.T @ by_wall).toarray()

    def add(self, matrix: FloatArray, right: FloatArray) -> None:
        """Add to both sides of the equations of the knots."""
        matrix += self._matrix - self._coupling @ self._to_walls
        right += self._right - self._coupling @ self._alone

    def moved(self, change: FloatArray) -> Walls:
        """Walls after a change of the knots, (knots, 3)."""
        turn, shift_m = (self._alone - self._to_walls @ change.ravel()).reshape(-1, 2).T
        return Walls(
            self._walls.normals_rad + turn,
            self._walls.distances_m + shift_m + self._middle_m * turn,
        )
