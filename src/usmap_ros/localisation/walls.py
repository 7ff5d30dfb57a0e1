"""Walls that many pings hear, found by votes, and which echoes are theirs.

Whatever a wall is made of, what comes back first comes from the foot of the perpendicular, if the
beam holds it: with unit normal n at distance d from the origin, from range d - n·p to a robot at
p.  Lines of walls are found by a Hough transform (Duda & Hart, CACM 1972) whose axes are the
normal's direction and d.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from usmap_ros.localisation.echo_table import Echoes, of_rows
from usmap_ros.localisation.planar import wrapped
from usmap_ros.numerics.arrays import BoolArray, FloatArray

#: Directions of normals that are voted for, and least width of a step of distance, m.
_DIRECTIONS, _STEP_M = 120, 0.04
#: Walls at the most, echoes that each must explain, and places, a decimetre apart, that its feet
#: must have: one place is as well a point's.
_MOST, _LEAST_ECHOES, _LEAST_PLACES = 50, 5.0, 4
#: Share of the half angle within which the foot must be.
_WITHIN = 0.95
#: How well the peak of the votes says the direction, rad, and the farthest step from it.
_PEAK_RAD, _MOST_TURN_RAD = 0.02, 0.05
#: Echoes per metre of range that no wall explains.
_BACKGROUND = 0.6
#: Stretch of a wall, m, of which it is asked how many of the pings that face it hear it; what is
#: thought of that beforehand, and how many looks outweigh it.
_STRETCH_M, _LEAST_RATE, _FIRST_RATE, _PRIOR_LOOKS = 0.3, 0.05, 0.3, 2.0
#: Times that this is asked anew, with what is thought of it then.
_ROUNDS = 3


class Walls(NamedTuple):
    """Lines of walls.

    Parameters
    ----------
    normals_rad : (n,) array
        Direction of the normal, from robots towards the wall.
    distances_m : (n,) array
        From the origin along it.
    """

    normals_rad: FloatArray
    distances_m: FloatArray

    def normals(self) -> FloatArray:
        """Unit normals, (2, n)."""
        return np.stack([np.cos(self.normals_rad), np.sin(self.normals_rad)])

    def along_m(self, poses: FloatArray) -> FloatArray:
        """Where the feet of the perpendiculars from poses are along each wall, (poses, n)."""
        x, y = self.normals()
        return np.asarray(poses[:, :2] @ np.stack([-y, x]))

    def faced(self, poses: FloatArray, half_angles_rad: FloatArray) -> BoolArray:
        """Whether the beams of poses hold those feet, (poses, n)."""
        off = np.abs(wrapped(self.normals_rad - poses[:, 2, np.newaxis]))
        return np.asarray(off < _WITHIN * half_angles_rad[:, np.newaxis])


class Heard(NamedTuple):
    """Which echoes are whose.

    Parameters
    ----------
    shares : (echoes, walls) array
        Of each wall in each echo.
    off_m : (echoes, walls) array
        By how much an echo is farther than the wall.
    log_likelihood : float
        Of all echoes, relative to none of them being a wall's.
    """

    shares: FloatArray
    off_m: FloatArray
    log_likelihood: float


def find_walls(echoes: Echoes, poses: FloatArray, wanted: BoolArray, sigma_m: float) -> Walls:
    """Lines that echoes of several places have in common, those of most echoes first.

    Parameters
    ----------
    echoes : Echoes
        Of all pings.
    poses : (pings, 3) array
        x, y (m) and yaw (rad).
    wanted : (pings,) bool array
        Whose echoes count.
    sigma_m : float
        How far ranges and poses are off.
    """
    rows = np.flatnonzero(wanted[echoes.ping])
    if not len(rows):
        return Walls(np.zeros(0), np.zeros(0))
    vote = _Votes(of_rows(echoes, rows), poses, sigma_m)
    found: list[tuple[float, float]] = []
    for _ in range(2 * _MOST):
        line = vote.next_line()
        if line is None or len(found) == _MOST:
            break
        if vote.take(*line):
            found.append(line)
    normals_rad, distances_m = np.array(found).reshape(-1, 2).T
    centre_m = vote.centre_m[0] * np.cos(normals_rad) + vote.centre_m[1] * np.sin(normals_rad)
    return Walls(normals_rad, distances_m + centre_m)


class _Votes:
    """Votes of echoes for lines, about the centre of the poses."""

    def __init__(self, echoes: Echoes, poses: FloatArray, sigma_m: float) -> None:
        self.centre_m = poses[:, :2].mean(axis=0)
        self._weight, self._sigma_m = echoes.weight, sigma_m
        self._range_m, self._reach = echoes.range_m, _WITHIN * echoes.half_angle_rad
        self._place_m = poses[echoes.ping, :2] - self.centre_m
        self._yaw = poses[echoes.ping, 2]
        self._step_m = max(_STEP_M, sigma_m)
        self._left = np.ones(len(self._yaw), np.bool_)
        angles = np.arange(_DIRECTIONS) * 2.0 * np.pi / _DIRECTIONS
        echo, direction = np.nonzero(
            np.abs(wrapped(angles - self._yaw[:, np.newaxis])) < self._reach[:, np.newaxis]
        )
        distance_m = (
            self._place_m[echo, 0] * np.cos(angles[direction])
            + self._place_m[echo, 1] * np.sin(angles[direction])
            + self._range_m[echo]
        )
        step = np.floor(distance_m / self._step_m).astype(np.int64)
        self._lowest = int(step.min(initial=0))
        # One more than there are, so that no direction's last one is beside the next one's first.
        self._steps = int(step.max(initial=0)) - self._lowest + 2
        cell = direction * self._steps + step - self._lowest
        # Most of the plane is empty where robots are far apart.
        self._cells, self._cell = np.unique(cell, return_inverse=True)
        self._echo, self._is_pair = echo, np.diff(self._cells, append=-1) == 1
        # First of each echo's votes, and the end.
        self._first = np.searchsorted(echo, np.arange(len(self._yaw) + 1))
        self._counts = self._counted(np.arange(len(echo)))

    def _counted(self, votes: np.ndarray) -> FloatArray:
        weights = self._weight[self._echo[votes]]
        return np.asarray(np.bincount(self._cell[votes], weights, len(self._cells)))

    def next_line(self) -> tuple[float, float] | None:
        """The line that most echoes vote for that are left: its normal, and its distance."""
        both = self._counts + self._is_pair * np.roll(self._counts, -1)
        best = int(np.argmax(both)) if len(both) else 0
        if not len(both) or both[best] < _LEAST_ECHOES:
            return None
        direction, step = divmod(int(self._cells[best]), self._steps)
        angle = direction * 2.0 * np.pi / _DIRECTIONS
        return self._fitted(angle, (self._lowest + step + 1) * self._step_m)

    def _off_m(self, angle: float, distance_m: float) -> FloatArray:
        """By how much echoes are farther than a line; infinite where they cannot be its."""
        along = self._place_m @ np.array([math.cos(angle), math.sin(angle)])
        is_its = self._left & (np.abs(wrapped(angle - self._yaw)) < self._reach)
        return np.where(is_its, along + self._range_m - distance_m, np.inf)

    def _fitted(self, angle: float, distance_m: float) -> tuple[float, float]:
        """A line through what is near it, by least squares."""
        scale_m = max(self._step_m, self._sigma_m)
        for _ in range(4):
            off_m = self._off_m(angle, distance_m)
            near = np.flatnonzero(np.abs(off_m) < 3.0 * scale_m)
            weight = self._weight[near] * np.exp(-0.5 * (off_m[near] / scale_m) ** 2)
            if weight.sum() < 1e-3:
                break
            tangent = np.array([-math.sin(angle), math.cos(angle)])
            change = np.stack([self._place_m[near] @ tangent, -np.ones(len(near))], axis=-1)
            prior = np.diag([(self._sigma_m / _PEAK_RAD) ** 2, 1e-6])
            matrix = (change * weight[:, np.newaxis]).T @ change + prior
            turn, shift_m = np.linalg.solve(matrix, -change.T @ (weight * off_m[near]))
            angle += float(np.clip(turn, -_MOST_TURN_RAD, _MOST_TURN_RAD))
            distance_m += float(shift_m)
            scale_m = self._sigma_m
        return angle, distance_m

    def take(self, angle: float, distance_m: float) -> bool:
        """Take the votes of a line's echoes out; whether there are enough of them for a wall."""
        off_m = np.abs(self._off_m(angle, distance_m))
        hits = np.flatnonzero(off_m < 2.0 * self._sigma_m)
        tangent = np.array([-math.sin(angle), math.cos(angle)])
        places = np.unique(np.floor(self._place_m[hits] @ tangent / 0.1))
        gone = np.flatnonzero(off_m < 2.0 * max(self._step_m, self._sigma_m))
        self._left[gone] = False
        if len(gone):
            spans = [np.arange(self._first[echo], self._first[echo + 1]) for echo in gone]
            self._counts -= self._counted(np.concatenate(spans))
        else:
            # Nothing is near what was fitted: nobody may vote for that peak again.
            self._counts[int(np.argmax(self._counts))] = 0.0
        is_enough = self._weight[hits].sum() >= _LEAST_ECHOES
        return bool(is_enough and len(places) >= _LEAST_PLACES)


def share_out(
    echoes: Echoes, poses: FloatArray, wanted: BoolArray, walls: Walls, sigma_m: float
) -> Heard:
    """Say which echoes come from which wall, by how often each stretch of it is heard.

    Parameters
    ----------
    echoes, poses, wanted, sigma_m
        As of `find_walls`.
    walls : Walls
        Lines.
    """
    pings, count = len(poses), len(walls.normals_rad)
    half_angles_rad, looks = np.zeros(pings), np.zeros(pings)
    half_angles_rad[echoes.ping], looks[echoes.ping] = echoes.half_angle_rad, echoes.weight
    faced = walls.faced(poses, half_angles_rad) & wanted[:, np.newaxis]
    off_m = poses[echoes.ping, :2] @ walls.normals() - walls.distances_m
    off_m += echoes.range_m[:, np.newaxis]
    peak = 1.0 / (math.sqrt(2.0 * math.pi) * sigma_m)
    density = peak * np.exp(-0.5 * (off_m / sigma_m) ** 2) * faced[echoes.ping]
    stretch = np.floor(walls.along_m(poses) / _STRETCH_M).astype(np.int64)
    stretch -= stretch.min(initial=0)
    shape = int(stretch.max(initial=0)) + 1, count
    cell = stretch * count + np.arange(count)
    asked = _by_stretch(cell, faced * looks[:, np.newaxis], shape)
    rate: FloatArray = np.full(shape, _FIRST_RATE)
    for _ in range(_ROUNDS):
        shares, _ = _shares(rate.ravel()[cell[echoes.ping]] * density)
        heard = _by_stretch(cell[echoes.ping], shares * echoes.weight[:, np.newaxis], shape)
        rate = (heard + _LEAST_RATE * _PRIOR_LOOKS) / (asked + _PRIOR_LOOKS)
    shares, evidence = _shares(rate.ravel()[cell[echoes.ping]] * density)
    return Heard(shares, off_m, float(echoes.weight @ np.log(evidence / _BACKGROUND)))


def _shares(density: FloatArray) -> tuple[FloatArray, FloatArray]:
    """What part of each echo is whose, and how likely it is in all."""
    evidence = density.sum(axis=1) + _BACKGROUND
    return density / evidence[:, np.newaxis], evidence


def _by_stretch(cell: np.ndarray, values: FloatArray, shape: tuple[int, int]) -> FloatArray:
    """Sums by stretches of walls, half of the neighbours' among them."""
    counts = np.bincount(cell.ravel(), values.ravel(), shape[0] * shape[1])
    own = np.asarray(counts, float).reshape(shape)
    around = np.pad(own, ((1, 1), (0, 0)))
    return np.asarray(own + 0.5 * (around[:-2] + around[2:]))
