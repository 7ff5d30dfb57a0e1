"""Ranges to landmarks in the normal equations of knots, the landmarks eliminated."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.localisation.data_association import DataAssociation
from usmap_ros.localisation.echo_table import TrackEchoes
from usmap_ros.localisation.lines_and_points import Landmarks
from usmap_ros.localisation.square_walls import Squareness
from usmap_ros.numerics.arrays import FloatArray

#: Shares that are less say nothing; what a landmark of no echo weighs.
_LEAST_SHARE, _LEAST_WEIGHT = 0.02, 1e-12
#: How far a wall may turn (rad) and move (m) at once, standard deviations.
_MAY_TURN_RAD, _MAY_MOVE_M = 0.2, 0.3


class Knots(NamedTuple):
    """Between which knots pings are."""

    #: (pings,) int array: the knot before each ping; -1: its pose is fixed.
    before: NDArray[np.int64]
    #: (pings,) array: how far it is on the way to the next one, 0 to 1.
    share: FloatArray


class _Rows(NamedTuple):
    """A matrix of a row for each echo, with few entries."""

    #: (entries, echoes) arrays: in which column each is, and what it is.
    columns: NDArray[np.int64]
    values: FloatArray
    #: Columns in all.
    width: int

    def times(self, weights: FloatArray, other: _Rows) -> FloatArray:
        """Transposed, times weights of the echoes, times another one: a full matrix."""
        places = self.columns[:, np.newaxis] * other.width + other.columns
        values = (weights * self.values)[:, np.newaxis] * other.values
        size = self.width * other.width
        sums = np.bincount(places.ravel(), values.ravel(), size)
        return np.asarray(sums, float).reshape(self.width, other.width)

    def summed(self, of_echoes: FloatArray) -> FloatArray:
        """Transposed, times a vector of the echoes."""
        values = self.values * of_echoes
        return np.asarray(np.bincount(self.columns.ravel(), values.ravel(), self.width), float)


class LandmarkEquations:
    """What echoes of landmarks add to the equations of knots.

    Landmarks are unknowns as well, two each: a wall's direction and distance, a point's x and y.
    They are eliminated (Schur complement), and follow from the knots afterwards.

    Parameters
    ----------
    landmarks, heard : Landmarks, DataAssociation
        What stands, and which echoes are whose.
    echoes : TrackEchoes
        Of all pings.
    poses : (pings, 3) array
        x, y (m) and yaw (rad).
    knots : Knots
        Between which knots each ping is.
    count : int
        Of knots.
    weight : float
        Of an echo, per m².
    square : Squareness
        How lines keep to one direction.
    """

    def __init__(
        self,
        landmarks: Landmarks,
        heard: DataAssociation,
        echoes: TrackEchoes,
        poses: FloatArray,
        knots: Knots,
        count: int,
        weight: float,
        square: Squareness,
    ) -> None:
        self._landmarks = landmarks
        kept = np.flatnonzero(heard.shares > _LEAST_SHARE)
        echo, wall = heard.echo[kept], heard.landmark[kept]
        ping = echoes.ping[echo]
        weights = heard.shares[kept] * echoes.weight[echo] * weight * heard.precision[kept]
        off_m, along_m = heard.off_m[kept], heard.along_m[kept]
        number = landmarks.total
        changes = heard.by_pose[:, kept]
        changes_by_wall, self._middle_m = changes_by_landmark(
            landmarks, wall, along_m, changes, weights
        )
        by_wall = _Rows(np.stack([2 * wall, 2 * wall + 1]), changes_by_wall, 2 * number)
        by_pose = _changes_by_knots(changes, ping, knots, count)
        self._matrix = by_pose.times(weights, by_pose)
        self._coupling = by_pose.times(weights, by_wall)
        own = by_wall.times(weights, by_wall)
        self._right, alone = -by_pose.summed(weights * off_m), -by_wall.summed(weights * off_m)
        may_change = np.full((number, 2), _MAY_MOVE_M)
        may_change[: len(landmarks.normals_rad), 0] = _MAY_TURN_RAD
        own += np.diag(may_change.ravel() ** -2)
        is_turn, information = slice(0, 2 * len(square.off_rad), 2), square.information()
        own[is_turn, is_turn] += information
        alone[is_turn] -= information @ square.off_rad
        self._to_walls = np.linalg.solve(own, self._coupling.T)
        self._alone = np.linalg.solve(own, alone)

    def add(self, matrix: FloatArray, right: FloatArray) -> None:
        """Add to both sides of the equations of the knots."""
        matrix += self._matrix - self._coupling @ self._to_walls
        right += self._right - self._coupling @ self._alone

    def as_landmarks_stand(self, matrix: FloatArray) -> FloatArray:
        """The matrix, with these added, if landmarks stood just where they are taken to."""
        return matrix + self._coupling @ self._to_walls

    def moved(self, change: FloatArray) -> Landmarks:
        """Landmarks after a change of the knots, (knots, 3)."""
        changes = (self._alone - self._to_walls @ change.ravel()).reshape(-1, 2)
        return with_changes(self._landmarks, changes, self._middle_m)


def line_directions(
    landmarks: Landmarks, heard: DataAssociation, echoes: TrackEchoes, weight: float
) -> tuple[FloatArray, FloatArray]:
    """How many echoes tell the direction of each line, and how well (rad), (lines,) each.

    Parameters are those of `LandmarkEquations`.
    """
    its = np.flatnonzero(heard.landmark < len(landmarks.normals_rad))
    line, along_m, lines = heard.landmark[its], heard.along_m[its], len(landmarks.normals_rad)
    echo_weights = heard.shares[its] * echoes.weight[heard.echo[its]]
    weights = echo_weights * weight * heard.precision[its]
    middle_m = _middles_m(line, along_m, weights, lines)
    told = np.bincount(line, weights * (along_m - middle_m[line]) ** 2, lines)
    stds_rad = 1.0 / np.sqrt(told + _MAY_TURN_RAD**-2)
    return np.asarray(np.bincount(line, echo_weights, lines), float), stds_rad


def changes_by_landmark(
    landmarks: Landmarks,
    which: NDArray[np.intp],
    along_m: FloatArray,
    by_pose: FloatArray,
    weights: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """How far echoes are behind landmarks as these change.

    Parameters
    ----------
    landmarks : Landmarks
        What stands.
    which : (n,) int array
        Of which of them each echo is.
    along_m, by_pose : (n,) and (3, n) arrays
        As in `DataAssociation`.
    weights : (n,) array
        Of echoes.

    Returns
    -------
    changes : (2, n) array
        As a wall turns and moves outward, or a point moves along x and y.
    middle_m : (landmarks,) array
        Where along a wall the middle of its feet is, which it turns about.
    """
    middle_m = _middles_m(which, along_m, weights, landmarks.total)
    changes = np.stack([along_m - middle_m[which], -np.ones(len(which))])
    is_point = which >= len(landmarks.normals_rad)
    changes[:, is_point] = -by_pose[:2, is_point]
    return changes, middle_m


def with_changes(landmarks: Landmarks, changes: FloatArray, middle_m: FloatArray) -> Landmarks:
    """Landmarks after changes, (landmarks, 2), as `changes_by_landmark` has them."""
    lines = len(landmarks.normals_rad)
    turn_rad, shift_m = changes[:lines].T
    return Landmarks(
        landmarks.normals_rad + turn_rad,
        landmarks.distances_m + shift_m + middle_m[:lines] * turn_rad,
        landmarks.points_m + changes[lines:],
    )


def _changes_by_knots(
    by_pose: FloatArray, ping: NDArray[np.intp], knots: Knots, count: int
) -> _Rows:
    """How far echoes of pings are behind landmarks as x, y and yaw of the knots beside change."""
    is_free = knots.before[ping] >= 0
    before, share = np.maximum(knots.before[ping], 0), knots.share[ping]
    after = np.minimum(before + 1, count - 1)
    parts = np.stack([1.0 - share, share]) * is_free
    columns = 3 * np.stack([before, after])[:, np.newaxis] + np.arange(3)[:, np.newaxis]
    values = (parts[:, np.newaxis] * by_pose).reshape(6, -1)
    return _Rows(columns.reshape(6, -1), values, 3 * count)


def _middles_m(
    which: NDArray[np.intp], along_m: FloatArray, weights: FloatArray, count: int
) -> FloatArray:
    """Where along each landmark the middle of its echoes is, shape (count,)."""
    total = np.bincount(which, weights, count)
    return np.bincount(which, weights * along_m, count) / np.maximum(total, _LEAST_WEIGHT)
