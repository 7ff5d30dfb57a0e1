"""Landmarks that many pings hear, found by votes, those of most echoes first.

Lines of walls are found by a Hough transform (Duda & Hart, CACM 1972) whose axes are the normal's
direction and the distance, points by one whose axes are those of the plane.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from usmap_ros.localisation.data_association import worth_their_cost
from usmap_ros.localisation.echo_table import TrackEchoes, of_rows
from usmap_ros.localisation.line_fits import (
    LandmarkEchoes,
    fit_line,
    fit_point,
    put_on_line,
    put_on_point,
)
from usmap_ros.localisation.lines_and_points import WITHIN, Landmarks
from usmap_ros.numerics.arrays import BoolArray, FloatArray, spans
from usmap_ros.numerics.geometry import wrapped

#: Directions of normals that are voted for, and least width of a step of distance, m.
_DIRECTIONS, _STEP_M = 120, 0.04
#: Landmarks of a kind at the most, echoes that each must explain, and places, a decimetre apart,
#: that the feet of a wall must have: one place is as well a point's.
_MOST, _LEAST_ECHOES, _LEAST_PLACES = 200, 5.0, 4


def find_lines(
    echoes: TrackEchoes, poses: FloatArray, wanted: BoolArray, sigma_m: float
) -> Landmarks:
    """Lines that echoes of several places have in common, those of most echoes first.

    Parameters
    ----------
    echoes : TrackEchoes
        Of all pings.
    poses : (pings, 3) array
        x, y (m) and yaw (rad).
    wanted : (pings,) bool array
        Whose echoes count.
    sigma_m : float
        How far ranges and poses are off.
    """
    centre_m = poses[:, :2].mean(axis=0)
    bearers = _bearers(echoes, poses, wanted, centre_m)
    normals_rad, distances_m = _found(_Lines(bearers, max(_STEP_M, sigma_m), sigma_m)).T
    away_m = centre_m[0] * np.cos(normals_rad) + centre_m[1] * np.sin(normals_rad)
    return Landmarks(normals_rad, distances_m + away_m)


def find_points(
    echoes: TrackEchoes, poses: FloatArray, wanted: BoolArray, sigma_m: float
) -> FloatArray:
    """Points that arcs of echoes have in common, (n, 2); parameters are those of `find_lines`."""
    centre_m = poses[:, :2].mean(axis=0)
    bearers = _bearers(echoes, poses, wanted, centre_m)
    return np.asarray(_found(_Points(bearers, max(_STEP_M, sigma_m), sigma_m)) + centre_m)


def find_landmarks(
    echoes: TrackEchoes, poses: FloatArray, wanted: BoolArray, sigma_m: float
) -> Landmarks:
    """Lines and points that are worth their cost; parameters are those of `find_lines`."""
    heard = echoes, poses, wanted
    both = find_lines(*heard, sigma_m)._replace(points_m=find_points(*heard, sigma_m))
    return worth_their_cost(*heard, both, sigma_m)


def _found(kind: _Lines | _Points) -> FloatArray:
    """What most echoes vote for that are left, one after the other, (n, 2)."""
    found: list[tuple[float, float]] = []
    left = np.ones(kind.count, np.bool_)
    for _ in range(2 * _MOST):
        if kind.ballot.most() < _LEAST_ECHOES or len(found) == _MOST:
            break
        place = kind.fit(left)
        gone, is_enough = kind.hits(left, place)
        left[gone] = False
        kind.ballot.take(gone)
        if not len(gone):
            # Nothing is near what was fitted: nobody may vote for that peak again.
            kind.ballot.forget()
        if is_enough:
            found.append(place)
    return np.array(found).reshape(-1, 2)


def _bearers(
    echoes: TrackEchoes, poses: FloatArray, wanted: BoolArray, centre_m: FloatArray
) -> LandmarkEchoes:
    heard = of_rows(echoes, np.flatnonzero(wanted[echoes.ping]))
    x_m, y_m = np.ascontiguousarray((poses[heard.ping, :2] - centre_m).T)
    return LandmarkEchoes(
        x_m, y_m, poses[heard.ping, 2], heard.range_m, WITHIN * heard.half_angle_rad,
        heard.aslant_rad, heard.weight * np.minimum(heard.onset, 1.0),
    )  # fmt: skip


class _Ballot:
    """Votes of echoes for cells.

    Parameters
    ----------
    echo, cell : (n,) int arrays
        Who votes for what, in the order of echoes.
    weight : (echoes,) array
        How much each counts.
    beside : sequence of int
        What is added to a cell to get those that are counted with it.
    """

    def __init__(
        self, echo: np.ndarray, cell: np.ndarray, weight: FloatArray, beside: Sequence[int]
    ) -> None:
        # Most of the plane is empty where robots are far apart.
        self._cells, self._cell = np.unique(cell, return_inverse=True)
        self._echo, self._weight = echo, weight
        # First of each echo's votes, and the end.
        self._first = np.searchsorted(echo, np.arange(len(weight) + 1))
        self._beside = np.zeros((len(beside), len(self._cells)), np.intp)
        for row, step in enumerate(beside):
            there = np.searchsorted(self._cells, self._cells + step)
            is_there = self._cells[np.minimum(there, len(self._cells) - 1)] == self._cells + step
            self._beside[row] = np.where(is_there, there, len(self._cells))
        self._counts = np.append(self._counted(np.arange(len(echo))), 0.0)
        self._best = 0

    def _counted(self, votes: np.ndarray) -> FloatArray:
        weights = self._weight[self._echo[votes]]
        return np.asarray(np.bincount(self._cell[votes], weights, len(self._cells)))

    @property
    def best(self) -> int:
        """The cell of most votes."""
        return int(self._cells[self._best])

    def most(self) -> float:
        """How many votes there are for it and those beside it."""
        if not len(self._cells):
            return 0.0
        both = self._counts[:-1] + self._counts[self._beside].sum(axis=0)
        self._best = int(np.argmax(both))
        return float(both[self._best])

    def take(self, gone: NDArray[np.intp]) -> None:
        """Take votes of some echoes out."""
        votes = spans(self._first[gone], np.diff(self._first)[gone])
        self._counts[:-1] -= self._counted(votes)

    def forget(self) -> None:
        """Take all votes for the best cell out."""
        self._counts[self._best] = 0.0


class _Lines:
    """Votes for lines."""

    def __init__(self, rows: LandmarkEchoes, step_m: float, sigma_m: float) -> None:
        self._rows, self._step_m, self._sigma_m = rows, step_m, sigma_m
        self.count = len(rows.x_m)
        angles = np.arange(_DIRECTIONS) * 2.0 * np.pi / _DIRECTIONS
        reach_rad = (rows.reach_rad + rows.aslant_rad)[:, np.newaxis]
        off_rad = wrapped(angles - rows.yaw_rad[:, np.newaxis])
        echo, direction = np.nonzero(np.abs(off_rad) <= reach_rad)
        inside = np.clip(off_rad[echo, direction], -rows.reach_rad[echo], rows.reach_rad[echo])
        heading = rows.yaw_rad[echo] + inside
        x_m = rows.x_m[echo] + rows.range_m[echo] * np.cos(heading)
        y_m = rows.y_m[echo] + rows.range_m[echo] * np.sin(heading)
        angle = angles[direction]
        step = np.floor((x_m * np.cos(angle) + y_m * np.sin(angle)) / step_m).astype(np.int64)
        self._lowest = int(step.min(initial=0))
        # One more than there are, so that no direction's last one is beside the next one's first.
        self._steps = int(step.max(initial=0)) - self._lowest + 2
        cell = direction * self._steps + step - self._lowest
        self.ballot = _Ballot(echo, cell, rows.weight, [1])

    def fit(self, left: BoolArray) -> tuple[float, float]:
        """The line that most echoes vote for: its normal, and its distance."""
        direction, step = divmod(self.ballot.best, self._steps)
        line = direction * 2.0 * np.pi / _DIRECTIONS, (self._lowest + step + 1) * self._step_m
        return fit_line(self._rows, left, line, self._step_m, self._sigma_m)

    def hits(self, left: BoolArray, line: tuple[float, float]) -> tuple[NDArray[np.intp], bool]:
        """Echoes that may be its; whether there are enough of them for a wall."""
        along_m, off_m = np.empty((2, len(left)))
        put_on_line(self._rows, left, *line, along_m, off_m)
        off_m = np.abs(off_m)
        hits = np.flatnonzero(off_m < 2.0 * self._sigma_m)
        gone = np.flatnonzero(off_m < 2.0 * max(self._step_m, self._sigma_m))
        if self._rows.weight[hits].sum() < _LEAST_ECHOES:
            return gone, False
        return gone, len(np.unique(np.floor(along_m[hits] / 0.1))) >= _LEAST_PLACES


class _Points:
    """Votes for points."""

    def __init__(self, rows: LandmarkEchoes, step_m: float, sigma_m: float) -> None:
        self._rows, self._step_m, self._sigma_m = rows, step_m, sigma_m
        self.count = len(rows.x_m)
        count = np.ceil(2.0 * rows.reach_rad * rows.range_m / step_m).astype(np.int64) + 1
        echo = np.repeat(np.arange(len(count)), count)
        number = spans(np.zeros_like(count), count)
        off_rad = rows.reach_rad[echo] * (2.0 * (number + 0.5) / count[echo] - 1.0)
        heading = rows.yaw_rad[echo] + off_rad
        column = np.floor((rows.x_m[echo] + rows.range_m[echo] * np.cos(heading)) / step_m)
        row = np.floor((rows.y_m[echo] + rows.range_m[echo] * np.sin(heading)) / step_m)
        self._left, self._low = (int(each.min(initial=0)) for each in (column, row))
        column, row = column.astype(np.int64) - self._left, row.astype(np.int64) - self._low
        self._columns = int(column.max(initial=0)) + 2
        cell = row * self._columns + column
        # An arc's samples in one cell follow one another.
        is_new = (np.diff(cell, prepend=-1) != 0) | (np.diff(echo, prepend=-1) != 0)
        columns = self._columns
        self.ballot = _Ballot(echo[is_new], cell[is_new], rows.weight, [1, columns, columns + 1])

    def fit(self, left: BoolArray) -> tuple[float, float]:
        """The point that most echoes vote for: x and y."""
        row, column = divmod(self.ballot.best, self._columns)
        place = (column + self._left + 1) * self._step_m, (row + self._low + 1) * self._step_m
        return fit_point(self._rows, left, place, self._step_m, self._sigma_m)

    def hits(self, left: BoolArray, point: tuple[float, float]) -> tuple[NDArray[np.intp], bool]:
        """Echoes that may be its; whether there are enough of them."""
        off_m = np.empty(len(left))
        put_on_point(self._rows, left, *point, off_m)
        off_m = np.abs(off_m)
        hits = np.flatnonzero(off_m < 2.0 * self._sigma_m)
        gone = np.flatnonzero(off_m < 2.0 * max(self._step_m, self._sigma_m))
        return gone, bool(self._rows.weight[hits].sum() >= _LEAST_ECHOES)
