"""Arrays that every visit to a ping needs, made once and enlarged when they must be."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.superposition.cells import QUARTERS, Rays, Seen, Tiles, find_cells, forget
from usmap_ros.mapping.superposition.look import Look
from usmap_ros.mapping.superposition.powers import (
    BLOCK_BINS,
    CELL_BINS,
    Bins,
    Contributions,
    expect,
    split_expected,
)
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
        self, look: Look, tiles: Tiles, alive: NDArray[np.float32], rays: Rays
    ) -> tuple[Seen, int]:
        """Cells in the cone of a look; `forget` them before the next are looked for."""
        if len(self._seen.place) != len(alive):
            self._seen = _seen(len(self._seen.slot), np.full(len(alive), -1, np.int32))
        count = find_cells(look, tiles, alive, rays, self._seen)
        while count == len(self._seen.slot):
            forget(self._seen, count)
            self._seen = _seen(2 * count, self._seen.place)
            count = find_cells(look, tiles, alive, rays, self._seen)
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
        parts = self.parts(count)
        split_expected(look, seen, count, power, parts)
        expect(look, count, parts, self.bins(look))
        return seen, count, parts

    def parts(self, count: int) -> Contributions:
        """Room for the contributions of so many cells."""
        if count > len(self._parts.first_bin):
            self._parts = _contributions(2 * count)
        return self._parts


def _seen(cells: int, place: NDArray[np.int32]) -> Seen:
    slot, row, column, ray, side = (np.empty(cells, np.int64) for _ in range(5))
    low, high = (np.empty((cells, QUARTERS), np.float32) for _ in range(2))
    bearing, sharpness, weight = (np.empty(cells, np.float32) for _ in range(3))
    return Seen(slot, row, column, ray, side, bearing, low, high, sharpness, weight, place)


def _contributions(cells: int) -> Contributions:
    parts = np.empty((cells, CELL_BINS), np.float32)
    first_bin, columns = (np.zeros(cells, np.int64) for _ in range(2))
    return Contributions(first_bin, columns, parts, np.empty(BLOCK_BINS))


def _bins(count: int) -> Bins:
    # One more than there are bins: sums before each, and of all.
    return Bins(*(np.empty(count + 1) for _ in range(5)))
