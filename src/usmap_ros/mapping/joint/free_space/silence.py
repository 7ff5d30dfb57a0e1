"""What silence says of an area, by how the surfaces that are believed answer."""

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.forward_model.cell_evidence import CellEvidence
from usmap_ros.mapping.joint.forward_model.log_odds import judged, over_block
from usmap_ros.mapping.joint.free_space.mirror_share import (
    facing_who_heard,
    mirror_share,
    told_by_walls,
    unexplained_share,
)
from usmap_ros.mapping.joint.free_space.one_sided import one_sided_share
from usmap_ros.mapping.joint.free_space.open_rays import open_shares
from usmap_ros.mapping.joint.free_space.overdispersion import learn_shape
from usmap_ros.mapping.joint.free_space.response import (
    NO_NORMAL,
    HeardBins,
    learn_response,
    look_at,
)
from usmap_ros.mapping.joint.free_space.usual_directions import facing, lengths, log_priors
from usmap_ros.mapping.joint.surfaces.lines import BEGIN, END, NORMAL_X, NORMAL_Y, points_on
from usmap_ros.mapping.joint.surfaces.mirrors import MirrorWall
from usmap_ros.mapping.joint.surfaces.parts import PartOfPlace, any_holds
from usmap_ros.mapping.joint.surfaces.smooth_surfaces import SmoothSurfaces
from usmap_ros.mapping.joint.surfaces.walls import Walls
from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.mapping.ping_bins import ECHO
from usmap_ros.mapping.ping_table import BIN_M, LEAST_RANGE, PingTable, X, Y
from usmap_ros.numerics.arrays import BoolArray, FloatArray

#: Among walls of which none is known to be a mirror, mirrors are taken to be so many times as
#: likely as was learnt: who frees one that nobody struck leaves through it.
CAUTION = 1.8
#: Surfaces at the most, from which is learnt how this place answers.
MOST_SURFACES = 3000
#: Mirrors that were found which say that others may be, at the most: what they scatter is heard
#: close by as well, so that hardly any shows by what it answers aslant.
MOST_STRUCK = 2
#: Share of occupied cells on lines at which a place is one of walls.
WALLED_SHARE = 0.3


class Thresholds(NamedTuple):
    """What silence has to say to refute surfaces."""

    #: Log-likelihood ratio at which those are refuted that answer from any side; and mirrors: this
    #: has in it how rare they are, which is all that speaks against those that nobody could have
    #: struck squarely.
    refuted: float
    mirrors_refuted: float
    #: Belief that unknown cells hide what is behind them.
    unknown: float


#: Among lone things, and among walls, where nothing round is refuted by being rare alone, log 1/3.
LONE, WALLED = Thresholds(-1.0, -1.1, 0.02), Thresholds(-1.1, -1.7, 0.12)
#: Share of rays that end at nothing, of all pings, up to which a place is one of rooms, and from
#: which on it is wide, or has walls that nobody has heard.  Of 24 recordings of rough places of six
#: kinds 22 have 0.02 to 0.13, and two 0.18 and 0.20; of eleven of rooms with walls of glass, of
#: which none was found, ten have 0.19 to 0.38.
FEW_OPEN, MANY_OPEN = 0.15, 0.28
#: Mirrors are refuted at this at the least, and others with them, and unknown cells hide by this at
#: the most, where mirrors were found; and the share of them is so much at the least.  That is more
#: than the first asks for: however many walls of bricks were found beside them, no mirror is
#: refuted by being rare alone.
MIRRORED, LEAST_MIRRORED = (-1.3, 0.05), 0.35


class Silence(NamedTuple):
    """What silence says of an area, by what was learnt of it."""

    #: (LOUDNESSES, INCIDENCES) array: by
    #: `usmap_ros.mapping.joint.free_space.response.learn_response`.
    log_silent: FloatArray
    #: How far looks from one side repeat each other.
    shape: float
    #: (KINDS, 3) array: by `usmap_ros.mapping.joint.free_space.usual_directions.log_priors`.
    kinds: FloatArray
    #: By `usmap_ros.mapping.joint.free_space.usual_directions.lengths`.
    long_and_short: FloatArray
    #: See `Thresholds`.
    refuted: float
    mirrors_refuted: float
    unknown: float
    #: Logarithm of how much likelier mirrors are where they are as likely as anything else, in a
    #: place of walls that has none.
    mirrors_likelier: float


class Answers(NamedTuple):
    """How an area answers: where it has mirrors, and elsewhere."""

    #: Of all of it; or in and outside of `mirrored`.
    silences: list[Silence]
    #: Parts that mirrors are in, if not in all of it.
    mirrored: list[PartOfPlace]
    #: Share of rays that end at nothing, by `usmap_ros.mapping.joint.free_space.open_rays`.
    usually_open: float
    #: How far what is estimated and not shown is trusted, by
    #: `usmap_ros.mapping.joint.free_space.listening.trust`.
    trusted: float = 0.0
    #: How far it was looked at from one side only, by
    #: `usmap_ros.mapping.joint.free_space.one_sided.one_sided_share`.
    one_sided: float = 0.0

    def each(self, field: Field) -> Iterator[tuple[BoolArray, Silence]]:
        """Cells of a field, and what silence says there."""
        inside = self.inside(field)
        return zip((inside, ~inside), self.silences, strict=False)

    def of_cells(self, field: Field, name: str) -> float | FloatArray:
        """One of the numbers: of the area, or of each cell."""
        values = [float(getattr(silence, name)) for silence in self.silences]
        return values[0] if len(values) == 1 else np.where(self.inside(field), *values)

    def by(self, change: Callable[[FloatArray], FloatArray]) -> "Answers":
        """The same with other kinds of surfaces."""
        silences = [each._replace(kinds=change(each.kinds)) for each in self.silences]
        return self._replace(silences=silences)

    def inside(self, field: Field) -> BoolArray:
        """Which cells of a field are in parts that have mirrors, or all."""
        if not self.mirrored:
            return np.ones(field.shape, bool)
        centers_m = field.geometry().cell_centers_m(*np.indices(field.shape).reshape(2, -1))
        return any_holds(self.mirrored, centers_m).reshape(field.shape)


def learn_answers(
    table: PingTable,
    pings: NDArray[np.int64],
    field: Field,
    left: NDArray[np.uint8],
    listening: HeardBins,
    walls: Walls,
    smooth: SmoothSurfaces,
    evidence: CellEvidence,
) -> Answers:
    """Learn how an area answers, and parts of it that have mirrors while others have none.

    Parameters
    ----------
    table : PingTable
        Pings.
    pings : (pings,) integer array
        Rows of those that count.
    field : Field
        The cells.
    left : (pings, RAYS, STEPS) uint8 array
        How much of their sound is left, if nothing but what stands is in the way.
    listening : HeardBins
        What was heard, and was to be heard by what stands.
    walls, smooth, evidence
        What stands.
    """
    given, columns = (table, pings, field), smooth.columns_likely
    usually_open = float(open_shares(table, pings, left, listening).mean())
    one_sided = one_sided_share(evidence, walls.occupied)
    answers = Answers([], smooth.mirrored, usually_open, one_sided=one_sided)
    everywhere, struck = np.ones(len(pings), bool), min(len(smooth.mirrors), MOST_STRUCK)
    places = [
        _Standing(
            everywhere, walls, smooth.mirrors, columns, one_sided, struck or smooth.panes.expected
        )
    ]
    if smooth.mirrored:
        inside = answers.inside(field)
        own = any_holds(smooth.mirrored, table.numbers[pings][:, [X, Y]])
        # Who looks into a part from elsewhere tells of its surfaces, too.
        # A part in which no mirror was found is quieter than the rest, as if there were one; and
        # what else seems to be of glass may be in either.
        places = [
            _Standing(
                own, walls.within(inside), smooth.mirrors, columns, one_sided, max(struck, 1)
            ),
            _Standing(~own, walls.within(~inside), [], columns, one_sided, smooth.panes.expected),
        ]
    wide = float(np.interp(usually_open, (FEW_OPEN, MANY_OPEN), (0.0, 1.0)))
    answers.silences.extend(
        _learnt(*given, left, listening, place, evidence, wide) for place in places
    )
    return answers


class _Standing(NamedTuple):
    """What stands in an area, or in a part of it."""

    #: (pings,) bool array: which pings were sent there.
    own: BoolArray
    walls: Walls
    mirrors: list[MirrorWall]
    #: How many columns are likely.
    columns: float
    #: How far all of it was looked at from one side only.
    one_sided: float
    #: Mirrors that count as struck squarely whatever was heard of them aslant.
    struck: float = 0.0


def _learnt(
    table: PingTable,
    pings: NDArray[np.int64],
    field: Field,
    left: NDArray[np.uint8],
    listening: HeardBins,
    place: _Standing,
    evidence: CellEvidence,
    wide: float,
) -> Silence:
    """Learn what silence says there; other arguments as of `learn_answers` and `thresholds_of`."""
    own, walls, mirrors, columns, one_sided, struck = place
    surfaces, on_lines = _surfaces(walls, evidence, field)
    things = len(walls.lines) + int(np.count_nonzero(surfaces[:, 2] == NO_NORMAL))
    views = look_at(table, pings, field, left, listening, surfaces)
    facing_them = facing_who_heard(views, surfaces, len(pings), one_sided)
    if facing_them is not surfaces:
        surfaces = facing_them
        views = look_at(table, pings, field, left, listening, surfaces)
    log_silent = learn_response(views, surfaces, one_sided)
    walled = walled_share(walls.shown, on_lines)
    alone_m = np.count_nonzero(walls.occupied & ~on_lines) * field.resolution_m
    mine = np.flatnonzero(own)
    index, bins = np.nonzero(table.kind[pings[mine]] == ECHO)
    least_m, bin_m = table.numbers[pings[mine]][:, [LEAST_RANGE, BIN_M]].T
    chances, ranges_m = (
        listening.chance[mine[index], bins],
        least_m[index] + (bins + 0.5) * bin_m[index],
    )
    told = walled if mirrors else told_by_walls(walled, len(walls.lines), wide)
    mirrored = max(
        mirror_share(views, surfaces, log_silent, 1.0 - walled, struck),
        unexplained_share(chances, ranges_m, things, len(mine), 1.0 - told),
    )
    mirrored = max(mirrored, LEAST_MIRRORED) if mirrors else min(CAUTION**walled * mirrored, 1.0)
    walls_facing = facing(mirrors, walls.lines, field.resolution_m)
    kinds = log_priors(walls_facing, len(mirrors), columns, things, alone_m, mirrored)
    long_and_short = lengths(walls.all_lines, alone_m, field.resolution_m)
    likelier = 0.0 if mirrors else -walled * math.log(mirrored)
    return Silence(
        log_silent,
        learn_shape(views, log_silent),
        kinds,
        long_and_short,
        *thresholds_of(walled, bool(mirrors), wide),
        likelier,
    )


def _surfaces(walls: Walls, evidence: CellEvidence, field: Field) -> tuple[FloatArray, BoolArray]:
    """Row, column and normal of what stands; and cells near lines."""
    found, near = [], np.zeros(field.shape, bool)
    row_count, column_count = field.shape
    for line in walls.all_lines:
        rows, columns = points_on(line, line[BEGIN], line[END])
        normal = float(np.arctan2(line[NORMAL_Y], line[NORMAL_X]))
        for row, column in dict.fromkeys(zip(rows.tolist(), columns.tolist(), strict=True)):
            if 1 <= row < row_count - 1 and 1 <= column < column_count - 1:
                found.append((row, column, normal))
                near[row - 1 : row + 2, column - 1 : column + 2] = True
    strength = judged(evidence, field.shape)
    peaks = walls.occupied & ~near & (strength >= over_block(strength))
    found += [(row, column, NO_NORMAL) for row, column in np.argwhere(peaks)]
    surfaces = np.array(found, dtype=float).reshape(-1, 3)
    if len(surfaces) > MOST_SURFACES:
        chosen = np.linspace(0, len(surfaces) - 1, MOST_SURFACES).astype(np.int64)
        surfaces = surfaces[chosen]
    return surfaces, near


def thresholds_of(walled: float, has_mirrors: bool, wide: float) -> Thresholds:
    """What silence has to say in a place.

    Parameters
    ----------
    walled : float
        How far it is one of walls: from `LONE` to `WALLED`.
    has_mirrors : bool
        Whether mirrors were found, and `MIRRORED` counts.
    wide : float
        How far more rays end at nothing than in rooms: there are walls that nobody has heard, and
        who knows what they are of.
    """
    refuted, of_mirrors, unknown = (
        (1.0 - walled) * lone + walled * among for lone, among in zip(LONE, WALLED, strict=True)
    )
    if has_mirrors:
        refuted = of_mirrors = max(of_mirrors, MIRRORED[0])
        unknown = min(unknown, MIRRORED[1])
    return Thresholds((1.0 - wide) * refuted + wide * of_mirrors, of_mirrors, unknown)


def walled_share(occupied: BoolArray, on_lines: BoolArray) -> float:
    """How far a place is one of walls, up to 1.

    Parameters
    ----------
    occupied, on_lines : (rows, columns) bool arrays
        What stands, and cells near lines.
    """
    share = int(np.count_nonzero(occupied & on_lines)) / max(1, int(np.count_nonzero(occupied)))
    return min(share / WALLED_SHARE, 1.0)
