"""Places that several pings hear, as unknowns that are eliminated: compiled.

The normal equations of poses and landmarks together are those of bundle adjustment; landmarks do
not know one another, so that each is eliminated by itself (Schur complement; Triggs et al. 2000).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.localisation.arcs import Pulls
from usmap_ros.localisation.echo_table import Echoes
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.compiled import compiled, compiled_within

#: Standard deviation with which a landmark is known beforehand to be where it seems to be, in
#: those of a range.
_FREEDOM = 3.0


class Knots(NamedTuple):
    """Where pings are between the knots of their tracks.

    Parameters
    ----------
    before : (pings,) int array
        The knot before each; -1: its pose is fixed.
    share : (pings,) array
        How far it is on the way to the next one.
    """

    before: NDArray[np.int64]
    share: FloatArray


class Equations(NamedTuple):
    """Normal equations of all knots.

    Parameters
    ----------
    matrix, right : (3 knots, 3 knots) and (3 knots,) arrays
        Left and right sides.
    sigma_m : float
        Standard deviation of a range.
    """

    matrix: FloatArray
    right: FloatArray
    sigma_m: float


class Work(NamedTuple):
    """How the knots that know a landmark depend on it."""

    coupling: FloatArray
    is_used: BoolArray
    used: NDArray[np.int64]


@compiled_within
def add_to_poses(
    equations: Equations,
    knots: NDArray[np.int64],
    parts: FloatArray,
    along: tuple[float, float],
    weight: float,
    residual_m: float,
) -> None:
    """Add a range's residual to the equations of the two knots that its ping lies between."""
    for first in range(2):
        at, part = 3 * knots[first], parts[first]
        for axis in range(2):
            equations.right[at + axis] += weight * along[axis] * part * residual_m
            for second in range(2):
                to = 3 * knots[second]
                for other in range(2):
                    equations.matrix[at + axis, to + other] += (
                        weight * along[axis] * along[other] * part * parts[second]
                    )


@compiled_within
def couple(work: Work, users: int, knot: int, along: tuple[float, float], weight: float) -> int:
    """Note how a knot and a landmark depend on each other; 1 if it is the first time."""
    for axis in range(2):
        for other in range(2):
            work.coupling[knot, axis, other] -= weight * along[axis] * along[other]
    if work.is_used[knot]:
        return 0
    work.is_used[knot], work.used[users] = True, knot
    return 1


@compiled_within
def gather(
    landmark: FloatArray,
    rows: NDArray[np.intp],
    pulls: Pulls,
    echoes: Echoes,
    poses: FloatArray,
    knots: Knots,
    equations: Equations,
    work: Work,
) -> int:
    """Add the residuals of one landmark; how many knots know it."""
    pair, parts, users = np.zeros(2, np.int64), np.zeros(2), 0
    last = len(equations.right) // 3 - 1
    for row in rows:
        echo = pulls.echo[row]
        ping = echoes.ping[echo]
        off_x, off_y = landmark[0] - poses[ping, 0], landmark[1] - poses[ping, 1]
        distance_m = math.sqrt(off_x * off_x + off_y * off_y) + 1e-9
        along = (off_x / distance_m, off_y / distance_m)
        residual_m = distance_m - echoes.range_m[echo]
        weight = pulls.weight[row] / equations.sigma_m**2
        for axis in range(2):
            landmark[2 + axis] -= weight * along[axis] * residual_m
            landmark[4 + axis] += weight * along[axis] * along[axis]
        landmark[6] += weight * along[0] * along[1]
        if knots.before[ping] < 0:
            continue
        pair[0], pair[1] = knots.before[ping], min(knots.before[ping] + 1, last)
        parts[0], parts[1] = 1.0 - knots.share[ping], knots.share[ping]
        add_to_poses(equations, pair, parts, along, weight, residual_m)
        for side in range(2):
            if parts[side] > 0.0:
                users += couple(work, users, pair[side], along, weight * parts[side])
    return users


@compiled_within
def reduce(landmark: FloatArray, users: int, equations: Equations, work: Work) -> None:
    """Eliminate a landmark from the equations of the knots that know it, and forget it."""
    xx, yy, xy = landmark[4], landmark[5], landmark[6]
    determinant = xx * yy - xy * xy
    for first in range(users):
        one = work.used[first]
        for axis in range(2):
            by_x = work.coupling[one, axis, 0] * yy - work.coupling[one, axis, 1] * xy
            by_y = work.coupling[one, axis, 1] * xx - work.coupling[one, axis, 0] * xy
            by_x, by_y = by_x / determinant, by_y / determinant
            equations.right[3 * one + axis] -= by_x * landmark[2] + by_y * landmark[3]
            for second in range(users):
                two = work.used[second]
                for other in range(2):
                    equations.matrix[3 * one + axis, 3 * two + other] -= (
                        by_x * work.coupling[two, other, 0] + by_y * work.coupling[two, other, 1]
                    )
    for first in range(users):
        work.is_used[work.used[first]] = False
        work.coupling[work.used[first]] = 0.0


@compiled
def eliminate(
    pulls: Pulls,
    order: NDArray[np.intp],
    echoes: Echoes,
    poses: FloatArray,
    knots: Knots,
    equations: Equations,
) -> None:
    """Add what all echoes say to the normal equations of the knots, landmarks eliminated.

    Parameters
    ----------
    pulls : Pulls
        Which echo is drawn to which place.
    order : (n,) int array
        Rows of `pulls`, those of one place together.
    echoes : Echoes
        All echoes.
    poses : (pings, 3) array
        x, y (m) and yaw (rad).
    knots : Knots
        Between which knots each ping is.
    equations : Equations
        Of the knots; added to.
    """
    count = len(equations.right) // 3
    work = Work(np.zeros((count, 2, 2)), np.zeros(count, np.bool_), np.zeros(count, np.int64))
    # x, y; right-hand sides; xx, yy and xy of its own equations.
    landmark, start = np.zeros(7), 0
    known = 1.0 / (_FREEDOM * equations.sigma_m) ** 2
    while start < len(order):
        end, total = start, 0.0
        landmark[:] = 0.0
        while end < len(order) and pulls.cell[order[end]] == pulls.cell[order[start]]:
            row = order[end]
            total += pulls.weight[row]
            landmark[0] += pulls.weight[row] * pulls.x_m[row]
            landmark[1] += pulls.weight[row] * pulls.y_m[row]
            end += 1
        landmark[0], landmark[1] = landmark[0] / total, landmark[1] / total
        landmark[4], landmark[5] = known, known
        users = gather(landmark, order[start:end], pulls, echoes, poses, knots, equations, work)
        reduce(landmark, users, equations, work)
        start = end
