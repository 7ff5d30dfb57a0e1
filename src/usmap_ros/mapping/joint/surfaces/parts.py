"""Parts of a place that answer differently, as rooms of glass do beside rooms of brick.

Rough walls return far more than smooth ones: beside them the mirrors of a whole place are too faint
to be any.  Where what pings hear changes much from one side of a line to the other, each side may
have mirrors of its own.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.surfaces.mirror_walls import mirror_walls
from usmap_ros.mapping.joint.surfaces.mirrors import MirrorWall
from usmap_ros.mapping.joint.visibility.echoes import Echoes, mirror_levels
from usmap_ros.mapping.ping_table import ABSORPTION, PingTable, X, Y
from usmap_ros.numerics.arrays import BoolArray, FloatArray

#: How often a place is cut at the most; and directions of cuts.
CUTS, DIRECTIONS = 2, 12
#: Pings on either side at least, and share of the variance of how loud their loudest echoes are, by
#: rank, that a cut explains: 0.3 to 0.5 between rough and smooth rooms, less than 0.15 in 28
#: recordings of places of one kind.
LEAST_PINGS, LEAST_EXPLAINED = 60, 0.25
#: Cuts that explain so much less than the best one are as good, and the one that is farthest from
#: all pings is taken; so near to those on the other side a part begins, as a share of the way.
AS_GOOD, APART = 0.03, 0.01


class PartOfPlace(NamedTuple):
    """A convex part of the plane: all places p with n·p ≤ d for each of its edges."""

    #: (edges, 3) array: unit normals n, and d, m.
    edges: FloatArray

    def holds(self, points_m: FloatArray) -> BoolArray:
        """Which of some (points, 2) places are in it."""
        inside = points_m @ self.edges[:, :2].T <= self.edges[:, 2]
        return np.asarray(inside.all(axis=-1))

    def beside(self, normal: FloatArray, low_m: float, high_m: float) -> "list[PartOfPlace]":
        """What of it is on either side of a strip across a direction, with the strip."""
        edges = np.array([[*normal, high_m], [*-normal, -low_m]])
        return [PartOfPlace(np.concatenate([self.edges, edge[np.newaxis]])) for edge in edges]


#: All of a place.
ALL = PartOfPlace(np.zeros((0, 3)))


def any_holds(parts: list[PartOfPlace], points_m: FloatArray) -> BoolArray:
    """Which of some (points, 2) places are in any of some parts."""
    inside: BoolArray = np.any([part.holds(points_m) for part in parts], axis=0)
    return inside


def mirrors_of_parts(
    table: PingTable,
    pings: NDArray[np.int64],
    echoes: Echoes,
    is_explained: BoolArray,
    is_usable: BoolArray,
    first_only: BoolArray,
) -> tuple[list[MirrorWall], list[PartOfPlace]]:
    """Mirrors of a place or, if it seems to have none, of parts that hear otherwise, and which.

    Parameters
    ----------
    table, pings, echoes, is_explained, is_usable, first_only
        As in `usmap_ros.mapping.joint.surfaces.mirror_walls.mirror_walls`.

    Returns
    -------
    found : list of MirrorWall
        The mirrors.
    mirrored : list of PartOfPlace
        Parts that they are in; none if they are of all of the place.  Where none were found on
        either side of a cut, the quieter side: its mirrors may be too few to tell.
    """
    found = mirror_walls(table, pings, echoes, is_explained, is_usable, first_only)
    if found:
        return found, []
    places_m, loudest = table.numbers[pings][:, [X, Y]], _loudest(table, pings, echoes)
    mirrored, others, cut = list[PartOfPlace](), [ALL], list[PartOfPlace]()
    for _ in range(CUTS):
        tried = [half for part in others for half in halves(part, places_m, loudest)]
        cut = cut or tried
        others = []
        for half in tried:
            here = np.repeat(half.holds(places_m), np.diff(echoes.start))
            own = mirror_walls(
                table, pings, echoes, is_explained | ~here, is_usable & here, first_only
            )
            found += own
            (mirrored if own else others).append(half)
    if cut and not found:
        mirrored = [min(cut, key=lambda half: float(np.median(loudest[half.holds(places_m)])))]
    return found, mirrored


def _loudest(table: PingTable, pings: NDArray[np.int64], echoes: Echoes) -> FloatArray:
    """How loud the loudest echo of each ping is, as a mirror's; 0 without any."""
    ping = np.repeat(np.arange(len(pings)), np.diff(echoes.start))
    loudest = np.zeros(len(pings))
    levels = mirror_levels(echoes, table.numbers[pings[ping], ABSORPTION])
    np.maximum.at(loudest, ping, levels)
    return loudest


def halves(part: PartOfPlace, places_m: FloatArray, loudest: FloatArray) -> list[PartOfPlace]:
    """What a part is cut into where its pings' loudest echoes change most; nothing if little.

    A step of a regression tree, by ranks, since how loud echoes are varies by orders of magnitude.
    Nobody knows where between the pings on either side the place changes: that is of both halves.

    Parameters
    ----------
    part : PartOfPlace
        The part.
    places_m : (pings, 2) array
        Where pings were sent.
    loudest : (pings,) array
        How loud the loudest echo of each is; 0 without any.
    """
    heard = part.holds(places_m) & (loudest > 0.0)
    places_m, loudest = places_m[heard], loudest[heard]
    count = len(places_m)
    if count < 2 * LEAST_PINGS:
        return []
    rank = np.argsort(np.argsort(loudest, kind="stable"))
    angles_rad = np.arange(DIRECTIONS) * np.pi / DIRECTIONS
    normals = np.stack([np.cos(angles_rad), np.sin(angles_rad)])
    along_m = places_m @ normals
    order = np.argsort(along_m, axis=0, kind="stable")
    along_m = np.take_along_axis(along_m, order, axis=0)
    splits = np.arange(LEAST_PINGS, count - LEAST_PINGS + 1)
    lower, upper = along_m[splits - 1], along_m[splits]
    below, sums = splits[:, np.newaxis], np.cumsum(rank[order], axis=0)[splits - 1]
    apart = sums / below - (rank.sum() - sums) / (count - below)
    explained = below * (count - below) / count**2 * apart**2 / rank.var()
    explained[upper <= lower] = 0.0
    if explained.max() <= LEAST_EXPLAINED:
        return []
    gaps_m = np.where(explained >= explained.max() - AS_GOOD, upper - lower, 0.0)
    at, way = np.unravel_index(int(np.argmax(gaps_m)), gaps_m.shape)
    beside_m = APART * float(gaps_m[at, way])
    return part.beside(
        normals[:, way], float(lower[at, way]) + beside_m, float(upper[at, way]) - beside_m
    )
