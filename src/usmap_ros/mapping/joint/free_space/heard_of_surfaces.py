"""What pings say of surfaces in cells, by how a place answers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.forward_model.log_odds import over_block
from usmap_ros.mapping.joint.free_space.blocks import BAND
from usmap_ros.mapping.joint.free_space.continuations import FOLLOWED_M
from usmap_ros.mapping.joint.free_space.kinds import GROUPS, MIRRORS, facing_anyhow
from usmap_ros.mapping.joint.free_space.open_rays import likely_as_anything, open_shares
from usmap_ros.mapping.joint.free_space.open_space import refute_surfaces
from usmap_ros.mapping.joint.free_space.response import HeardBins
from usmap_ros.mapping.joint.free_space.silence import Answers, Silence
from usmap_ros.mapping.joint.free_space.unsaid import add_unsaid
from usmap_ros.mapping.joint.surfaces.lines import BEGIN, END, drawn
from usmap_ros.mapping.joint.surfaces.parts import any_holds
from usmap_ros.mapping.joint.surfaces.walls import Walls
from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.mapping.joint.visibility.ray_casting import changed_from, everything
from usmap_ros.mapping.ping_table import PingTable, X, Y
from usmap_ros.numerics.arrays import BoolArray, over_last
from usmap_ros.processes.threads import for_each

#: Whether no surface of each group can stand in a cell, by what was heard of them.
Refuted = Callable[[NDArray[np.float32]], BoolArray]

#: Works on the cells of a field in some rows that are asked for, by what silence says there.
InBand = Callable[[slice, Field, BoolArray, Silence], None]


class HeardOfSurfaces:
    """What some pings heard of surfaces in any cell.

    Parameters
    ----------
    table : PingTable
        Pings.
    pings : (pings,) integer array
        Rows of those that count.
    field : Field
        The cells.
    listening : HeardBins
        What was heard, and was to be heard by what stands.
    answers : Answers
        What was learnt of the place.
    scatters : (rows, columns) bool array
        Cells that echoes may well be of, see `usmap_ros.mapping.joint.free_space.listening`.
    left : (pings, RAYS, STEPS) uint8 array
        How much of their sound is left, if nothing but what stands is in the way.
    """

    def __init__(
        self,
        table: PingTable,
        pings: NDArray[np.int64],
        field: Field,
        listening: HeardBins,
        answers: Answers,
        scatters: BoolArray,
        left: NDArray[np.uint8],
    ) -> None:
        self._table, self._pings, self._field = table, pings, field
        self._listening, self._answers, self._scatters = listening, answers, scatters
        self._likelier, self._left = self._mirrors_likelier(left), left

    def renew(self, left: NDArray[np.uint8], wanted: BoolArray, worst: NDArray[np.float32]) -> None:
        """Set what was heard of surfaces; see `refute_surfaces`."""
        self._left, changed = left, everything(len(self._pings))
        self._renew(self._answers, left, wanted, changed, worst, self._scatters)

    def renew_where_in_doubt(
        self,
        left: NDArray[np.uint8],
        wanted: BoolArray,
        worst: NDArray[np.float32],
        refuted: Refuted,
    ) -> None:
        """The same where another share of sound is left than the last time, if it matters.

        What would be refuted without all that is said no more needs no closer look: it is taken for
        unsaid.

        Parameters
        ----------
        left, wanted, worst
            As of `refute_surfaces`.
        refuted : callable
            Whether no surface of each group can stand in a cell, by what was heard of them.
        """
        before, self._left = self._left, left
        changed = changed_from(left, before)
        worst += self._most_unsaid(before, left, wanted, changed)[:, :, np.newaxis]
        in_doubt = wanted & ~over_last(np.logical_and, refuted(worst))
        self._renew(self._answers, left, in_doubt, changed, worst, self._scatters)

    def _most_unsaid(
        self,
        before: NDArray[np.uint8],
        left: NDArray[np.uint8],
        wanted: BoolArray,
        changed: NDArray[np.uint8],
    ) -> NDArray[np.float32]:
        """By how much what was heard of surfaces rises at the most; see `add_unsaid`."""
        unsaid = np.zeros(self._field.shape, np.float32)

        def add(rows: slice, band: Field, asked: BoolArray, silence: Silence) -> None:
            add_unsaid(
                self._table, self._pings, band, before, left, self._listening.limit,
                silence.log_silent, asked[rows], changed, unsaid[rows],
            )  # fmt: skip

        self._in_bands(self._answers, wanted, add)
        return unsaid

    def of_lines(self, walls: Walls, left: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Log-likelihood ratio of a surface where lines are, or may go on: it faces as they do.

        However rare such surfaces are, this one is there, and echoes may be of it that are taken
        for those of something else.
        """
        reach, far_cells = walls.lines.copy(), FOLLOWED_M / self._field.resolution_m
        reach[:, BEGIN] -= far_cells
        reach[:, END] += far_cells
        asked = over_block(drawn(reach, self._field.shape)) | walls.bridged
        said = np.zeros((*self._field.shape, GROUPS), np.float32)
        answers, anywhere = self._answers.by(facing_anyhow), np.ones(self._field.shape, bool)
        self._renew(answers, left, asked, everything(len(self._pings)), said, anywhere)
        return over_last(np.maximum, said[:, :, :MIRRORS])

    def _renew(
        self,
        answers: Answers,
        left: NDArray[np.uint8],
        wanted: BoolArray,
        changed: NDArray[np.uint8],
        worst: NDArray[np.float32],
        scatters: BoolArray,
    ) -> None:
        """The same of surfaces as some answers have them, and where echoes may be of them."""

        def renew(rows: slice, band: Field, asked: BoolArray, silence: Silence) -> None:
            refute_surfaces(
                self._table, self._pings, band, left, self._listening, silence.log_silent,
                silence.shape, silence.kinds, self._likelier[rows], scatters[rows],
                asked[rows], changed, worst[rows],
            )  # fmt: skip

        self._in_bands(answers, wanted, renew)

    def _in_bands(self, answers: Answers, wanted: BoolArray, work: InBand) -> None:
        """Have work done in bands of rows, for cells that are wanted as they answer."""
        parts = [
            (*band, wanted & here, silence)
            for here, silence in answers.each(self._field)
            for band in self._field.bands(BAND)
        ]
        for_each(lambda part: work(*part), parts)

    def _mirrors_likelier(self, left: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Logarithm of how much likelier mirrors are in each cell than in the place as a whole."""
        most = np.broadcast_to(
            self._answers.of_cells(self._field, "mirrors_likelier"), self._field.shape
        )
        if not most.any():
            return np.zeros(self._field.shape, np.float32)
        given, answers = (self._table, self._pings), self._answers
        shares = open_shares(*given, left, self._listening)
        if answers.mirrored:
            # What is looked at from among mirrors is of their part, wherever its edge was drawn.
            places_m = self._table.numbers[self._pings][:, [X, Y]]
            shares[any_holds(answers.mirrored, places_m)] = 1.0
        likely = likely_as_anything(*given, self._field, left, shares, answers.usually_open)
        likelier: NDArray[np.float32] = (most * likely).astype(np.float32)
        return likelier
