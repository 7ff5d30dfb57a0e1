"""Arrays that every visit to a ping needs, made once and enlarged when they must be."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.superposition.cells import CELL_BINS, QUARTERS, Tiles
from usmap_ros.mapping.superposition.forward_model import (
    BLOCK_BINS,
    GRADIENTS,
    Bins,
    Contributions,
)
from usmap_ros.mapping.superposition.ping_bins import Look
from usmap_ros.mapping.superposition.ping_update import (
    Accumulators,
    Batch,
    Model,
    Scratch,
    after,
    expect_ping,
    visit,
)
from usmap_ros.mapping.superposition.power_estimation import find_unexplained
from usmap_ros.mapping.superposition.ray_casting import cast_shadows
from usmap_ros.mapping.superposition.visible_cells import (
    Rays,
    VisibleCells,
    find_cells,
    place_cells,
)
from usmap_ros.mapping.superposition.window import Looks

#: Rays into which a beam is divided.
RAYS = 64


class Workspace:
    """Scratch memory for one visit at a time."""

    def __init__(self) -> None:
        rays = _rays(1, 1.0)
        #: Of the last visit.
        self.scratch = Scratch(rays, _seen(0, np.empty(0, np.int32)), _bins(0), _contributions(0))
        # How many cells the last visit has listed.
        self._count = 0
        self._unexplained = np.empty(1, np.int32)

    def see(
        self, look: Look, tiles: Tiles, depth: NDArray[np.float32], among: NDArray[np.float32]
    ) -> tuple[VisibleCells, int]:
        """Cells that a look sees past what is in the way, of those that are not 0 in `among`.

        Nothing else is in the way, whatever its depth.
        """
        self._prepare(look, tiles, len(among))
        listed = self._list(lambda room: find_cells(look, tiles, among, room.seen))
        rays, seen, bins, _ = self.scratch
        res = tiles.resolution_m
        cast_shadows(look, res, seen, listed, depth, rays)
        self._count = place_cells(look, res, bins.every, rays, seen, listed)
        return seen, self._count

    def expect(
        self,
        look: Look,
        tiles: Tiles,
        depth: NDArray[np.float32],
        among: NDArray[np.float32],
        power: NDArray[np.float32],
    ) -> int:
        """Work out what a look is expected to hear of the cells that it sees.

        Returns
        -------
        count : int
            Number of the cells; they, and what is expected, are in `scratch`.
        """
        self._prepare(look, tiles, len(among))
        self._count = self._list(lambda room: expect_ping(look, tiles, depth, among, power, room))
        return self._count

    def visit(
        self,
        looks: Looks,
        batch: Batch,
        model: Model,
        sums: Accumulators,
        *,
        is_expected: bool = False,
    ) -> None:
        """Visit looks in turn; see `usmap_ros.mapping.superposition.ping_update.visit`.

        For each there must have been room made before, by `expect` or by `see`.

        Parameters
        ----------
        is_expected : bool
            Whether the first of them is what `expect` was asked for last, and nothing has changed.
        """
        expected = self._count if is_expected else -1
        if not is_expected:
            self._forget(len(model.powers.alive))
        self._count = 0
        while batch.pings:
            visited = visit(looks, batch, expected, model, self.scratch, sums)
            if visited < batch.pings:
                self._enlarge()
            batch, expected = after(batch, visited), -1

    def find_sources(
        self, look: Look, tiles: Tiles, everywhere: NDArray[np.float32]
    ) -> tuple[VisibleCells, int] | None:
        """Cells that may have returned an echo which is not expected; None if all echoes are.

        To be asked after `expect`; the same rays count.
        """
        if not find_unexplained(look, self.scratch.bins, self._unexplained):
            return None
        self._prepare(look, tiles, len(everywhere))
        listed = self._list(lambda room: find_cells(look, tiles, everywhere, room.seen))
        rays, seen, _, _ = self.scratch
        self._count = place_cells(look, tiles.resolution_m, self._unexplained, rays, seen, listed)
        return seen, self._count

    def _list(self, find: Callable[[Scratch], int]) -> int:
        """List cells, with more room for them as long as it is filled."""
        while (listed := find(self.scratch)) == len(self.scratch.seen.slot):
            self._enlarge()
        return listed

    def _prepare(self, look: Look, tiles: Tiles, slots: int) -> None:
        """Forget the cells of the last visit, and make room for the rays and bins of a look."""
        self._forget(slots)
        rays, seen, bins, parts = self.scratch
        steps = math.ceil(look.greatest_range_m / tiles.resolution_m) + 2
        if steps > len(rays.in_sight) or rays.step_m != tiles.resolution_m:
            rays = _rays(steps, tiles.resolution_m)
        if len(look.kind) + BLOCK_BINS > len(bins.expected):
            bins = _bins(len(look.kind))
            self._unexplained = np.empty(len(look.kind) + 1, np.int32)
        self.scratch = Scratch(rays, seen, bins, parts)

    def _forget(self, slots: int) -> None:
        """Forget the cells of the last visit; there may be so many."""
        seen = self.scratch.seen
        seen.place[seen.slot[: self._count]] = -1
        self._count = 0
        if len(seen.place) != slots:
            seen = seen._replace(place=np.full(slots, -1, np.int32))
            self.scratch = self.scratch._replace(seen=seen)

    def _enlarge(self) -> None:
        """Make room for more cells."""
        cells = max(1024, 2 * len(self.scratch.seen.slot))
        seen, parts = _seen(cells, self.scratch.seen.place), _contributions(cells)
        self.scratch = self.scratch._replace(seen=seen, parts=parts)


def _rays(steps: int, step_m: float) -> Rays:
    in_sight, loudness = np.ones((steps, RAYS), np.float32), np.zeros(steps, np.float32)
    return Rays(in_sight, np.zeros(RAYS, np.float32), loudness, step_m)


def _seen(cells: int, place: NDArray[np.int32]) -> VisibleCells:
    slot, row, column, ray = (np.empty(cells, np.int64) for _ in range(4))
    x_m, y_m, range_m, bearing = (np.empty(cells, np.float32) for _ in range(4))
    low, high = (np.empty((cells, QUARTERS), np.float32) for _ in range(2))
    density, weight = (np.empty(cells, np.float32) for _ in range(2))
    first_bin, reach = (np.empty(cells, np.uint64) for _ in range(2))
    heard = np.empty((cells, QUARTERS), np.uint8)
    return VisibleCells(
        slot, row, column, ray, x_m, y_m, range_m, bearing, low, high, density, first_bin, reach,
        heard, weight, place,
    )  # fmt: skip


def _contributions(cells: int) -> Contributions:
    return Contributions(np.empty((cells, CELL_BINS), np.float32), np.empty(BLOCK_BINS, np.float32))


def _bins(count: int) -> Bins:
    length = count + BLOCK_BINS
    every, counted = np.arange(length, dtype=np.int32), np.zeros((2, length), np.float32)
    gradient = np.zeros((length, GRADIENTS))
    numbers = {
        name: np.zeros(length, np.float32)
        for name in Bins._fields
        if name not in {"every", "counted", "gradient"}
    }
    return Bins(every=every, counted=counted, gradient=gradient, **numbers)
