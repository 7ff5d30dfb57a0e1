"""Which cells pings can have reached, where occupied cells stop sound and sight."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usmap_ros.grids import GridGeometry
from usmap_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from usmap_ros.pings.fields_of_view import PingViews

#: Distance between neighbouring rays where they end, in cells.
_RAY_SPACING_CELLS = 0.5
#: Cells that the windows of the pings of one chunk may have together.
_CHUNK_CELLS = 4_000_000
#: Of the angle between a ray and an axis; what is smaller never comes to the next border.
_SMALLEST_COSINE = 1e-12
#: Steps of all rays after which the ones that have ended are left out.
_STEPS_BETWEEN_CULLS = 4


def pings_in_sight(occupied: BoolArray, geometry: GridGeometry, views: PingViews) -> IntArray:
    """How many pings have each cell in line of sight, within their beams and maximum ranges.

    Rays go from each ping through every cell that they touch, half a cell apart where they end.
    An occupied cell is in sight if a ray reaches it, and ends that ray. The cell that a
    ping stands in stops nothing. The grid's surroundings are empty.

    Parameters
    ----------
    occupied : (rows, columns) bool array
        Cells that stop sound.
    geometry : GridGeometry
        Where the cells lie.
    views : PingViews
        Where each ping was sent from, and its beam.

    Returns
    -------
    counts : (rows, columns) int array
        Pings that reach each cell.
    """
    origin_m, resolution_m = np.array(geometry.origin_m), geometry.resolution_m
    # From here on, lengths are in cells.
    places = (views.positions_m - origin_m) / resolution_m
    yaws, half_angles = views.beams[:, 0], np.minimum(views.beams[:, 1], np.pi)
    size = np.array(geometry.shape[::-1], dtype=float)
    nearest = np.hypot(*np.maximum(np.maximum(-places, places - size), 0.0).T)
    farthest = np.hypot(*np.maximum(np.abs(places), np.abs(places - size)).T)
    reaches = views.beams[:, 2] / resolution_m
    kept = np.flatnonzero(nearest <= reaches)
    counts = np.zeros(geometry.shape, dtype=np.int64)
    if not len(kept):
        return counts
    reaches = np.minimum(reaches, farthest)
    radius = int(np.ceil(reaches[kept].max())) + 1
    per_chunk = max(1, _CHUNK_CELLS // (2 * radius + 1) ** 2)
    for first in range(0, len(kept), per_chunk):
        chunk = kept[first : first + per_chunk]
        windows = _Windows.around(places[chunk], radius)
        seen = _cast(
            windows.cut(occupied), places[chunk] - windows.corners,
            yaws[chunk], half_angles[chunk], reaches[chunk],
        )  # fmt: skip
        windows.add_to(counts, seen)
    return counts


@dataclass(frozen=True)
class _Windows:
    """Squares of cells around pings: lowest column and row of each, shape (pings, 2)."""

    corners: IntArray
    side: int

    @classmethod
    def around(cls, places: FloatArray, radius: int) -> _Windows:
        return cls(np.floor(places).astype(np.int64) - radius, 2 * radius + 1)

    def cut(self, cells: BoolArray) -> BoolArray:
        """Each window's part of a grid, False beyond its borders."""
        windows = np.zeros((len(self.corners), self.side, self.side), dtype=bool)
        for window, corner in zip(windows, self.corners, strict=True):
            inside, outside = self._overlap(corner, cells.shape)
            window[inside] = cells[outside]
        return windows

    def add_to(self, counts: IntArray, windows: BoolArray) -> None:
        """Add windows to a grid."""
        for window, corner in zip(windows, self.corners, strict=True):
            inside, outside = self._overlap(corner, counts.shape)
            counts[outside] += window[inside]

    def _overlap(
        self, corner: IntArray, shape: tuple[int, ...]
    ) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
        """The common part of window and grid, as slices of either."""
        inside, outside = [], []
        for first, length in zip((int(corner[1]), int(corner[0])), shape, strict=True):
            low, high = max(first, 0), max(min(first + self.side, length), 0)
            high = max(high, low)
            inside.append(slice(low - first, high - first))
            outside.append(slice(low, high))
        return (inside[0], inside[1]), (outside[0], outside[1])


def _cast(
    occupied: BoolArray,
    places: FloatArray,
    yaws: FloatArray,
    half_angles: FloatArray,
    reaches: FloatArray,
) -> BoolArray:
    """Cells that each ping's rays reach, in a window of its own.

    Exact traversal of the grid (Amanatides & Woo, "A fast voxel traversal algorithm for ray
    tracing", Eurographics 1987), so that no ray slips between two cells that touch at a corner.

    Parameters
    ----------
    occupied : (pings, side, side) bool array
        What stops rays.
    places : (pings, 2) array
        Column and row of each ping in its window, in cells.
    yaws, half_angles, reaches : (pings,) arrays
        Radians, and cells.

    Returns
    -------
    seen : (pings, side, side) bool array
    """
    pings, side, _ = occupied.shape
    angles, owners = _rays(yaws, half_angles, reaches)
    directions = np.stack([np.cos(angles), np.sin(angles)])
    start = places[owners].T
    cells = np.floor(start)
    steps = np.where(directions > 0.0, 1, -1)
    # Way along the ray across a cell, and to the next border, in x and in y.
    across = 1.0 / np.maximum(np.abs(directions), _SMALLEST_COSINE)
    borders = np.where(directions > 0.0, cells + 1.0 - start, start - cells) * across
    strides = steps * np.array([[1], [side]])
    index = (owners * side + cells[1].astype(np.int64)) * side + cells[0].astype(np.int64)
    blocked, seen = occupied.ravel(), np.zeros(occupied.size, dtype=bool)
    seen[index] = True
    ends = reaches[owners]
    while len(index):
        for _ in range(_STEPS_BETWEEN_CULLS):
            along_x = borders[0] <= borders[1]
            way = np.where(along_x, borders[0], borders[1])
            # A ray that has ended stays where it is.
            going = way <= ends
            index = index + going * np.where(along_x, strides[0], strides[1])
            borders[0] += along_x * across[0]
            borders[1] += ~along_x * across[1]
            seen[index] = True
            ends = np.where(going & ~blocked[index], ends, -1.0)
        alive = ends >= 0.0
        index, ends = index[alive], ends[alive]
        borders, across, strides = borders[:, alive], across[:, alive], strides[:, alive]
    return seen.reshape(pings, side, side)


def _rays(
    yaws: FloatArray, half_angles: FloatArray, reaches: FloatArray
) -> tuple[FloatArray, IntArray]:
    """Directions of all rays, and the ping each starts from."""
    counts = np.ceil(2.0 * half_angles * reaches / _RAY_SPACING_CELLS).astype(np.int64) + 2
    owners = np.repeat(np.arange(len(yaws)), counts)
    within = np.arange(len(owners)) - np.repeat(np.cumsum(counts) - counts, counts)
    share = within / (counts[owners] - 1)
    return yaws[owners] + half_angles[owners] * (2.0 * share - 1.0), owners
