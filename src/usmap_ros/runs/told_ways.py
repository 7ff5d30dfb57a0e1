"""Frames related by the way of one robot, as odometry tells it, in the map of the other frame.

Once a robot's poses are refined to what they are not, no map of them lies over any other.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from usmap_ros.grids import OccupancyMap
from usmap_ros.localisation.planar import between, compose
from usmap_ros.localisation.submap import Submap
from usmap_ros.localisation.way_match import match_way
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.runs.moved_pings import PingsOfFrame
from usmap_ros.runs.submaps import Way

#: What a way must have in common with a map, in pieces, and by what margin over what lies
#: elsewhere, for a second look.
_LEAST_PIECES, _LEAST_MARGIN = 12.0, 2.5


class WayInMap(NamedTuple):
    """How two frames relate by a way of one in the other's map."""

    #: As of `way_match.WayMatch`.
    margin: float
    #: (3,) array: pose of the source's frame in the target's, x, y (m) and yaw (rad).
    change: FloatArray
    #: (2,) array: in the source: what the match is off, it is off there.
    about_m: FloatArray
    #: Of both; the one whose way it is with poses as told, and pieces where the other map has them.
    target: PingsOfFrame
    source: PingsOfFrame


def way_in_map(
    pings: Sequence[PingsOfFrame], maps: Sequence[OccupancyMap], ways: Sequence[Way]
) -> WayInMap | None:
    """How two frames relate by the better of their ways in the other's map, if one is promising.

    Parameters
    ----------
    pings, maps : sequences of PingsOfFrame and of OccupancyMap
        Of the target and of the source.
    ways : sequence of list of Piece
        Of either as odometry tells it; empty: it is not asked.
    """
    of_source = _lies(pings[1], Submap.of(maps[0]), ways[1])
    of_target = _lies(pings[0], Submap.of(maps[1]), ways[0])
    if of_target and not (of_source and of_source[0] >= of_target[0]):
        margin, change, about_m, bent = of_target
        there = compose(change, np.append(about_m, 0.0))
        return WayInMap(margin, between(change, np.zeros(3)), there[:2], bent, pings[1])
    if of_source:
        margin, change, about_m, bent = of_source
        return WayInMap(margin, change, about_m, pings[0], bent)
    return None


def _lies(
    pings: PingsOfFrame, there: Submap, way: Way
) -> tuple[float, FloatArray, FloatArray, PingsOfFrame] | None:
    """The margin, where the frame lies in a map and about what, and its pings as told."""
    found = match_way(there, [piece.submap for piece in way])
    if found is None or found.pieces < _LEAST_PIECES or found.margin < _LEAST_MARGIN:
        return None
    change = found.changes[found.first]
    bent = [
        piece._replace(change=between(change, own))
        for piece, own in zip(way, found.changes, strict=True)
    ]
    about_m = way[found.first].submap.centre_m
    return found.margin, change, about_m, PingsOfFrame(pings.told, pings.told, [bent])
