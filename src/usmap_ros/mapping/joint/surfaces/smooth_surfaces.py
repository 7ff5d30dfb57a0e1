"""Smooth things of an area: mirrors and round columns, whose echoes say nothing of cells."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.surfaces.alike_columns import columns_of_place
from usmap_ros.mapping.joint.surfaces.column_fits import PingSet
from usmap_ros.mapping.joint.surfaces.echo_places import EchoPlaces
from usmap_ros.mapping.joint.surfaces.first_returns import answer_as_mirrors
from usmap_ros.mapping.joint.surfaces.lone_columns import columns_instead, larger_columns
from usmap_ros.mapping.joint.surfaces.lone_points import lone_points
from usmap_ros.mapping.joint.surfaces.loud_echoes import FEW_ECHOES, LoudEchoes
from usmap_ros.mapping.joint.surfaces.mirror_walls import left_of, perpendicular_walls
from usmap_ros.mapping.joint.surfaces.mirrors import MirrorWall, facing_usually, on_field
from usmap_ros.mapping.joint.surfaces.multiple_reflections import (
    are_corners,
    out_of_sight,
    reflected,
)
from usmap_ros.mapping.joint.surfaces.panes import Panes, lone_lines
from usmap_ros.mapping.joint.surfaces.parts import PartOfPlace, any_holds, mirrors_of_parts
from usmap_ros.mapping.joint.surfaces.round_column import (
    RoundColumn,
    discs,
    drawn_columns,
    without_pairs,
)
from usmap_ros.mapping.joint.surfaces.wall_ends import WallEnds
from usmap_ros.mapping.joint.visibility.echoes import Echoes
from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.mapping.joint.visibility.ray_casting import cast_all_rays
from usmap_ros.mapping.ping_bins import ECHO, UNJUDGED
from usmap_ros.mapping.ping_table import PingTable, X, Y
from usmap_ros.numerics.arrays import BoolArray, FloatArray

#: A point is in cells whose middles are so near, over their sides: in one at least.
POINT_SHARE = 0.71
#: Power that smooth things return, over what would have been reported.
LOUD = 100.0


class KnownSurfaces(NamedTuple):
    """Smooth things that are known."""

    #: Those that are certain.
    mirrors: list[MirrorWall]
    columns: list[RoundColumn]
    #: Columns that are not.
    suspected: list[RoundColumn]
    #: Mirrors that are not.
    panes: Panes
    #: Parts of the place that mirrors are in, if not in all of it.
    mirrored: list[PartOfPlace]


class SmoothSurfaces:
    """Mirrors and columns of an area.

    Parameters
    ----------
    table : PingTable
        Pings.
    pings : (pings,) integer array
        Rows of those that count.
    echoes : Echoes
        Theirs.
    field : Field
        The cells.
    """

    def __init__(
        self, table: PingTable, pings: NDArray[np.int64], echoes: Echoes, field: Field
    ) -> None:
        self._table, self._pings, self._echoes, self._field = table, pings, echoes, field
        self.mirrors: list[MirrorWall] = []
        self.columns: list[RoundColumn] = []
        # Finds points that stand alone where no mirrors are, which cells do not tell.
        self._points_m: Callable[[], FloatArray] = lambda: np.zeros((0, 2))
        #: Parts of the place that mirrors are in, if not in all of it.
        self.mirrored: list[PartOfPlace] = []
        #: What may be mirrors where none was found.
        self.panes = Panes()
        self._suspected: list[RoundColumn] = []
        # Those that other pings found.
        self._known_mirrors: list[MirrorWall] = []
        self._reflected = np.zeros(len(echoes.range_m), bool)
        #: Where each echo is.
        self.places = EchoPlaces(table, pings, echoes)

    def find(
        self,
        is_explained: BoolArray,
        lone_cells_m: Sequence[FloatArray],
        first_only: BoolArray,
        depth: NDArray[np.float32],
    ) -> None:
        """Find mirrors, and round columns, by echoes that nothing else explains.

        Parameters
        ----------
        is_explained : (echoes,) bool array
            Whether reliable cells explain an echo.
        lone_cells_m : sequence of (cells, 2) arrays
            By `usmap_ros.mapping.joint.surfaces.lone_columns.lone_cells`.
        first_only : (pings,) bool array
            Pings of sensors that report the first thing only.
        depth : (rows, columns) float32 array
            Optical depth of cells.
        """
        table, pings, echoes = self._table, self._pings, self._echoes
        left = cast_all_rays(table, pings, self._field, depth)
        is_usable = ~first_only[self.places.ping] | self._mirror_first_returns(first_only)
        is_explained = is_explained | ~is_usable
        found, self.mirrored = mirrors_of_parts(
            table, pings, echoes, is_explained, is_usable, first_only
        )
        for wall in found:
            is_explained[wall.echoes] = True
        may_follow = ~is_explained & ~first_only[self.places.ping]
        self._reflected = reflected(found, table, pings, echoes) & may_follow
        is_explained |= self._reflected
        ping_set = PingSet(table, pings, echoes, left)
        columns = columns_of_place(ping_set, is_explained, is_usable, self._field)
        columns = _but_corners(columns, found)
        for column in columns:
            is_usable[column.echoes] &= not column.is_certain
        self.panes = self._panes_elsewhere(found, is_explained, is_usable, first_only)
        certain = sum(column.is_certain for column in columns)
        # Where mirrors were struck lone cells seem to be.
        may_be = left_of(is_usable, found)
        instead = columns_instead(
            ping_set, is_usable & ~is_explained, may_be, lone_cells_m, certain
        )
        instead = _but_corners(instead, found)
        columns = [
            column for column in columns if column.is_certain or not column.overlaps_any(instead)
        ]
        columns = without_pairs(
            [*columns, *instead], len(lone_cells_m), first_only[self.places.ping]
        )
        self.columns = [column for column in columns if column.is_certain]
        self._suspected = [column for column in columns if not column.is_certain]
        self._suspected += larger_columns(self.columns, ping_set)
        ends = WallEnds(table, pings, echoes, left, found, self.columns)
        self.mirrors = ends.extended()
        if not found:
            # With what was heard before `take_out`; where there are lines, nobody asks for them.
            before = ping_set._replace(table=table._replace(kind=table.kind.copy()))
            is_open = left_of(is_usable & ~is_explained, self.columns)
            self._points_m = cache(
                partial(lone_points, before, is_open, is_usable, lone_cells_m, self._field)
            )

    def _panes_elsewhere(
        self,
        found: list[MirrorWall],
        is_explained: BoolArray,
        is_usable: BoolArray,
        first_only: BoolArray,
    ) -> Panes:
        """What may be mirrors where none was found; arguments as of `lone_lines`."""
        if found and not self.mirrored:
            return Panes()
        table, pings = self._table, self._pings
        if found:
            inside = any_holds(self.mirrored, table.numbers[pings][:, [X, Y]])
            is_usable = is_usable & ~inside[self.places.ping]
        return Panes(lone_lines(table, pings, self._echoes, is_explained, is_usable, first_only))

    def _mirror_first_returns(self, first_only: BoolArray) -> bool:
        """Whether the walls that sensors hear which report the first thing only are mirrors."""
        table, pings, echoes = self._table, self._pings, self._echoes
        if not first_only.any():
            return False
        walls = perpendicular_walls(table, pings, echoes, first_only[self.places.ping], first_only)
        return answer_as_mirrors(walls, table, pings, echoes)

    @property
    def recognised(self) -> KnownSurfaces:
        """Those that are known now."""
        return KnownSurfaces(self.mirrors, self.columns, self._suspected, self.panes, self.mirrored)

    def recognise(self, known: KnownSurfaces) -> None:
        """Take over the smooth things that other pings found, and these pings' echoes of them out.

        See `take_out`.
        """
        self._suspected, self._known_mirrors = known.suspected, known.mirrors
        self.mirrored, self.panes = known.mirrored, known.panes
        for wall in known.mirrors:
            own = np.flatnonzero(self.places.are_of_mirror(wall))
            self.mirrors.append(replace(wall, pings=self.places.ping[own], echoes=own))
        # What goes over more mirrors seems to be behind one, where nothing is shown.
        self._reflected = reflected(self.mirrors, self._table, self._pings, self._echoes, most=2)
        for column in known.columns:
            own = np.flatnonzero(self.places.are_of_column(column))
            self.columns.append(replace(column, pings=self.places.ping[own], echoes=own))
        self.take_out()

    def take_out(self) -> None:
        """Let the echoes of smooth things say nothing of cells."""
        for ping, around, _ in self._echo_places():
            self._table.kind[self._pings[ping], around] = UNJUDGED

    def put_back(self, expected: NDArray[np.float32]) -> PingTable:
        """Pings as they were before `take_out`; what smooth things return is then expected.

        Parameters
        ----------
        expected : (pings, bins) float32 array
            λ; raised.
        """
        kind = self._table.kind.copy()
        for ping, around, middle in self._echo_places():
            row = self._pings[ping]
            here = expected[ping, around]
            here[:] = np.maximum(here, LOUD * self._table.limit[row, around][: len(here)])
            kind[row, middle] = ECHO
        return self._table._replace(kind=kind)

    def lines(self) -> FloatArray:
        """Mirrors as lines, see `usmap_ros.mapping.joint.surfaces.lines`."""
        return on_field(self.mirrors, self._field)

    def usual_lines(self) -> FloatArray:
        """Those that face as most do."""
        return on_field(facing_usually(self.mirrors), self._field)

    def hide(self, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> BoolArray:
        """Whether mirrors hide cells from everywhere: what seems to be there stands in them."""
        places_m = self._table.numbers[self._pings][:, [X, Y]]
        first = self._field.first_column + 0.5, self._field.first_row + 0.5
        cells = np.stack([columns, rows], axis=1) + np.array(first)
        points_m = np.asarray(cells * self._field.resolution_m, np.float64)
        return out_of_sight(points_m, self.mirrors, places_m)

    def ended_m(self) -> FloatArray:
        """How far the sound of each ping can have gone, by echoes as loud as mirrors' are.

        Of things that were found it is known how far they go, unless few echoes are heard.
        """
        loud = self._loud_echoes()
        if loud is None:
            return np.full(len(self._pings), np.inf)
        nothing = np.zeros(len(self._echoes.range_m), bool)
        return loud.ended_m(nothing if self._hears_little else self._explained(self.columns))

    def behind_unfound(self) -> BoolArray:
        """Cells behind walls that were struck, but not found, where few echoes are heard."""
        loud = self._loud_echoes() if self._hears_little else None
        if loud is None:
            return np.zeros(self._field.shape, bool)
        return loud.behind(self._explained([*self.columns, *self._suspected]), self._field)

    @property
    def _hears_little(self) -> bool:
        """Whether few echoes are heard."""
        return len(self._echoes.range_m) <= FEW_ECHOES * len(self._pings)

    def _explained(self, columns: list[RoundColumn]) -> BoolArray:
        """Which echoes are of mirrors, go by way of several, or are of some columns."""
        explained = self._reflected.copy()
        # What goes on beyond the feet that it was found by is heard there, too.
        for wall in self.mirrors:
            explained |= self.places.are_of_mirror(wall)
        for column in columns:
            explained |= self.places.are_of_column(column)
        return explained

    def _loud_echoes(self) -> LoudEchoes | None:
        """Echoes as loud as those of mirrors, if any mirror is known."""
        # By those who found them: these pings may have struck none of them.
        found = self._known_mirrors or self.mirrors
        given = self._table, self._pings, self._echoes, self.places
        return LoudEchoes(found, self.mirrored, *given) if found else None

    def drawn_columns(self) -> BoolArray:
        """Cells at the surface of columns."""
        return drawn_columns(self.columns, self._field)

    def drawn_points(self) -> BoolArray:
        """Cells that points are in which stand alone."""
        x_m, y_m = self._points_m().T
        return self._field.cells_within(x_m, y_m, POINT_SHARE * self._field.resolution_m)

    @property
    def columns_likely(self) -> float:
        """How many columns there are likely to be, of those that were found or are suspected."""
        others = [each for each in self._suspected if not each.overlaps_any(self.columns)]
        return len(self.columns) + sum(column.likely for column in others)

    def doubt_columns_on(self, lines: FloatArray) -> bool:
        """Let columns that walls pass through be suspected only: most are those walls' ends.

        Parameters
        ----------
        lines : (lines, 5) array
            Walls that answer from any side, see `usmap_ros.mapping.joint.surfaces.lines`.

        Returns
        -------
        any_doubted : bool
            Whether there are such columns.
        """
        is_on = [column.is_on(lines, self._field) for column in self.columns]
        pairs = list(zip(self.columns, is_on, strict=True))
        self.columns = [column for column, on in pairs if not on]
        self._suspected = [*self._suspected, *(column for column, on in pairs if on)]
        return any(is_on)

    def suspected(self) -> BoolArray:
        """Cells that columns may cover which are not certain."""
        return discs(self._suspected, self._field)

    @property
    def things(self) -> list[MirrorWall | RoundColumn]:
        """Those that are certain."""
        return [*self.mirrors, *self.columns]

    def _echo_places(self) -> Iterator[tuple[int, slice, int]]:
        """Ping, range bins around, and the middle one, of each echo of smooth things."""
        own = [thing.echoes for thing in self.things]
        return self.places.around([*own, np.flatnonzero(self._reflected)])


def _but_corners(columns: list[RoundColumn], mirrors: list[MirrorWall]) -> list[RoundColumn]:
    """Columns but for what are corners of mirrors."""
    middles_m = np.array([(column.x_m, column.y_m) for column in columns]).reshape(-1, 2)
    radii_m = np.array([column.radius_m for column in columns])
    are = are_corners(middles_m, radii_m, mirrors)
    return [column for column, is_corner in zip(columns, are, strict=True) if not is_corner]
