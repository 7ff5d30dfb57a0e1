"""Powers of all that may scatter, by all pings of an area: what sweeps and shadows change.

Pings are divided into groups, by their number alone, which as many threads work on as there are
cores.  Groups are added up in their order, so that the map does not depend on the threads.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.forward_model.candidates import candidates, count_all_hits
from usmap_ros.mapping.joint.forward_model.cell_evidence import (
    CellEvidence,
    add_ratios,
    no_evidence,
)
from usmap_ros.mapping.joint.forward_model.cell_parts import Cells, cells_of
from usmap_ros.mapping.joint.forward_model.likelihood_ratios import LikelihoodRatios, weigh_pings
from usmap_ros.mapping.joint.forward_model.ping_groups import MOST_GROUPS, groups
from usmap_ros.mapping.joint.forward_model.power_estimation import (
    PowerLimits,
    expect_powers,
    gather_gradients,
    update_powers,
)
from usmap_ros.mapping.joint.forward_model.weighed_pings import WeighedPings
from usmap_ros.mapping.joint.visibility.field import QUARTERS, Field
from usmap_ros.mapping.joint.visibility.projection import (
    ALL_OF_IT,
    Projection,
    Scatterers,
    empty_rows,
    project,
)
from usmap_ros.mapping.joint.visibility.ray_casting import RAYS, STEPS, cast_rays
from usmap_ros.mapping.joint.visibility.shadows import cast_shadows, faintest_weights
from usmap_ros.mapping.ping_table import PingTable
from usmap_ros.numerics.arrays import BoolArray, over_last
from usmap_ros.processes.threads import for_each

#: Sweeps that thin out whole cells, before those that are left are divided into quarters.
COARSE_SWEEPS = 5


class _Group(NamedTuple):
    """Pings that one thread works on at a time."""

    #: Of all pings.
    which: slice
    #: Of all scatterers, and what is heard of them past what is in the way: all of it, until rays
    #: are cast.
    rows: Projection
    heard: Projection


class Settled(NamedTuple):
    """What some pings say of powers, for more pings to be explained beside them."""

    #: (quarters,) float32 array: where powers are likeliest.
    power: NDArray[np.float32]
    #: (quarters,) float32 array: σ w/λ of those pings there: how firmly they hold it.
    known: NDArray[np.float32]


class Powers:
    """What all scatterers of an area scatter, and what is expected of its pings by that.

    Parameters
    ----------
    table, pings, weights, field
        As in `usmap_ros.mapping.joint.estimate.JointEstimate`.
    limits : PowerLimits
        Powers that are of interest.
    """

    def __init__(
        self,
        table: PingTable,
        pings: NDArray[np.int64],
        weights: NDArray[np.float32],
        field: Field,
        limits: PowerLimits,
    ) -> None:
        self._table, self._pings, self._weights, self._field = table, pings, weights, field
        self.limits = limits
        #: λ of each range bin of each ping.
        self.expected = np.ones((len(pings), table.kind.shape[1]), np.float32)
        self._scatterers = Scatterers(np.zeros(0, np.int32), np.zeros(0, np.uint8))
        self._power = np.zeros(0, np.float32)
        self._faintest = faintest_weights(table, pings)
        self._groups: list[_Group] = []
        # What earlier pings say of each scatterer, by `go_on`; and what these pings say.
        self._before: Settled | None = None
        self._gradients = np.zeros((0, 0, 2), np.float32)
        # What each group said last, and of which cells.
        self._ratios: list[LikelihoodRatios] = []
        self._cells = cells_of(self._scatterers.cell, field)

    def start(self) -> None:
        """Begin with all cells that may have returned echoes, and thin them out."""
        cells = candidates(*count_all_hits(self._table, self._pings, self._weights, self._field))
        self._begin(Scatterers(cells, np.full(len(cells), ALL_OF_IT, np.uint8)))
        self.sweep(COARSE_SWEEPS)
        cells = np.repeat(cells[self._power > 0.0], QUARTERS)
        quarters = np.arange(len(cells)) % QUARTERS
        self._begin(Scatterers(cells, quarters.astype(np.uint8)))

    def go_on(self, before: Settled, is_empty: BoolArray | None = None) -> None:
        """Begin with what scattered before, and with what new echoes may have come from.

        Parameters
        ----------
        before : Settled
            Of the quarters of all cells.
        is_empty : (rows, columns) bool array, optional
            Cells in which nothing new can be; all by default.
        """
        power = before.power.reshape(-1, QUARTERS).copy()
        if is_empty is not None:
            hits = count_all_hits(self._table, self._pings, self._weights, self._field)
            cells = candidates(*hits)
            cells = cells[~is_empty.ravel()[cells] & ~over_last(np.logical_or, power[cells] > 0.0)]
            power[cells] = self.limits.first
        places = np.flatnonzero(power)
        cell, part = np.divmod(places, QUARTERS)
        self._begin(Scatterers(cell.astype(np.int32), part.astype(np.uint8)))
        self._power = power.ravel()[places]
        self._before = Settled(self._power.copy(), before.known[places])

    def take_up(self, other: Powers) -> None:
        """Begin with what scatters by other pings."""
        alive = other._power > 0.0
        cell, part = other._scatterers
        self._begin(Scatterers(cell[alive], part[alive]))
        self._power = other._power[alive]

    @property
    def power(self) -> NDArray[np.float32]:
        """Powers of the quarters of all cells, one behind the other."""
        return self._spread(self._power)

    @property
    def settled(self) -> Settled:
        """Powers of the quarters of all cells, and how much is known of them, for `go_on`."""
        known = self._gradients[:, :, 1].sum(axis=0)
        return Settled(self.power, self._spread(np.where(self._power > 0.0, known, 0.0)))

    def _spread(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Values of scatterers as those of the quarters of all cells."""
        spread = np.zeros(self._field.rows * self._field.columns * QUARTERS, np.float32)
        cell, part = self._scatterers
        spread[cell.astype(np.int64) * QUARTERS + part] = values
        return spread

    def renew_shadows(self, depth: NDArray[np.float32]) -> None:
        """Cast rays, and let what is left of the sound count; what has no power goes.

        Parameters
        ----------
        depth : (rows, columns) float32 array
            Optical depth of each cell.
        """
        alive = self._power > 0.0
        number = np.where(alive, np.cumsum(alive) - 1, -1).astype(np.int32)
        self._scatterers = Scatterers(self._scatterers.cell[alive], self._scatterers.part[alive])
        self._power = self._power[alive]
        self._gradients = self._gradients[:, alive]
        if self._before is not None:
            self._before = Settled(self._before.power[alive], self._before.known[alive])

        hides, open_everywhere = depth.any(), np.zeros((0, RAYS, STEPS), np.uint8)

        def renewed(group: _Group) -> _Group:
            which, rows, heard = group
            if heard is rows:
                heard = empty_rows(int(rows.start[-1]) + 1, np.zeros_like(rows.start))
            left = open_everywhere
            if hides:
                left = cast_rays(self._table, self._pings[which], self._field, depth)
            cast_shadows(rows, number, self._power, left, self._faintest[which], heard)
            return _Group(which, rows, heard)

        self._groups = for_each(renewed, self._groups)

    def sweep(self, sweeps: int) -> None:
        """Update all powers by all pings, again and again."""
        groups = len(self._groups) + (self._before is not None)
        gradients = self._gradients = np.empty((groups, len(self._power), 2), np.float32)

        def gather(number: int) -> None:
            group, sums = self._groups[number], gradients[number]
            sums[:] = 0.0
            gather_gradients(
                self._table, self._pings[group.which], self._weights[group.which], group.heard,
                self._power, sums,
            )  # fmt: skip

        for _ in range(sweeps):
            for_each(gather, range(len(self._groups)))
            if self._before is not None:
                _pull(self._before, self._power, self.limits.least, gradients[-1])
            update_powers(self._power, gradients, self.limits.least)

    @property
    def of_cells(self) -> NDArray[np.float32]:
        """Power of each cell, all its quarters together, (rows, columns)."""
        return over_last(np.add, self.power.reshape(*self._field.shape, QUARTERS))

    def expected_of(self, among: BoolArray) -> NDArray[np.float32]:
        """What would be expected of all pings if some cells were all there is.

        Parameters
        ----------
        among : (cells,) bool array
            Those.
        """
        power = np.where(among[self._scatterers.cell], self._power, np.float32(0.0))
        expected = np.ones_like(self.expected)
        self._expect(power, expected)
        return expected

    def weigh(
        self,
        forgetting: float,
        before: CellEvidence | None = None,
        are_asked: BoolArray | None = None,
    ) -> CellEvidence:
        """Evidence of all cells.

        Parameters
        ----------
        forgetting : float
            Share of what speaks for a cell that is forgotten with a ping that contradicts it.
        before : CellEvidence, optional
            That of earlier pings.
        are_asked : (cells,) bool array, optional
            Cells whose evidence is wanted; all by default.
        """
        self._expect(self._power, self.expected)
        cells = self._cells = cells_of(self._scatterers.cell, self._field, are_asked)
        evidence = no_evidence(self._field)
        if before is not None:
            evidence = CellEvidence(*(values.copy() for values in before))
        # What they said before takes as much memory.
        self._ratios = []
        self._ratios = self._weigh_groups(cells)

        def add(band: tuple[int, int]) -> None:
            for group, each in zip(self._groups, self._ratios, strict=True):
                add_ratios(
                    self._table, self._pings[group.which], self._weights[group.which], each,
                    cells, self._field, forgetting, evidence, *band,
                )  # fmt: skip

        # What one ping says after another, of some cells in each thread.
        edges = [len(cells.number) * band // MOST_GROUPS for band in range(MOST_GROUPS + 1)]
        for_each(add, pairwise(edges))
        return evidence

    @property
    def weighed(self) -> WeighedPings:
        """What each ping said of the cells when they were weighed last."""
        return WeighedPings(
            self._table, self._pings, self._weights, self._field, self._cells.number,
            [(group.which, each) for group, each in zip(self._groups, self._ratios, strict=True)],
        )  # fmt: skip

    def _weigh_groups(self, cells: Cells) -> list[LikelihoodRatios]:
        """What each group of pings says, by what is expected of them."""
        return for_each(
            lambda group: weigh_pings(
                self._table, self._pings[group.which], group.heard, self._power,
                self.expected[group.which], cells, self._field,
            ),
            self._groups,
        )  # fmt: skip

    def _expect(self, power: NDArray[np.float32], expected: NDArray[np.float32]) -> None:
        """Set what is expected of all pings."""

        def expect(group: _Group) -> None:
            pings, own = self._pings[group.which], expected[group.which]
            expect_powers(self._table, pings, group.heard, power, own)

        for_each(expect, self._groups)

    def _begin(self, scatterers: Scatterers) -> None:
        """Project scatterers, all of one power, without shadows."""
        self._scatterers = scatterers
        self._power = np.full(len(scatterers.cell), self.limits.first, np.float32)
        self._gradients = np.zeros((0, len(scatterers.cell), 2), np.float32)

        def projected(which: slice) -> _Group:
            rows = project(self._table, self._pings[which], self._field, scatterers)
            return _Group(which, rows, rows)

        self._groups = for_each(projected, groups(len(self._pings)))


def _pull(
    before: Settled,
    power: NDArray[np.float32],
    least_power: float,
    gradients: NDArray[np.float32],
) -> None:
    """Set both parts of the gradient that earlier pings add: it vanishes at their powers."""
    gradients[:, 0] = before.known * before.power / np.maximum(power, np.float32(least_power))
    gradients[:, 1] = before.known
