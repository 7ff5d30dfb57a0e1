"""Ways of robots brought in line by what their submaps have in common: a pose graph.

Unknowns are poses some tens of pings apart, the knots of each way.  Edges are changes from one to
the next as the robot has them, weighed by what odometry states, and where two submaps lie over each
other, of one robot or of two.  An edge that does not fit the others pulls little (Cauchy's kernel,
by iteratively reweighted least squares), so one that is wrong bends nothing.

Each edge is of two knots, so the equations are sparse.  They are solved by conjugate gradients,
preconditioned by what stands of them without the loops that ways close (a subgraph: Dellaert,
Carlson, Ila, Ni & Thorpe, IROS 2010), which takes little memory, and little time from a start that
is nearly right.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.sparse.linalg import LinearOperator, cg

from usmap_ros.localisation.equations import chain_blocks, start_error
from usmap_ros.localisation.planar import between, compose, derivatives
from usmap_ros.localisation.submap import Submap, counts, refined
from usmap_ros.localisation.tracks import Track
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.geometry import wrapped

#: How far a submap may lie from where it is thought to, and how well it is known then: x, y (m) and
#: yaw (rad), standard deviations.
_WITHIN = np.array([0.2, 0.2, math.radians(6.0)])
_KNOWN = np.array([0.07, 0.07, math.radians(2.0)])
#: Pieces in common from which on two submaps make an edge.
_LEAST_PIECES = 3.0
#: The square of the Mahalanobis distance at which an edge counts half.
_HALF = 3.0
#: Steps of Gauss-Newton at the most, and the change, m or rad, after which there is no further one;
#: steps of conjugate gradients in each, at the most.
_STEPS, _SETTLED, _MOST_STEPS = 10, 1e-4, 3000


class PlacedSubmap(NamedTuple):
    """A submap, and where it is taken to be."""

    #: What it shows, in a frame of its own.
    submap: Submap
    #: (3,) array: of that frame in the one of all ways.
    change: FloatArray
    #: Which way it is of, and which ping of that is in its middle.
    way: int
    middle: int


class Edge(NamedTuple):
    """How a knot lies as seen from another one."""

    #: Each the number of a way, and of a knot of it.
    one: tuple[int, int]
    other: tuple[int, int]
    #: (3,) array: the other's pose.
    seen: FloatArray


def edges_between(tracks: Sequence[Track], submaps: Sequence[PlacedSubmap]) -> list[Edge]:
    """Where submaps lie over each other.

    Parameters
    ----------
    tracks : sequence of Track
        Ways as robots have them, in one frame.
    submaps : sequence of PlacedSubmap
        Of these, in the order of each.
    """
    found = []
    for (number, one), (then, other) in combinations(enumerate(submaps), 2):
        # What follows each other on one way is in line by odometry.
        if one.way == other.way and then == number + 1:
            continue
        if not (len(one.submap.places_m) and len(other.submap.places_m)):
            continue
        change = compose(between(one.change, np.zeros(3)), other.change)
        if not any(counts(one.submap, other.submap, change)):
            continue
        pieces, there = refined(one.submap, other.submap, change, _WITHIN)
        if pieces < _LEAST_PIECES:
            continue
        first, second = (_nearest(tracks[each.way], each.middle) for each in (one, other))
        # By how much the other submap is moved in the frame of all ways.
        moved = compose(compose(one.change, there), between(other.change, np.zeros(3)))
        start = tracks[one.way].told[tracks[one.way].knots[first]]
        end = tracks[other.way].told[tracks[other.way].knots[second]]
        seen = between(start, compose(moved, end))
        found.append(Edge((one.way, first), (other.way, second), seen))
    return found


def in_line(tracks: Sequence[Track], edges: Sequence[Edge]) -> list[FloatArray]:
    """Poses of all pings of each way that odometry and edges make most likely.

    Parameters
    ----------
    tracks : sequence of Track
        Ways as robots have them, in one frame.
    edges : sequence of Edge
        Between their knots.

    Returns
    -------
    list of (n, 3) array
        x, y (m) and yaw (rad).
    """
    first = np.cumsum([0, *(len(track.knots) for track in tracks)])
    knots = np.concatenate([track.told[track.knots] for track in tracks])
    ends = np.array([[first[w] + k for w, k in (e.one, e.other)] for e in edges], np.intp)
    ends, seen = ends.reshape(-1, 2), np.array([edge.seen for edge in edges]).reshape(-1, 3)
    for _ in range(_STEPS):
        parts = [_edge_equations(knots, ends, seen)]
        for number, track in enumerate(tracks):
            own = slice(first[number], first[number + 1])
            parts += _odometry_equations(track, knots[own], int(first[number]))
        change = _solved(parts, len(knots))
        knots = knots + change
        knots[:, 2] = wrapped(knots[:, 2])
        if np.abs(change).max() < _SETTLED:
            break
    return [
        track.poses(knots[first[number] : first[number + 1]]) for number, track in enumerate(tracks)
    ]


class _Equations(NamedTuple):
    """Normal equations of some knots each."""

    #: (n, k) int array: of which knots.
    knots: NDArray[np.intp]
    #: (n, 3 k, 3 k) and (n, 3 k) arrays: both sides.
    matrix: FloatArray
    right: FloatArray


def _edge_equations(knots: FloatArray, ends: NDArray[np.intp], seen: FloatArray) -> _Equations:
    """What submaps say that lie over each other."""
    one, other = knots[ends[:, 0]], knots[ends[:, 1]]
    error = between(one, other) - seen
    error[:, 2] = wrapped(error[:, 2])
    far = np.sum((error / _KNOWN) ** 2, axis=1, keepdims=True)
    weight = _KNOWN**-2 / (1.0 + far / _HALF)
    change = derivatives(one, other)
    weighed = np.swapaxes(change * weight[:, :, np.newaxis], 1, 2)
    return _Equations(ends, weighed @ change, -np.einsum("nij,nj->ni", weighed, error))


def _odometry_equations(track: Track, knots: FloatArray, first: int) -> list[_Equations]:
    """What odometry and the start say of a way whose first knot is of that number."""
    numbers = first + np.arange(len(knots))
    known = track.start_information()
    pull = -known @ start_error(track, knots)
    return [
        _Equations(np.stack([numbers[:-1], numbers[1:]], axis=1), *chain_blocks(track, knots)),
        _Equations(numbers[:1, np.newaxis], known[np.newaxis], pull[np.newaxis]),
    ]


def _solved(parts: Sequence[_Equations], count: int) -> FloatArray:
    """Changes of all knots, (count, 3), that equations ask for together."""
    rows, columns, values, right = [], [], [], np.zeros(3 * count)
    for part in parts:
        at = (3 * part.knots[:, :, np.newaxis] + np.arange(3)).reshape(part.right.shape)
        rows.append(np.broadcast_to(at[:, :, np.newaxis], part.matrix.shape).ravel())
        columns.append(np.broadcast_to(at[:, np.newaxis], part.matrix.shape).ravel())
        values.append(part.matrix.ravel())
        np.add.at(right, at, part.right)
    places = np.concatenate(rows), np.concatenate(columns)
    matrix = sparse.csr_matrix((np.concatenate(values), places), (3 * count, 3 * count))
    without_loops = LinearOperator(matrix.shape, matvec=_without_loops(matrix), dtype=float)
    change, _ = cg(matrix, right, maxiter=_MOST_STEPS, M=without_loops)
    return np.asarray(change).reshape(-1, 3)


def _without_loops(matrix: sparse.csr_matrix) -> Callable[[FloatArray], FloatArray]:
    """Solve equations of which only what knots say that follow one another is kept."""
    every = matrix.tocoo()
    kept = (every.row >= every.col) & (every.row // 3 - every.col // 3 <= 1)
    band = np.zeros((6, matrix.shape[0]))
    band[every.row[kept] - every.col[kept], every.col[kept]] = every.data[kept]
    factor = cholesky_banded(band, lower=True)
    return lambda right: np.asarray(cho_solve_banded((factor, True), right))


def _nearest(track: Track, ping: int) -> int:
    """The knot that is nearest to a ping."""
    return int(np.argmin(np.abs(track.knots - ping)))
