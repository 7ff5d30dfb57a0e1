"""Where a way lies in a map of others, piece by piece.

A map that odometry has bent, or a refinement that went astray, lies nowhere as a whole.  Pieces of
the way as odometry tells it are hardly bent: each is looked for all over the other map by itself,
and those before and after it are laid there one after the other, as far from where odometry has
them as it may be off (multiple hypotheses: Jensfelt & Kristensen, IEEE Trans. Robotics & Automation
2001).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from usmap_ros.localisation.map_match import ELSEWHERE_M, matches_of
from usmap_ros.localisation.submap import Submap, apart_m, refined
from usmap_ros.numerics.arrays import FloatArray

#: How far odometry may be off from one piece to the next: x, y (m) and yaw (rad), standard
#: deviations.
_HELD = np.array([0.15, 0.15, math.radians(5.0)])
#: Matches of each piece that are followed.
_FOLLOWED = 8


class WayMatch(NamedTuple):
    """How a way lies in a map."""

    #: What it counts, and how much less the best one elsewhere does, in units of the root of that.
    pieces: float
    margin: float
    #: The piece that was looked for all over the map.
    first: int
    #: (3,) arrays: of each piece's frame in the map's, x, y (m) and yaw (rad).
    changes: list[FloatArray]


def match_way(there: Submap, way: Sequence[Submap]) -> WayMatch | None:
    """How a way lies in a map; None if either shows nothing.

    Parameters
    ----------
    there : Submap
        The map.
    way : sequence of Submap
        Pieces of the way, one after the other, in the frame of its odometry.
    """
    if not len(there.places_m):
        return None
    shown = [number for number, piece in enumerate(way) if len(piece.places_m)]
    found = [
        _followed(there, way, number, change, pieces)
        for number in shown
        for pieces, change in matches_of(there, way[number])[:_FOLLOWED]
    ]
    if not found:
        return None
    best = max(found, key=lambda match: match.pieces)
    others = (one.pieces for one in found if _apart_m(way, best, one) > ELSEWHERE_M)
    lead = best.pieces - max([0.0, *others])
    return best._replace(margin=lead / math.sqrt(max(best.pieces, 1.0)))


def _followed(
    there: Submap, way: Sequence[Submap], first: int, change: FloatArray, pieces: float
) -> WayMatch:
    """A match of one piece, and what follows from it for those before and after it."""
    changes = [change] * len(way)
    for numbers in (range(first + 1, len(way)), range(first - 1, -1, -1)):
        last = change
        for number in numbers:
            if len(way[number].places_m):
                counted, last = refined(there, way[number], last, _HELD)
                pieces += counted
            changes[number] = last
    return WayMatch(pieces, 0.0, first, changes)


def _apart_m(way: Sequence[Submap], one: WayMatch, other: WayMatch) -> float:
    """How far two matches put what stands from each other, root mean square."""
    counts = np.array([len(piece.places_m) for piece in way])
    apart = np.array(
        [
            apart_m(piece.places_m, *changes) if len(piece.places_m) else 0.0
            for piece, *changes in zip(way, one.changes, other.changes, strict=True)
        ]
    )
    return math.sqrt(float(counts @ apart**2) / counts.sum())
