"""How far smooth walls go on beyond the places that they were heard from.

A mirror is heard where somebody strikes it squarely, so that the ends of the stretch of feet are
those of the robots' paths and not the wall's.  Where nothing speaks against it, a wall goes on to
the next place on its line that was heard now and then, and to where it meets another one.  Against
it speak robots that stood there, sound that came back through, and pings that would have struck
the stretch squarely and loudly, by the wall's own reflectivity, but heard nothing.
"""

import math
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.surfaces.mirrors import MirrorWall, face_usually
from usmap_ros.mapping.joint.surfaces.round_column import RoundColumn
from usmap_ros.mapping.joint.visibility.beams import (
    LOOKING_SHARE,
    WITHIN_GREATEST_M,
    WITHIN_LEAST_M,
    amplitude_gains,
)
from usmap_ros.mapping.joint.visibility.echoes import Echoes
from usmap_ros.mapping.joint.visibility.ray_casting import RAYS, STEPS, WHOLE
from usmap_ros.mapping.ping_table import (
    ABSORPTION,
    BIN_M,
    GREATEST_RANGE,
    HALF_ANGLE,
    HEADING,
    LEAST_RANGE,
    PingTable,
    X,
    Y,
)
from usmap_ros.numerics.arrays import BoolArray, FloatArray

#: Longest stretch that is added to an end, m: of walls that face as many others do, and of others.
MOST_ADDED_M, MOST_UNUSUAL_M = 6.0, 1.0
#: Walls meet if their directions differ by more than this, rad; and are one if by less, and so
#: little apart, m.
MEETING_RAD, ALIKE_RAD, ALIKE_M = 0.5, 0.06, 0.06
#: An echo is a wall's if so near to where it should be, m; silence counts if it would have been so
#: many times as loud as what would have been reported, and so much of the sound gets there.
TOLERANCE_M, LOUD, CLEAR_SHARE = 0.04, 1.5, 0.7
#: Misses, less hits, and ways of sound through it, that refute a stretch.
REFUTING_MISSES, REFUTING_WAYS = 2, 2
#: What crosses a stretch so near to its ends, m, passes by.
PASSING_M = 0.1
#: Robots keep so far away from walls, m.
CLEARANCE_M = 0.12


class WallEnds:
    """What speaks for and against stretches of smooth walls.

    Parameters
    ----------
    table, pings, echoes
        As in `mirror_walls`.
    left : (pings, RAYS, STEPS) uint8 array
        By `usmap_ros.mapping.joint.visibility.ray_casting.cast_rays`.
    walls : list of MirrorWall
        That were found.
    columns : list of RoundColumn
        That were found.
    """

    def __init__(
        self,
        table: PingTable,
        pings: NDArray[np.int64],
        echoes: Echoes,
        left: NDArray[np.uint8],
        walls: list[MirrorWall],
        columns: list[RoundColumn],
    ) -> None:
        self._table, self._pings, self._echoes, self._left = table, pings, echoes, left
        self._numbers = table.numbers[pings]
        self._places_m = self._numbers[:, [X, Y]]
        self._echo_ping = np.repeat(np.arange(len(pings)), np.diff(echoes.start))
        self._walls = walls
        self._ways = self._open_ways([*walls, *columns])

    def extended(self) -> list[MirrorWall]:
        """The walls, each as far as it goes: the shortest stretches are added first."""
        walls, closed = list(self._walls), set[tuple[int, bool]]()
        most_m = np.where(face_usually(self._walls, self._walls), MOST_ADDED_M, MOST_UNUSUAL_M)
        corners = [
            corner
            for one, other in combinations(range(len(walls)), 2)
            if (corner := self._corner(one, other)) is not None
        ]
        while corners:
            added_m = [max(_beyond(walls[wall], at_m) for wall, at_m in each) for each in corners]
            corner = corners.pop(int(np.argmin(added_m)))
            stretches = [
                (wall, at_m, at_m > walls[wall].end_m)
                for wall, at_m in corner
                if _beyond(walls[wall], at_m) > 0.0
            ]
            if all(
                (wall, side) not in closed
                and _beyond(walls[wall], at_m) <= most_m[wall]
                and not self._is_refuted(_added(walls[wall], at_m))
                for wall, at_m, side in stretches
            ):
                for wall, at_m, side in stretches:
                    begin_m, end_m = min(walls[wall].begin_m, at_m), max(walls[wall].end_m, at_m)
                    walls[wall] = replace(walls[wall], begin_m=begin_m, end_m=end_m)
                    closed.add((wall, side))
        return walls

    def _corner(self, one: int, other: int) -> tuple[tuple[int, float], tuple[int, float]] | None:
        """Where along each two walls meet: at a corner, or between two stretches of one wall."""
        first, second = self._walls[one], self._walls[other]
        turn = second.normal_rad - first.normal_rad
        if abs(math.sin(turn)) > math.sin(MEETING_RAD):
            along = (second.distance_m - first.distance_m * math.cos(turn)) / math.sin(turn)
            back = (second.distance_m * math.cos(turn) - first.distance_m) / math.sin(turn)
            return (one, along), (other, back)
        if math.cos(turn) < math.cos(ALIKE_RAD):
            return None
        between = 0.5 * (max(first.begin_m, second.begin_m) + min(first.end_m, second.end_m))
        apart_m = second.distance_m - first.distance_m - between * math.sin(turn)
        if abs(apart_m) > ALIKE_M:
            return None
        return (one, between), (other, between)

    def _is_refuted(self, stretch: MirrorWall) -> bool:
        """Whether there is no wall, by what was heard."""
        cosine, sine = math.cos(stretch.normal_rad), math.sin(stretch.normal_rad)
        across = stretch.distance_m - self._places_m @ (cosine, sine)
        along = self._places_m @ (-sine, cosine)
        beside = (along > stretch.begin_m) & (along < stretch.end_m)
        if (beside & (np.abs(across) < CLEARANCE_M)).any():
            return True
        inside = replace(
            stretch, begin_m=stretch.begin_m + PASSING_M, end_m=stretch.end_m - PASSING_M
        )
        if np.count_nonzero(_crossed(inside, *self._ways)) >= REFUTING_WAYS:
            return True
        hits, misses = self._looks_at(stretch, across, beside)
        return misses - hits >= REFUTING_MISSES

    def _looks_at(self, wall: MirrorWall, across: FloatArray, beside: BoolArray) -> tuple[int, int]:
        """Pings that heard a stretch, and those that should have but did not."""
        numbers = self._numbers
        off = np.angle(np.exp(1j * (wall.normal_rad - numbers[:, HEADING])))
        half = numbers[:, HALF_ANGLE]
        inside = (across > numbers[:, LEAST_RANGE] + WITHIN_LEAST_M) & (
            across < numbers[:, GREATEST_RANGE] - WITHIN_GREATEST_M
        )
        asked = np.flatnonzero(beside & inside & (np.abs(off) < LOOKING_SHARE * half))
        near = np.abs(self._echoes.range_m - across[self._echo_ping]) < TOLERANCE_M
        heard = np.bincount(self._echo_ping[near], minlength=len(across))[asked] > 0
        numbers, across, off, half = numbers[asked], across[asked], off[asked], half[asked]
        rows = self._pings[asked]
        gain = amplitude_gains(self._table, rows, off)
        b = ((across - numbers[:, LEAST_RANGE]) / numbers[:, BIN_M]).astype(int)
        limit = np.sqrt(self._table.limit[rows, np.minimum(b, self._table.bins[rows] - 1)])
        ray = np.clip(((off + half) * RAYS / (2.0 * half)).astype(int), 0, RAYS - 1)
        step = ((across - 0.15) * STEPS / numbers[:, GREATEST_RANGE]).astype(int)
        clear = self._left[asked, ray, np.clip(step, 0, STEPS - 1)] > CLEAR_SHARE * WHOLE
        for other in self._walls:
            bearings = np.full(len(asked), wall.normal_rad)
            ways_m = across - PASSING_M
            clear &= ~_crossed(other, self._places_m[asked], bearings, ways_m)
        gain *= np.exp(-0.5 * numbers[:, ABSORPTION] * across)
        loud = math.exp(wall.log_mirror) * gain / (2.0 * across) > LOUD * limit
        return int(np.count_nonzero(heard)), int(np.count_nonzero(~heard & loud & clear))

    def _open_ways(
        self, things: list[MirrorWall | RoundColumn]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """From where, in which directions and how far the sound of things' echoes went."""
        nowhere = np.zeros((0, 2))
        places_m = [nowhere, *(self._places_m[thing.pings] for thing in things)]
        bearings = [
            thing.bearing_from(x_m, y_m)
            for thing, places in zip(things, places_m[1:], strict=True)
            for x_m, y_m in places.tolist()
        ]
        echoes = np.concatenate([np.zeros(0, np.int64), *(thing.echoes for thing in things)])
        ranges_m = self._echoes.range_m[echoes] - PASSING_M
        return np.concatenate(places_m), np.array(bearings), ranges_m


def _beyond(wall: MirrorWall, at_m: float) -> float:
    """How far beyond an end of a wall a place on its line is."""
    return max(wall.begin_m - at_m, at_m - wall.end_m, 0.0)


def _added(wall: MirrorWall, at_m: float) -> MirrorWall:
    """The stretch from an end of a wall to a place beyond."""
    if at_m > wall.end_m:
        return replace(wall, begin_m=wall.end_m, end_m=at_m)
    return replace(wall, begin_m=at_m, end_m=wall.begin_m)


def _crossed(
    wall: MirrorWall, places_m: FloatArray, bearings_rad: FloatArray, ranges_m: FloatArray
) -> BoolArray:
    """Whether ways from some places into some directions cross a wall."""
    cosine, sine = math.cos(wall.normal_rad), math.sin(wall.normal_rad)
    across = wall.distance_m - places_m @ (cosine, sine)
    off = bearings_rad - wall.normal_rad
    towards = np.cos(off)
    way_m = across / np.where(np.abs(towards) < 1e-6, 1e-6, towards)
    along = places_m @ (-sine, cosine) + way_m * np.sin(off)
    crossed: BoolArray = (
        (way_m > 0.0) & (way_m < ranges_m) & (along > wall.begin_m) & (along < wall.end_m)
    )
    return crossed
