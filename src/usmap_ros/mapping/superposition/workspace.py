"""Arrays that every visit to a ping needs, made once and enlarged when they must be."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.superposition.cells import QUARTERS, Tiles
from usmap_ros.mapping.superposition.look import Look
from usmap_ros.mapping.superposition.powers import (
    BLOCK_BINS,
    CELL_BINS,
    GRADIENTS,
    Bins,
    Contributions,
    expect,
    find_unexplained,
)
from usmap_ros.mapping.superposition.seen import Rays, Seen, find_cells, place_cells
from usmap_ros.mapping.superposition.sight import cast_rays

#: Rays into which a beam is divided.
RAYS = 64


class Workspace:
    """Scratch memory for one visit at a time."""

    def __init__(self) -> None:
        self._rays = Rays(np.ones((RAYS, 1), np.float32), np.zeros(RAYS, np.float32), 1.0)
        self._seen = _seen(1024, np.empty(0, np.int32))
        self._parts = _contributions(0)
        self._bins = _bins(0)
        self._all_bins = np.arange(1, dtype=np.int32)
        self._unexplained = np.empty(1, np.int32)

    def rays(self, look: Look, tiles: Tiles) -> Rays:
        """Rays of a look; all of its sound reaches everywhere until they are cast."""
        steps = math.ceil(look.greatest_range_m / tiles.resolution_m) + 2
        if steps > self._rays.in_sight.shape[1] or self._rays.step_m != tiles.resolution_m:
            in_sight = np.ones((RAYS, steps), np.float32)
            self._rays = Rays(in_sight, self._rays.proven_m, tiles.resolution_m)
        return self._rays

    def bins(self, look: Look) -> Bins:
        """Numbers for each range bin of a look."""
        if len(look.kind) >= len(self._bins.expected):
            self._bins = _bins(len(look.kind))
        return self._bins

    def find(
        self,
        look: Look,
        tiles: Tiles,
        among: NDArray[np.float32],
        rays: Rays,
        next_wanted: NDArray[np.int32] | None = None,
    ) -> tuple[Seen, int]:
        """Cells in the cone of a look, of those that are not 0 in `among`.

        If `next_wanted` is given, those that reach into none of these range bins may be missing.
        `forget` them before the next are looked for.
        """
        if len(self._seen.place) != len(among):
            self._seen = _seen(len(self._seen.slot), np.full(len(among), -1, np.int32))
        if len(self._all_bins) <= len(look.kind):
            self._all_bins = np.arange(len(look.kind) + 1, dtype=np.int32)
        wanted = self._all_bins if next_wanted is None else next_wanted
        count = find_cells(look, tiles, among, self._seen)
        while count == len(self._seen.slot):
            self._seen = _seen(2 * count, self._seen.place)
            count = find_cells(look, tiles, among, self._seen)
        count = place_cells(look, tiles.resolution_m, wanted, rays, self._seen, count)
        return self._seen, count

    def see(
        self, look: Look, tiles: Tiles, depth: NDArray[np.float32], among: NDArray[np.float32]
    ) -> tuple[Seen, int]:
        """Cells that a look sees past what is in the way, of those that are not 0 in `among`."""
        rays = self.rays(look, tiles)
        cast_rays(look, tiles, depth, rays)
        return self.find(look, tiles, among, rays)

    def expect(
        self,
        look: Look,
        tiles: Tiles,
        depth: NDArray[np.float32],
        among: NDArray[np.float32],
        power: NDArray[np.float32],
    ) -> tuple[Seen, int, Contributions]:
        """Set what a look is expected to hear of the cells that it sees, in `bins`."""
        seen, count = self.see(look, tiles, depth, among)
        if count > len(self._parts.first_bin):
            self._parts = _contributions(2 * count)
        expect(look, seen, count, power, self._parts, self.bins(look))
        return seen, count, self._parts

    def find_sources(
        self, look: Look, tiles: Tiles, everywhere: NDArray[np.float32]
    ) -> tuple[Seen, int] | None:
        """Cells that may have returned an echo which is not expected; None if all echoes are.

        To be asked after `expect`; the same rays count.
        """
        if len(self._unexplained) <= len(look.kind):
            self._unexplained = np.empty(len(look.kind) + 1, np.int32)
        if not find_unexplained(look, self.bins(look), self._unexplained):
            return None
        return self.find(look, tiles, everywhere, self.rays(look, tiles), self._unexplained)


def _seen(cells: int, place: NDArray[np.int32]) -> Seen:
    slot, row, column, ray = (np.empty(cells, np.int64) for _ in range(4))
    low, high = (np.empty((cells, QUARTERS), np.float32) for _ in range(2))
    bearing, density, weight = (np.empty(cells, np.float32) for _ in range(3))
    heard = np.empty((cells, QUARTERS), np.bool_)
    return Seen(slot, row, column, ray, bearing, low, high, density, heard, weight, place)


def _contributions(cells: int) -> Contributions:
    parts = np.empty((cells, CELL_BINS), np.float32)
    first_bin, columns = (np.zeros(cells, np.int64) for _ in range(2))
    return Contributions(first_bin, columns, parts, np.empty(BLOCK_BINS))


def _bins(count: int) -> Bins:
    # One more than there are bins: sums before each, and of all.
    expected, squares, log_likelihood = (np.empty(count + 1) for _ in range(3))
    return Bins(expected, squares, log_likelihood, np.empty((count + 1, GRADIENTS)))
