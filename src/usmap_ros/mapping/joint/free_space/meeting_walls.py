"""Rooms are closed: walls that were heard apart go on until they meet.

Who drives through the middle of a room hears its walls where they are near, and hardly in the far
corners, at which few pings look, and from a slant.  Two walls that would meet there do if nothing
speaks against it: whoever looks at what is missing of them looks from within the corner, and many
do, without having found that there is none.  So does a wall that would meet what stands.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.surfaces.lines import (
    BEGIN,
    DISTANCE,
    END,
    NORMAL_X,
    NORMAL_Y,
    cells_beyond,
    crossings,
)
from usmap_ros.mapping.joint.surfaces.square_lines import squared
from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.mapping.joint.visibility.ray_casting import RAYS, STEPS, WHOLE
from usmap_ros.mapping.ping_bins import UNJUDGED
from usmap_ros.mapping.ping_table import (
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
from usmap_ros.numerics.geometry import wrapped

#: Walls are so long, m; and how far beyond the end of what was heard of one it may go on, m.
LEAST_WALL_M, MOST_GAP_M = 0.5, 5.0
#: The same over its length, which tells how well it is known, up to corners and to what stands.
UP_TO_CORNERS, UP_TO_THINGS = 2.5, 1.5
#: Cosine of the angle between walls of a corner, at the most: walls that are not square to each
#: other seldom meet, there are others between them.
MOST_COSINE = 0.3
#: So many cells beyond its corner, at the most, a wall seems to end; and what is nearer to it
#: than so many is not missing.
PAST_CELLS, LEAST_GAP_CELLS = 5.0, 3.0
#: Log-likelihood ratio of a surface below which a cell says that no wall goes on there.
ENDS = -3.0
#: Cells are looked at if so many pings do; so many are from within a corner, and from outside.
LOOKS, FROM_WITHIN, FROM_OUTSIDE = 2, 0.65, 0.1
#: What goes on up to a thing has nobody behind it within so far, m: with robots on either side it
#: is the side of a thing itself, as of a rack that stands in line with others.
NEAR_M = 5.0
#: Share of the sound that reaches what is looked at, up to so far before it, in cells.
LEFT, BEFORE_CELLS = 0.5, 2.0


class Lookers(NamedTuple):
    """Pings, and how far they look."""

    table: PingTable
    #: (pings,) integer array: their rows.
    pings: NDArray[np.int64]
    field: Field
    #: (pings, RAYS, STEPS) uint8 array, by `usmap_ros.mapping.joint.visibility.ray_casting`.
    left: NDArray[np.uint8]

    def places(self) -> FloatArray:
        """(pings, 2) array: where they are, in cells from the middle of cell (0, 0)."""
        numbers, field = self.table.numbers[self.pings], self.field
        first = np.array([field.first_column, field.first_row]) + 0.5
        places: FloatArray = numbers[:, [X, Y]] / field.resolution_m - first
        return places

    def looks(self, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> BoolArray:
        """(cells, pings) array: whether sound of each ping gets to each cell, and it listened then.

        Sensors that report the first thing only hear nothing of what is beyond it.

        Parameters
        ----------
        rows, columns : (cells,) integer arrays
            The cells.
        """
        numbers, res = self.table.numbers[self.pings], self.field.resolution_m
        x, y = (np.stack([columns, rows], axis=1)[:, np.newaxis] - self.places()).T
        half_rad = numbers[:, HALF_ANGLE, np.newaxis]
        off_rad = wrapped(np.arctan2(y, x) - numbers[:, HEADING, np.newaxis])
        away_m, table, which = res * np.hypot(x, y), self.table, self.pings[:, np.newaxis]
        before_m = np.maximum(away_m - BEFORE_CELLS * res, 0.0)
        greatest_m = numbers[:, GREATEST_RANGE, np.newaxis]
        ray = ((off_rad / half_rad + 1.0) * 0.5 * RAYS).astype(np.int64)
        step = (before_m / greatest_m * STEPS).astype(np.int64)
        place = (away_m - numbers[:, LEAST_RANGE, np.newaxis]) / numbers[:, BIN_M, np.newaxis]
        heard = np.clip(place.astype(np.int64), 0, table.bins[which] - 1)
        is_in = (np.abs(off_rad) < half_rad) & (away_m < greatest_m) & (place >= 0.0)
        row = np.arange(len(self.pings))[:, np.newaxis]
        left = self.left[row, np.clip(ray, 0, RAYS - 1), np.clip(step, 0, STEPS - 1)]
        looks: BoolArray = is_in & (left > LEFT * WHOLE) & (table.kind[which, heard] != UNJUDGED)
        return looks.T


class _Gap(NamedTuple):
    """What is missing of a wall up to where it meets something."""

    wall: int
    #: Which of its ends is there, and up to where along it something is missing.
    end: int
    up_to: float
    length: float

    def cells(
        self, lines: FloatArray, shape: tuple[int, int]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Rows and columns of the cells that are missing."""
        sign = -1.0 if self.end == BEGIN else 1.0
        return cells_beyond(lines[self.wall], lines[self.wall, self.end], sign, self.length, shape)

    def line(self, lines: FloatArray) -> FloatArray:
        """What is missing, as a line."""
        ends = sorted((float(lines[self.wall, self.end]), self.up_to))
        return np.array([*lines[self.wall, :BEGIN], *ends])


class _Meeting(NamedTuple):
    """Where a wall may meet what stands, or another wall in a corner."""

    gaps: tuple[_Gap, ...]
    #: The walls of a corner, and none elsewhere.
    walls: tuple[int, ...] = ()

    @property
    def missing(self) -> list[_Gap]:
        """Where something is missing."""
        return [gap for gap in self.gaps if gap.length >= 1.0]

    def share_of(self, lines: FloatArray) -> float:
        """The most that is missing of a wall, over what was heard of it."""
        return max(
            gap.length / float(lines[gap.wall, END] - lines[gap.wall, BEGIN]) for gap in self.gaps
        )


class Surroundings(NamedTuple):
    """What is known of cells around walls: (rows, columns) arrays."""

    #: Log-likelihood ratio of a surface in each or beside it.
    said: NDArray[np.floating[Any]]
    #: Whether they hold something or are beside such, and whether they are known to be open.
    stands: BoolArray
    is_open: BoolArray


def joined(lines: FloatArray, around: Surroundings, lookers: Lookers) -> FloatArray:
    """Lines, and what is missing of them up to corners, and up to what stands.

    Parameters
    ----------
    lines : (lines, 5) array
        Walls that answer from any side, see `usmap_ros.mapping.joint.surfaces.lines`.
    around : Surroundings
        The cells around them.
    lookers : Lookers
        Who looked there.
    """
    walls, are_square = squared(lines)
    resolution_m, more = lookers.field.resolution_m, list[FloatArray]()
    is_long = walls[:, END] - walls[:, BEGIN] >= LEAST_WALL_M / resolution_m
    meetings = [
        *_corners(np.flatnonzero(is_long & are_square).tolist(), walls, resolution_m),
        *_ahead(np.flatnonzero(is_long).tolist(), walls, around.stands, resolution_m),
    ]
    ended = set[tuple[int, int]]()
    for meeting in sorted(meetings, key=lambda each: each.share_of(walls)):
        ends = {(gap.wall, gap.end) for gap in meeting.missing}
        if ends & ended or not _is_one(meeting, walls, around, lookers):
            continue
        ended |= ends
        more += [gap.line(walls) for gap in meeting.missing]
    return np.concatenate([lines, np.array(more).reshape(-1, lines.shape[1])])


def _ahead(
    walls: list[int], lines: FloatArray, stands: BoolArray, resolution_m: float
) -> Iterator[_Meeting]:
    """Where walls would meet what stands if they went on."""
    for wall in walls:
        line = lines[wall]
        for end, sign in ((BEGIN, -1.0), (END, 1.0)):
            most = _most_missing(line, UP_TO_THINGS, resolution_m)
            rows, columns = cells_beyond(line, line[end], sign, most, stands.shape)
            # Beside the first there is the end itself.
            met = np.flatnonzero(stands[rows, columns][int(LEAST_GAP_CELLS) :])
            if len(met):
                length = float(met[0] + LEAST_GAP_CELLS)
                yield _Meeting((_Gap(wall, end, line[end] + sign * length, length),))


def _corners(walls: list[int], lines: FloatArray, resolution_m: float) -> Iterator[_Meeting]:
    """Where two walls would meet if they went on."""
    for number, one in enumerate(walls):
        which, along, theirs = crossings(lines[one], lines[walls[:number]], MOST_COSINE)
        for index, here, there in zip(which, along.tolist(), theirs.tolist(), strict=True):
            other = walls[index]
            gaps = _gap(one, here, lines, resolution_m), _gap(other, there, lines, resolution_m)
            if gaps[0] and gaps[1] and max(gaps[0].length, gaps[1].length) > LEAST_GAP_CELLS:
                yield _Meeting((gaps[0], gaps[1]), (one, other))


def _gap(wall: int, corner: float, lines: FloatArray, resolution_m: float) -> _Gap | None:
    """What is missing of a wall up to a corner at some place along it, if it may be one."""
    line = lines[wall]
    beyond = {BEGIN: float(line[BEGIN]) - corner, END: corner - float(line[END])}
    end = max(beyond, key=lambda each: beyond[each])
    if not -PAST_CELLS <= beyond[end] <= _most_missing(line, UP_TO_CORNERS, resolution_m):
        return None
    return _Gap(wall, end, corner, max(beyond[end], 0.0))


def _most_missing(line: FloatArray, share: float, resolution_m: float) -> float:
    """How much may be missing of a wall, cells, by a share of its length."""
    return min(MOST_GAP_M / resolution_m, share * float(line[END] - line[BEGIN]))


def _is_one(meeting: _Meeting, lines: FloatArray, around: Surroundings, lookers: Lookers) -> bool:
    """Whether walls go on until they meet: many look there from within, and none contradicts."""
    missing = [gap.cells(lines, around.said.shape) for gap in meeting.missing]
    if any(_is_contradicted(rows, columns, around) for rows, columns in missing):
        return False
    rows, columns = (np.concatenate(each) for each in zip(*missing, strict=True))
    if not len(rows):
        return False
    looks, places = lookers.looks(rows, columns), lookers.places()
    within = _within(meeting, lines, places, looks)
    away_m = lookers.field.resolution_m * np.hypot(*(places - (columns.mean(), rows.mean())).T)
    if not meeting.walls and np.any(~within & (away_m < NEAR_M)):
        return False
    from_within = (looks[:, within].sum(axis=1) >= LOOKS).mean()
    from_outside = (looks[:, ~within].sum(axis=1) >= LOOKS).mean()
    return bool(from_within >= FROM_WITHIN and from_outside <= FROM_OUTSIDE)


def _is_contradicted(
    rows: NDArray[np.int64], columns: NDArray[np.int64], around: Surroundings
) -> bool:
    """Whether pings deny that a wall goes on, or something else is in its way."""
    # Beside the first and the last there is what stands.
    is_denied = (around.said[rows[1:-1], columns[1:-1]] < ENDS).any()
    is_barred = around.stands[rows[2:-2], columns[2:-2]].any()
    return bool(is_denied or is_barred or around.is_open[rows, columns].any())


def _within(
    meeting: _Meeting, lines: FloatArray, places: FloatArray, looks: BoolArray
) -> BoolArray:
    """Whether places are within a corner, or on that side of a wall from which most look."""
    if meeting.walls:
        one, other = lines[list(meeting.walls)]
        within: BoolArray = _alike(one, other, places) & _alike(other, one, places)
        return within
    line = lines[meeting.gaps[0].wall]
    is_ahead = places @ line[[NORMAL_X, NORMAL_Y]] > line[DISTANCE]
    is_within: BoolArray = is_ahead == (looks[:, is_ahead].sum() > looks[:, ~is_ahead].sum())
    return is_within


def _alike(line: FloatArray, other: FloatArray, places: FloatArray) -> BoolArray:
    """Whether places are on the side of a line on which the middle of another one is."""
    normal, other_normal = (each[[NORMAL_X, NORMAL_Y]] for each in (line, other))
    along = 0.5 * (other[BEGIN] + other[END])
    middle = other_normal * other[DISTANCE] + along * np.array([-other_normal[1], other_normal[0]])
    sides: BoolArray = (places @ normal - line[DISTANCE]) * (middle @ normal - line[DISTANCE]) > 0.0
    return sides
