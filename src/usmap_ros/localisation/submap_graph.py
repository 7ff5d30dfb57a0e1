"""Ways of robots brought in line by what their submaps have in common: a pose graph.

Unknowns are poses some tens of pings apart, the knots of each way.  Edges are changes from one to
the next as the robot has them, weighed by what odometry states, and where two submaps lie over each
other, of one robot or of two.  An edge that does not fit the others pulls little (Cauchy's kernel,
by iteratively reweighted least squares), so one that is wrong bends nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from usmap_ros.localisation.equations import add_chain, solve
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
#: The square of the Mahalanobis distance at which an edge counts half, and steps of Gauss-Newton.
_HALF, _STEPS = 3.0, 10


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
    for _ in range(_STEPS):
        matrix, right = np.zeros((knots.size, knots.size)), np.zeros(knots.size)
        for number, track in enumerate(tracks):
            own = knots[first[number] : first[number + 1]]
            add_chain(track, own, matrix, right, 3 * int(first[number]))
        for edge in edges:
            ends = (first[edge.one[0]] + edge.one[1], first[edge.other[0]] + edge.other[1])
            _add(edge, (int(ends[0]), int(ends[1])), knots, matrix, right)
        knots = knots + solve(matrix, right)[0]
        knots[:, 2] = wrapped(knots[:, 2])
    return [
        track.poses(knots[first[number] : first[number + 1]]) for number, track in enumerate(tracks)
    ]


def _add(
    edge: Edge, ends: tuple[int, int], knots: FloatArray, matrix: FloatArray, right: FloatArray
) -> None:
    """Add an edge between two of the knots to the equations of all."""
    one, other = knots[ends[0]], knots[ends[1]]
    error = between(one, other) - edge.seen
    error[2] = wrapped(error[2])
    weight = _KNOWN**-2 / (1.0 + float(np.sum((error / _KNOWN) ** 2)) / _HALF)
    change = derivatives(one, other)
    at = np.concatenate([3 * end + np.arange(3) for end in ends])
    matrix[np.ix_(at, at)] += change.T @ (weight[:, np.newaxis] * change)
    right[at] -= change.T @ (weight * error)


def _nearest(track: Track, ping: int) -> int:
    """The knot that is nearest to a ping."""
    return int(np.argmin(np.abs(track.knots - ping)))
