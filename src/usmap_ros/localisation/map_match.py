"""Two robots' maps laid over each other, where nobody knows how their frames relate.

Correlative matching (Olson, ICRA 2009) over all turns, and over all shifts at once by Fourier
transforms.  Both maps are asked: what one holds for occupied ought to be so in the other, and
speaks against a match where that knows of free space.  A match counts only if no other one is
nearly as good: rooms that are alike, mirror walls and corridors are left alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import fft
from scipy.ndimage import (
    distance_transform_edt,
    gaussian_filter,
    map_coordinates,
    maximum_filter,
)

from usmap_ros.grids import FREE_VALUE, OCCUPIED_VALUE, GridGeometry, OccupancyMap
from usmap_ros.numerics.arrays import BoolArray, FloatArray

#: By how much what stands may seem to be elsewhere (standard deviation, m); of free space twice.
_OFF_M = 0.1
#: What stands in the other's free space speaks against a match by so much more than what both have
#: speaks for it.
_AGAINST = 4.0
#: Which side of what stands is free is seen within so much, m (standard deviation), where so much
#: of that is free, and farther away where less is: free space may end before a wall that is far
#: from where it was heard.  It is said of walls by so much of that side alone.
_SIDES_M, _ENOUGH_FREE, _SIDED = (0.2, 0.4, 0.8, 1.6), 0.1, 1.5
#: Cells of the search over shifts (m), and its turns (rad).
_CELL_M, _TURN_RAD = 0.1, math.radians(2.5)
#: What stands counts by pieces of such a side, m: a pole is as much as so much of a wall.
_PIECE_M = 0.3
#: Peaks of each turn, and matches that are refined.  With half as many the right one was at times
#: not among them (`benchmarks/margins.py`, seed 208, robots 1 and 2), and the next best neither.
_PEAKS, _REFINED = 12, 24
#: Matches are different if places are so far from each other, root mean square in m.
_APART_M = 0.4
#: Steps of the refinement (m), the turn being half a coarse one at first.
_FIRST_STEP_M, _LAST_STEP_M = 0.05, 0.01
#: A match is sure from so many pieces on, net of what speaks against it and of both maps, and if
#: its margin is so large, less so many times the share that stands in the other's free space: poses
#: that are off contradict each other a little, rooms that are merely alike more for their margin.
_LEAST_PIECES, _LEAST_SURENESS, _DOUBT = 12.0, 3.7, 30.0
#: Pieces that the next best counts less, at the least: of symmetric rooms that are not one
#: `benchmarks/margins.py` finds matches that are sure by all else with 25.
_LEAST_LEAD = 30.0
#: The margin from which on it is worth while to look again with poses that are refined together;
#: what it must be then, and how much more than it was, unless that is enough.  Right ones gain 1.3
#: and more and reach 4.1; wrong ones gain 0.02 at the most.
_PROMISING, _BORNE_OUT, _GAIN, _IS_ENOUGH = 2.0, 3.2, 0.6, 4.5


@dataclass(frozen=True)
class Submap:
    """What a match looks at."""

    #: (n, 2) array: centres of occupied cells.
    places_m: FloatArray
    #: (n,) array: pieces that each is worth.
    weights: FloatArray
    #: (n, 2) array: towards the side that is free, of length 1 for walls that were heard from one
    #: side, 0 for poles.
    sides: FloatArray
    #: (3, rows, columns) array: what an occupied cell of another map counts here: 1 where something
    #: stands, less than 0 where it is free, 0 where nothing is known; and the sides of what stands,
    #: times that.
    worth: FloatArray
    #: Of `worth`.
    geometry: GridGeometry

    @classmethod
    def of(cls, occupancy: OccupancyMap) -> Submap:
        """From a map."""
        geometry, values = occupancy.geometry, occupancy.trinary()
        stands: BoolArray = values == OCCUPIED_VALUE
        places_m = geometry.cell_centers_m(*np.nonzero(stands))
        pieces = np.floor(places_m / _PIECE_M).astype(np.int64)
        _, piece, count = np.unique(pieces, axis=0, return_inverse=True, return_counts=True)
        weights, worth = 1.0 / count[piece.ravel()], np.zeros((3, *geometry.shape))
        if not stands.any():
            return cls(places_m, weights, np.zeros((0, 2)), worth, geometry)
        is_free, resolution_m = values == FREE_VALUE, geometry.resolution_m
        cells, nearest = distance_transform_edt(~stands, return_indices=True)
        sides = _sides(is_free, resolution_m)
        near = np.exp(-0.5 * (cells * resolution_m / _OFF_M) ** 2)
        far = 1.0 - np.exp(-0.125 * (cells * resolution_m / _OFF_M) ** 2)
        worth[0] = near - _AGAINST * is_free * far
        worth[1:] = near * sides[:, nearest[0], nearest[1]]
        return cls(places_m, weights, sides[:, stands].T, worth, geometry)

    def worth_at(self, places_m: FloatArray, sides: FloatArray) -> FloatArray:
        """What occupied cells at some places count, which are free on some sides, (n,)."""
        geometry = self.geometry
        cells = ((places_m - geometry.origin_m) / geometry.resolution_m - 0.5).T[::-1]
        worth, x, y = (
            map_coordinates(layer, cells, order=1, cval=0.0, prefilter=False)
            for layer in self.worth
        )
        # Two sides of a wall are not one.
        return np.asarray(worth + np.minimum(x * sides[:, 0] + y * sides[:, 1], 0.0))

    @property
    def centre_m(self) -> FloatArray:
        """Of what stands."""
        return np.asarray(self.places_m.mean(axis=0))

    @property
    def radius_m(self) -> float:
        """How far from there it reaches."""
        return float(np.hypot(*(self.places_m - self.centre_m).T).max())


@dataclass(frozen=True)
class Match:
    """How one map lies over another."""

    #: (3,) array: x, y (m) and yaw (rad) of the second map's frame in the first one's.
    change: FloatArray
    #: (2,) array: centre of the second map, in its frame: what the match is off, it is off there.
    about_m: FloatArray
    #: What it counts.
    pieces: float
    #: How much less the next best counts, in units of the root of `pieces`.
    margin: float
    #: Pieces that stand in the other map's free space, as a share of those that stand in both.
    against: float

    @property
    def sureness(self) -> float:
        """The margin, less what is contradicted."""
        return self.margin - _DOUBT * self.against

    @property
    def has_enough(self) -> bool:
        """Whether enough pieces speak for it."""
        return self.pieces >= _LEAST_PIECES

    @property
    def is_promising(self) -> bool:
        """Whether there may be enough evidence once both maps' poses are refined together."""
        return self.has_enough and self.margin >= _PROMISING

    @property
    def is_sure(self) -> bool:
        """Whether there is enough evidence, and none for another one."""
        lead = self.margin * math.sqrt(self.pieces)
        return self.has_enough and self.sureness >= _LEAST_SURENESS and lead >= _LEAST_LEAD

    def bears_out(self, first: Match) -> bool:
        """Whether it makes sure of another one, by poses refined together as if that were right."""
        least = max(_BORNE_OUT, min(first.margin + _GAIN, _IS_ENOUGH))
        return self.has_enough and self.margin >= least


def match_maps(one: OccupancyMap, other: OccupancyMap) -> Match | None:
    """How a map lies over another; None if one of them shows nothing.

    Parameters
    ----------
    one, other : OccupancyMap
        In frames whose relation is not known.
    """
    first, second = Submap.of(one), Submap.of(other)
    if not len(first.places_m) or not len(second.places_m):
        return None
    found: list[tuple[float, FloatArray]] = []
    for change in _distinct(second, _search(first, second), _REFINED):
        found.append(_refined(first, second, change))
    found.sort(key=lambda end: -end[0])
    best, change = found[0]
    others = [pieces for pieces, end in found[1:] if _apart_m(second, change, end) > _APART_M]
    margin = (best - max(others, default=0.0)) / math.sqrt(max(best, 1.0))
    both, against = _counts(first, second, change)
    return Match(change, second.centre_m, best, margin, against / max(both, 1.0))


def in_common(first: Submap, second: Submap) -> tuple[float, float]:
    """Pieces that stand in both of two maps of one frame, and in the other's free space.

    Whatever little shift or turn between them is best is made good first.
    """
    if not len(first.places_m) or not len(second.places_m):
        return 0.0, 0.0
    return _counts(first, second, _refined(first, second, np.zeros(3))[1])


def _sides(is_free: BoolArray, resolution_m: float) -> FloatArray:
    """Towards the side that is free, as vectors of length 1 at the most, (2, rows, columns)."""
    free, sides, left = is_free.astype(float), np.zeros((2, *is_free.shape)), np.ones(is_free.shape)
    for side_m in _SIDES_M:
        sigma = side_m / resolution_m
        around, *slope = (
            gaussian_filter(free, sigma, order=order, mode="constant")
            for order in ((0, 0), (0, 1), (1, 0))
        )
        # As a share of what it would be beside a wall, which parts what is free from what is not.
        scale = _SIDED * math.sqrt(0.5 * math.pi) * sigma / np.maximum(around, 1e-9)
        told = left * np.minimum(around / _ENOUGH_FREE, 1.0)
        sides += told * scale * slope / np.maximum(scale * np.hypot(*slope), 1.0)
        left = left - told
    return np.asarray(sides)


def _turn(angle_rad: float) -> FloatArray:
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[cosine, -sine], [sine, cosine]])


def _counts(first: Submap, second: Submap, change: FloatArray) -> tuple[float, float]:
    """Pieces that stand in both maps, and those that stand in the other's free space."""
    turn = _turn(change[2])
    there = first.worth_at(second.places_m @ turn.T + change[:2], second.sides @ turn.T)
    back = second.worth_at((first.places_m - change[:2]) @ turn, first.sides @ turn)
    worth, weights = np.append(there, back), np.append(second.weights, first.weights)
    against = np.maximum(-worth, 0.0) / _AGAINST
    return float(np.maximum(worth, 0.0) @ weights), float(against @ weights)


def _pieces(first: Submap, second: Submap, change: FloatArray) -> float:
    """What counts for a match, less what counts against it."""
    both, against = _counts(first, second, change)
    return both - _AGAINST * against


def _apart_m(second: Submap, change: FloatArray, other: FloatArray) -> float:
    """How far two matches put the same places from each other."""
    off_m = second.places_m @ (_turn(change[2]) - _turn(other[2])).T + change[:2] - other[:2]
    return math.sqrt(float(np.mean(np.sum(off_m**2, axis=1))))


def _distinct(second: Submap, changes: FloatArray, most: int) -> list[FloatArray]:
    """The first of those changes that are much the same."""
    kept: list[FloatArray] = []
    for change in changes:
        if all(_apart_m(second, change, other) > _APART_M for other in kept):
            kept.append(change)
            if len(kept) == most:
                break
    return kept


def _raster(submap: Submap, angle_rad: float, side: int) -> tuple[FloatArray, FloatArray]:
    """Worth, and whether anything stands, around the centre of a map that is turned."""
    turn, steps_m = _turn(angle_rad), (np.arange(side) - side // 2) * _CELL_M
    places_m = np.stack(np.meshgrid(steps_m, steps_m), axis=-1).reshape(-1, 2)
    worth = submap.worth_at(places_m @ turn + submap.centre_m, np.zeros_like(places_m))
    cells = np.rint((submap.places_m - submap.centre_m) @ turn.T / _CELL_M).astype(np.int64)
    stands = np.zeros((side, side))
    stands[cells[:, 1] + side // 2, cells[:, 0] + side // 2] = 1.0
    return worth.reshape(side, side), stands


def _search(first: Submap, second: Submap) -> FloatArray:
    """Changes that are better than their neighbours, (n, 3), the best one first."""
    reaches = math.ceil(first.radius_m / _CELL_M), math.ceil(second.radius_m / _CELL_M)
    side = 2 * max(reaches) + 6
    whole = fft.next_fast_len(2 * sum(reaches) + 12, real=True)
    ours = [fft.rfft2(each, (whole, whole)) for each in _raster(first, 0.0, side)]
    peaks: list[tuple[float, FloatArray]] = []
    for angle_rad in np.arange(0.0, 2.0 * math.pi, _TURN_RAD):
        worth, stands = (
            np.conj(fft.rfft2(each, (whole, whole))) for each in _raster(second, angle_rad, side)
        )
        counts = fft.irfft2(ours[0] * stands + ours[1] * worth, (whole, whole))
        for count, shift_m in _peaks(counts):
            place = first.centre_m + shift_m - _turn(angle_rad) @ second.centre_m
            peaks.append((count, np.append(place, angle_rad)))
    ends = np.array([change for _, change in peaks])
    sided = [_pieces(first, second, change) for change in ends]
    return np.asarray(ends[np.argsort(sided, kind="stable")[::-1]])


def _peaks(counts: FloatArray) -> Iterator[tuple[float, FloatArray]]:
    """The highest places of a circular correlation, and the shifts that they stand for."""
    whole = len(counts)
    tops = np.flatnonzero(counts == maximum_filter(counts, 5, mode="wrap"))
    highest = tops[np.argsort(-counts.ravel()[tops], kind="stable")[:_PEAKS]]
    for row, column in zip(*np.unravel_index(highest, counts.shape), strict=True):
        steps = (np.array([column, row]) + whole // 2) % whole - whole // 2
        yield float(counts[row, column]), steps * _CELL_M


def _refined(first: Submap, second: Submap, change: FloatArray) -> tuple[float, FloatArray]:
    """A change improved step by step, and what it counts."""
    best, centre_m = _pieces(first, second, change), second.centre_m
    step_m = _FIRST_STEP_M
    while step_m >= _LAST_STEP_M:
        steps = np.diag([step_m, step_m, _TURN_RAD * step_m / (2.0 * _FIRST_STEP_M)])
        has_moved = False
        for step in (*steps, *-steps):
            tried = change + step
            # Turned about the centre of what stands.
            tried[:2] += (_turn(change[2]) - _turn(tried[2])) @ centre_m
            pieces = _pieces(first, second, tried)
            if pieces > best:
                best, change, has_moved = pieces, tried, True
        if not has_moved:
            step_m *= 0.5
    return best, change
