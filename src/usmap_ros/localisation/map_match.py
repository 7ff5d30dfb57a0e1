"""Two robots' maps laid over each other, where nobody knows how their frames relate.

Correlative matching (Olson, ICRA 2009) over all turns, and over all shifts at once by Fourier
transforms.  Both maps are asked: what one holds for occupied ought to be so in the other, and
speaks against a match where that knows of free space.  A match counts only if no other one is
nearly as good: rooms that are alike, mirror walls and corridors are left alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy import fft
from scipy.ndimage import maximum_filter

from usmap_ros.grids import OccupancyMap
from usmap_ros.localisation.submap import Submap, apart_m, counts, pieces_of, refined, turn_of
from usmap_ros.numerics.arrays import FloatArray

#: Cells of the search over shifts (m), and its turns (rad).
_CELL_M, _TURN_RAD = 0.1, math.radians(2.5)
#: Peaks of each turn, and matches that are refined.  With half as many the right one was at times
#: not among them (`benchmarks/margins.py`, seed 208, robots 1 and 2), and the next best neither.
_PEAKS, _REFINED = 12, 24
#: Matches are different if places are so far from each other, root mean square in m, and of another
#: place altogether from so far on: of maps that are bent, what is right has others less far away
#: that are nearly as good.
_APART_M, ELSEWHERE_M = 0.4, 1.0
#: A match is sure from so many pieces on, net of what speaks against it and of both maps, and if
#: its margin is so large, less so many times the share that stands in the other's free space: poses
#: that are off contradict each other a little, rooms that are merely alike more for their margin.
_LEAST_PIECES, _LEAST_SURENESS, _DOUBT = 12.0, 3.7, 30.0
#: Pieces that the next best counts less, at the least: of symmetric rooms that are not one
#: `benchmarks/margins.py` finds matches that are sure by all else with 25, and a second look 19.
_LEAST_LEAD = 30.0
#: The same of a second look at what maps as they were told nothing of, for which twice as much may
#: have been tried: a right one has 114, wrong ones of symmetric rooms have 27 at the most.
_LEAST_LEAD_OF_WAYS = 45.0
#: The margin from which on it is worth while to look again with poses that are refined together;
#: what it must be then, and how much more than it was, unless that is enough.  Right ones gain 1.3
#: and more and reach 4.1; wrong ones gain 0.02 at the most.
_PROMISING, _BORNE_OUT, _GAIN, _IS_ENOUGH = 2.0, 3.2, 0.6, 4.5


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
    #: The margin over those matches alone that are of another place.
    elsewhere: float = 0.0
    #: Changes that were tried, this one first, and what each counts.
    tried: tuple[tuple[FloatArray, float], ...] = ()

    def with_margins(self, places_m: FloatArray) -> Match:
        """By what was tried, and what stands in the second map, (n, 2)."""
        margin, elsewhere = (
            margin_elsewhere(places_m, self.change, self.pieces, self.tried, apart)
            for apart in (_APART_M, ELSEWHERE_M)
        )
        return replace(self, margin=margin, elsewhere=elsewhere)

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
        is_sure = self.sureness >= _LEAST_SURENESS
        return self.has_enough and is_sure and self._leads_by(self.margin)

    def bears_out(self, first: Match | None) -> bool:
        """Whether it makes sure of another one, by poses refined together as if that were right.

        None stands for one of which maps as they were before tell nothing.
        """
        least, lead = _IS_ENOUGH, _LEAST_LEAD_OF_WAYS
        if first:
            least, lead = max(_BORNE_OUT, min(first.elsewhere + _GAIN, _IS_ENOUGH)), _LEAST_LEAD
        return self.has_enough and self.elsewhere >= least and self._leads_by(self.elsewhere, lead)

    def _leads_by(self, margin: float, least: float = _LEAST_LEAD) -> bool:
        """Whether a margin is of enough pieces."""
        return margin * math.sqrt(self.pieces) >= least


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
    found = matches_of(first, second)
    best, change = found[0]
    both, against = counts(first, second, change)
    tried = tuple((end, pieces) for pieces, end in found)
    match = Match(change, second.centre_m, best, 0.0, against / max(both, 1.0), 0.0, tried)
    return match.with_margins(second.places_m)


def matches_of(first: Submap, second: Submap) -> list[tuple[float, FloatArray]]:
    """Changes of the second map's frame in the first one's, and what each counts, the best first.

    Parameters
    ----------
    first, second : Submap
        Maps that show something.
    """
    changes = _distinct(second, _search(first, second), _REFINED)
    found = [refined(first, second, change) for change in changes]
    return sorted(found, key=lambda end: -end[0])


def margin_elsewhere(
    places_m: FloatArray, change: FloatArray, pieces: float,
    tried: Iterable[tuple[FloatArray, float]], apart: float = ELSEWHERE_M,
) -> float:  # fmt: skip
    """How much less the best of other changes counts, in units of the root of `pieces`.

    Parameters
    ----------
    places_m : (n, 2) array
        What stands in the second map.
    change, pieces : (3,) array and float
        A change, and what it counts.
    tried : iterable of (array, float)
        Changes, and what each counts.
    apart : float
        Others put what stands farther from where this one does, root mean square in m.
    """
    others = [count for end, count in tried if apart_m(places_m, change, end) > apart]
    return (pieces - max(others, default=0.0)) / math.sqrt(max(pieces, 1.0))


def _distinct(second: Submap, changes: FloatArray, most: int) -> list[FloatArray]:
    """The first of those changes that are much the same."""
    kept: list[FloatArray] = []
    for change in changes:
        if all(apart_m(second.places_m, change, other) > _APART_M for other in kept):
            kept.append(change)
            if len(kept) == most:
                break
    return kept


def _raster(submap: Submap, angle_rad: float, side: int) -> tuple[FloatArray, FloatArray]:
    """Worth, and whether anything stands, around the centre of a map that is turned."""
    turn, steps_m = turn_of(angle_rad), (np.arange(side) - side // 2) * _CELL_M
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
            place = first.centre_m + shift_m - turn_of(angle_rad) @ second.centre_m
            peaks.append((count, np.append(place, angle_rad)))
    ends = np.array([change for _, change in peaks])
    sided = [pieces_of(first, second, change) for change in ends]
    return np.asarray(ends[np.argsort(sided, kind="stable")[::-1]])


def _peaks(counts: FloatArray) -> Iterator[tuple[float, FloatArray]]:
    """The highest places of a circular correlation, and the shifts that they stand for."""
    whole = len(counts)
    tops = np.flatnonzero(counts == maximum_filter(counts, 5, mode="wrap"))
    highest = tops[np.argsort(-counts.ravel()[tops], kind="stable")[:_PEAKS]]
    for row, column in zip(*np.unravel_index(highest, counts.shape), strict=True):
        steps = (np.array([column, row]) + whole // 2) % whole - whole // 2
        yield float(counts[row, column]), steps * _CELL_M
