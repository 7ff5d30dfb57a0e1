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
from numpy.typing import NDArray

from usmap_ros.localisation.echo_table import Echoes, of_rows
from usmap_ros.localisation.line_fits import Bearers, fit_line, put_on_line
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.geometry import wrapped

#: Directions of normals that are voted for, and least width of a step of distance, m.
_DIRECTIONS, _STEP_M = 120, 0.04
#: Walls at the most, echoes that each must explain, and places, a decimetre apart, that its feet
#: must have: one place is as well a point's.
_MOST, _LEAST_ECHOES, _LEAST_PLACES = 200, 5.0, 4
#: Share of the half angle within which the foot must be.
_WITHIN = 0.95
#: Echoes per metre of range that no wall explains.
_BACKGROUND = 0.6
#: Stretch of a wall, m, of which it is asked how many of the pings that face it hear it; what is
#: thought of that beforehand, and how many looks outweigh it.
_STRETCH_M, _LEAST_RATE, _FIRST_RATE, _PRIOR_LOOKS = 0.3, 0.05, 0.3, 2.0
#: Of a stretch, the most that it is taken to be heard where a look goes through.
_MOST_RATE = 0.9
#: How well the edge of a beam is known, rad.
_EDGE_RAD = 0.05
#: Ranges and poses that are off by so much at the most, m, tell walls whose echoes scatter less;
#: echoes that outweigh what is thought of that beforehand; and the least of their variance.
_TELLING_M, _USUAL_ECHOES, _LEAST_SCATTER = 0.025, 10.0, 0.1
#: Echoes farther from a wall, standard deviations, are not its.
_REACH = 5.0
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


class Looks(NamedTuple):
    """How pings would hear walls, (pings, walls) each.

    Parameters
    ----------
    faced : bool array
        Whether the ping may hear the wall at all.
    far_m : array
        Distance along the perpendicular.
    aslant_rad : array
        From the perpendicular to where the wall is heard from, positive to the left.
    along_m : array
        Where that is along the wall.
    """

    faced: BoolArray
    far_m: FloatArray
    aslant_rad: FloatArray
    along_m: FloatArray


def look(walls: Walls, echoes: Echoes, poses: FloatArray) -> Looks:
    """Where pings would hear walls: at the foot of the perpendicular, or at the beam's edge."""
    half_rad, most_rad = np.zeros((2, len(poses), 1))
    half_rad[echoes.ping, 0], most_rad[echoes.ping, 0] = echoes.half_angle_rad, echoes.aslant_rad
    off_rad = wrapped(walls.normals_rad - poses[:, 2, np.newaxis])
    beyond_rad = np.maximum(np.abs(off_rad) - _WITHIN * half_rad, 0.0)
    normals = walls.normals()
    far_m = np.maximum(walls.distances_m - poses[:, :2] @ normals, 0.0)
    faced = (beyond_rad <= most_rad) & (half_rad > 0.0)
    aslant_rad = -np.sign(off_rad) * beyond_rad * faced
    along_m = poses[:, :2] @ np.stack([-normals[1], normals[0]]) + far_m * np.tan(aslant_rad)
    return Looks(faced, far_m, aslant_rad, along_m)


class Heard(NamedTuple):
    """Which echoes are whose: a row for each echo and each wall that it may well be of.

    Parameters
    ----------
    echo, wall : (n,) int arrays
        Which.
    shares : (n,) array
        Of the wall in the echo.
    off_m : (n,) array
        By how much the place that the echo would be from is behind the wall.
    along_m, per_rad_m : (n,) arrays
        Where that is along the wall, and by how much it goes behind it as the robot turns.
    precision : (n,) array
        Of `off_m`, in units of that of an echo from the foot of the perpendicular.
    log_likelihood : float
        Of all echoes, relative to none of them being a wall's.
    """

    echo: NDArray[np.intp]
    wall: NDArray[np.intp]
    shares: FloatArray
    off_m: FloatArray
    along_m: FloatArray
    per_rad_m: FloatArray
    precision: FloatArray
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
        self._yaw, self._aslant = poses[echoes.ping, 2], echoes.aslant_rad
        x_m, y_m = np.ascontiguousarray(self._place_m.T)
        self._rows = Bearers(
            x_m, y_m, self._yaw, self._range_m, self._reach, self._aslant, self._weight
        )
        self._step_m = max(_STEP_M, sigma_m)
        self._left = np.ones(len(self._yaw), np.bool_)
        angles = np.arange(_DIRECTIONS) * 2.0 * np.pi / _DIRECTIONS
        echo, direction = np.nonzero(
            np.abs(wrapped(angles - self._yaw[:, np.newaxis]))
            <= (self._reach + self._aslant)[:, np.newaxis]
        )
        place_m = self._place_m[echo] + self._to_place_m(angles[direction], echo)
        distance_m = place_m[:, 0] * np.cos(angles[direction]) + place_m[:, 1] * np.sin(
            angles[direction]
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
        distance_m = (self._lowest + step + 1) * self._step_m
        return fit_line(self._rows, self._left, (angle, distance_m), self._step_m, self._sigma_m)

    def _to_place_m(self, angle: FloatArray, echo: np.ndarray) -> FloatArray:
        """From where echoes were heard to where walls that face so would answer from, (n, 2)."""
        off_rad = wrapped(angle - self._yaw[echo])
        inside = np.clip(off_rad, -self._reach[echo], self._reach[echo])
        heading = self._yaw[echo] + inside
        rays = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
        return np.asarray(self._range_m[echo, np.newaxis] * rays)

    def take(self, angle: float, distance_m: float) -> bool:
        """Take the votes of a line's echoes out; whether there are enough of them for a wall."""
        along_m, off_m = np.empty((2, len(self._yaw)))
        put_on_line(self._rows, self._left, angle, distance_m, along_m, off_m)
        off_m = np.abs(off_m)
        hits = np.flatnonzero(off_m < 2.0 * self._sigma_m)
        places = np.unique(np.floor(along_m[hits] / 0.1))
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
    count, seen, ping = len(walls.normals_rad), look(walls, echoes, poses), echoes.ping
    aslant_rad = seen.aslant_rad[ping]
    cosine, per_rad_m = np.cos(aslant_rad), -echoes.range_m[:, np.newaxis] * np.sin(aslant_rad)
    off_m = echoes.range_m[:, np.newaxis] * cosine - seen.far_m[ping]
    std_m = np.hypot(sigma_m * cosine, per_rad_m * _EDGE_RAD)
    is_its = seen.faced[ping] & wanted[ping, np.newaxis]
    echo, wall = rows = np.nonzero(is_its & (np.abs(off_m) < _REACH * std_m))
    apart, facing, tight = off_m[rows] / std_m[rows], cosine[rows] / std_m[rows], np.ones(count)
    stretch = np.floor(seen.along_m / _STRETCH_M).astype(np.int64)
    stretch -= stretch.min(initial=0)
    shape = int(stretch.max(initial=0)) + 1, count
    cells = stretch * count + np.arange(count)
    first_only = echoes.aslant_rad[:, np.newaxis] > 0.0
    hidden = np.zeros(seen.faced.shape, np.bool_)
    hidden[ping] = first_only & (off_m < -2.0 * std_m)
    looks = np.zeros(len(poses))
    looks[ping] = echoes.weight * wanted[ping]
    asked = _by_stretch(cells, (seen.faced & ~hidden) * looks[:, np.newaxis], shape)
    cell, rate = cells[ping[echo], wall], np.full(shape, _FIRST_RATE)
    for _ in range(_ROUNDS):
        density = _density(apart, tight[wall]) * facing
        shares, _ = _shares(echo, rate.ravel()[cell] * density, len(ping))
        heard = _by_stretch(cell, shares * echoes.weight[echo], shape)
        rate = (heard + _LEAST_RATE * _PRIOR_LOOKS) / (asked + _PRIOR_LOOKS)
        if sigma_m <= _TELLING_M:
            tight = _tightness(wall, shares, apart, count)
    density = _density(apart, tight[wall]) * facing
    shares, evidence = _shares(echo, rate.ravel()[cell] * density, len(ping))
    beyond, past = np.nonzero(first_only & seen.faced[ping] & (off_m > 3.0 * std_m))
    through = rate.ravel()[cells[ping[beyond], past]]
    likelihood = np.log(evidence / _BACKGROUND)
    likelihood += np.bincount(beyond, np.log1p(-np.minimum(through, _MOST_RATE)), len(ping))
    precision = (tight[wall] * sigma_m / std_m[rows]) ** 2
    return Heard(
        echo, wall, shares, off_m[rows], seen.along_m[ping[echo], wall], per_rad_m[rows],
        precision, float((echoes.weight * wanted[ping]) @ likelihood),
    )  # fmt: skip


def _density(apart: FloatArray, tight: FloatArray) -> FloatArray:
    """Density of echoes that are so many standard deviations off."""
    return np.asarray(tight * np.exp(-0.5 * (apart * tight) ** 2) / math.sqrt(2.0 * math.pi))


def _tightness(
    wall: NDArray[np.intp], shares: FloatArray, apart: FloatArray, count: int
) -> FloatArray:
    """By how much less than usual the echoes of each wall scatter, as a factor of 1 and more.

    Of what is no wall, but echoes in a row by chance, they scatter as widely as they may.
    """
    variance = np.bincount(wall, shares * apart**2, count) + _USUAL_ECHOES
    variance /= np.bincount(wall, shares, count) + _USUAL_ECHOES
    return np.asarray(1.0 / np.sqrt(np.clip(variance, _LEAST_SCATTER, 1.0)))


def _shares(echo: np.ndarray, density: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """What part of each echo is whose, and how likely each echo is in all."""
    evidence = np.asarray(np.bincount(echo, density, count), float) + _BACKGROUND
    return density / evidence[echo], evidence


def _by_stretch(cell: np.ndarray, values: FloatArray, shape: tuple[int, int]) -> FloatArray:
    """Sums by stretches of walls, half of the neighbours' among them."""
    counts = np.bincount(cell.ravel(), values.ravel(), shape[0] * shape[1])
    own = np.asarray(counts, float).reshape(shape)
    around = np.pad(own, ((1, 1), (0, 0)))
    return np.asarray(own + 0.5 * (around[:-2] + around[2:]))
