"""Smooth things of an area: mirrors and round columns, whose echoes say nothing of cells."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.echoes import Echoes
from usmap_ros.mapping.joint.field import BIN_M, LEAST_RANGE, RANGE_STD, Field, X, Y
from usmap_ros.mapping.joint.mirror_walls import MirrorWall, mirror_walls
from usmap_ros.mapping.joint.open_space import trace_open
from usmap_ros.mapping.joint.ray_casting import cast_all_rays
from usmap_ros.mapping.joint.round_columns import RoundColumn, discs, drawn_columns, round_columns
from usmap_ros.mapping.joint.wall_ends import WallEnds
from usmap_ros.mapping.looks import Looks
from usmap_ros.mapping.ping_bins import ECHO, UNJUDGED
from usmap_ros.numerics.arrays import BoolArray, FloatArray

#: Pings whose ranges are less certain, by their poses, find no round columns, m.
MOST_RANGE_STD_M = 0.01
#: Range bins around a smooth thing's echo that say nothing of cells.
AROUND_BINS = 2
#: Power that smooth things return, over what would have been reported.
LOUD = 100.0
#: Pings that one counts for as a proof that its way is open: its loudness is that of the thing.
PROOFS = 2.0
#: The way to a smooth thing is proven to be open up to so many cells before it.
PROVEN_CELLS = 1.5


class SmoothThings:
    """Mirrors and columns of an area.

    Parameters
    ----------
    looks : Looks
        Pings.
    pings : (pings,) integer array
        Rows of those that count.
    echoes : Echoes
        Theirs.
    field : Field
        The cells.
    """

    def __init__(
        self, looks: Looks, pings: NDArray[np.int64], echoes: Echoes, field: Field
    ) -> None:
        self._looks, self._pings, self._echoes, self._field = looks, pings, echoes, field
        self.mirrors: list[MirrorWall] = []
        self.columns: list[RoundColumn] = []
        self._suspected: list[RoundColumn] = []
        index = np.repeat(np.arange(len(pings)), np.diff(echoes.start))
        numbers = looks.numbers[pings[index]]
        place = np.floor((echoes.range_m - numbers[:, LEAST_RANGE]) / numbers[:, BIN_M])
        self._inside = (place >= 0) & (place < looks.bins[pings[index]])
        self._ping, self._bin = index, np.where(self._inside, place, 0).astype(np.int64)

    @property
    def echo_bins(self) -> tuple[NDArray[np.int64], NDArray[np.int64], BoolArray]:
        """Ping and range bin of each echo, and whether it is within its ping's bins."""
        return self._ping, self._bin, self._inside

    def find(
        self, is_explained: BoolArray, is_usable: BoolArray, depth: NDArray[np.float32]
    ) -> None:
        """Find mirrors, and round columns, by echoes that nothing else explains.

        Parameters
        ----------
        is_explained : (echoes,) bool array
            Whether reliable cells explain an echo.
        is_usable : (echoes,) bool array
            Whether a mirror may explain an echo.
        depth : (rows, columns) float32 array
            Optical depth of cells.
        """
        looks, pings, echoes = self._looks, self._pings, self._echoes
        left = cast_all_rays(looks, pings, self._field, depth)
        found = mirror_walls(looks, pings, echoes, is_explained, is_usable)
        is_explained = is_explained.copy()
        for wall in found:
            is_explained[wall.echoes] = True
        # What scatters as much as its radius may be is no circle.
        is_explained |= looks.numbers[pings, RANGE_STD][self._ping] > MOST_RANGE_STD_M
        columns = round_columns(looks, pings, echoes, is_explained, self._field, left)
        self.columns = [column for column in columns if column.is_certain]
        self._suspected = [column for column in columns if not column.is_certain]
        ends = WallEnds(looks, pings, echoes, left, found, self.columns)
        self.mirrors = ends.extended()

    def take_out(self) -> None:
        """Let the echoes of smooth things say nothing of cells."""
        for ping, around, _ in self._echo_places():
            self._looks.kind[self._pings[ping], around] = UNJUDGED

    def put_back(self, expected: NDArray[np.float32]) -> Looks:
        """Pings as they were before `take_out`; what smooth things return is then expected.

        Parameters
        ----------
        expected : (pings, bins) float32 array
            λ; raised.
        """
        kind = self._looks.kind.copy()
        for ping, around, middle in self._echo_places():
            row = self._pings[ping]
            here = expected[ping, around]
            here[:] = np.maximum(here, LOUD * self._looks.limit[row, around][: len(here)])
            kind[row, middle] = ECHO
        return self._looks._replace(kind=kind)

    def lines(self) -> FloatArray:
        """Mirrors as lines, see `usmap_ros.mapping.joint.lines`."""
        return np.array([wall.line(self._field) for wall in self.mirrors]).reshape(-1, 5)

    def drawn_columns(self) -> BoolArray:
        """Cells at the surface of columns."""
        return drawn_columns(self.columns, self._field)

    def suspected(self) -> BoolArray:
        """Cells that columns may cover which are not certain."""
        return discs(self._suspected, self._field)

    def trace_open(self, proven: NDArray[np.float32], weights: NDArray[np.float32]) -> None:
        """Count pings whose sound came back through each cell from smooth things.

        Parameters
        ----------
        proven : (rows, columns) float32 array
            Added to.
        weights : (pings,) float32 array
            How much each ping counts.
        """
        last = np.full(self._field.shape, -1, np.int32)
        for thing in self._things():
            for ping, echo in zip(thing.pings.tolist(), thing.echoes.tolist(), strict=True):
                x_m, y_m = self._looks.numbers[self._pings[ping], [X, Y]]
                way_m = self._echoes.range_m[echo] - PROVEN_CELLS * self._field.resolution_m
                trace_open(
                    x_m, y_m, thing.bearing_from(x_m, y_m), way_m, self._field, ping, last, proven,
                    PROOFS * weights[ping],
                )  # fmt: skip

    def _things(self) -> list[MirrorWall | RoundColumn]:
        return [*self.mirrors, *self.columns]

    def _echo_places(self) -> Iterator[tuple[int, slice, int]]:
        """Ping, range bins around, and the middle one, of each echo of a smooth thing."""
        for thing in self._things():
            for ping, echo in zip(thing.pings.tolist(), thing.echoes.tolist(), strict=True):
                if self._inside[echo]:
                    middle = int(self._bin[echo])
                    yield (
                        ping, slice(max(0, middle - AROUND_BINS), middle + AROUND_BINS + 1), middle
                    )  # fmt: skip
