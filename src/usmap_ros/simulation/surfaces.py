"""Extended surfaces: walls, what they scatter back, and the walls of an occupancy map.

A wall answers in two ways.  Its flat part is a mirror: the echo comes from the foot of the
perpendicular, and the image of the transducer is heard at twice the distance.  Its roughness
scatters in all directions: scatterers sit along it at positions and with strengths that are drawn
once for a scene, so that from ping to ping their echoes interfere as those of a real surface do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usmap_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from usmap_ros.numerics.geometry import left_normals
from usmap_ros.parameters import ParameterGroup, quantity

#: Ends of walls that are nearer to each other are one.
_SAME_END_M = 1e-3


class Surface(ParameterGroup):
    """How walls return sound."""

    specular_reflectivity: float = quantity(
        0.2,
        "Amplitude reflectivity as a mirror, heard where a wall is struck squarely.",
        ge=0.0,
        le=1.0,
    )
    diffuse_reflectivity: float = quantity(
        2.5,
        "RMS reflectivity, in terms of point targets, of a metre of wall struck squarely;"
        " a length L scatters √L times this.",
        "m^-1/2",
        ge=0.0,
        le=100.0,
    )
    scatterers_per_m: float = quantity(
        40.0, "Density of the scatterers that stand for the roughness.", "1/m", gt=0.0, le=1000.0
    )
    roughness_m: float = quantity(
        0.005, "Depth over which the scatterers are spread.", "m", ge=0.0, le=0.1
    )
    edge_reflectivity: float = quantity(
        0.0, "Of either end of a wall, which diffracts, as a point target.", ge=0.0, le=100.0
    )


@dataclass(frozen=True)
class WallSegments:
    """Straight wall segments."""

    #: (n, 2) arrays: end points.  The front is on the left hand of one who walks from start to end.
    starts_m: FloatArray
    ends_m: FloatArray
    #: (n,) bool array: whether only the front can be seen, as of the walls of a map.
    one_sided: BoolArray
    #: (n,) array: amplitude that each wall reflects as a mirror; see `Surface`.
    specular_reflectivity: FloatArray

    @classmethod
    def along(
        cls, corners_m: FloatArray, surface: Surface, *, one_sided: bool = False
    ) -> WallSegments:
        """Walls from each corner to the next; `corners_m` has shape (n + 1, 2)."""
        return cls.between(corners_m[:-1], corners_m[1:], surface, one_sided=one_sided)

    @classmethod
    def between(
        cls, starts_m: FloatArray, ends_m: FloatArray, surface: Surface, *, one_sided: bool
    ) -> WallSegments:
        """Walls of one surface between given end points."""
        count = len(starts_m)
        specular = np.full(count, surface.specular_reflectivity)
        return cls(starts_m, ends_m, np.full(count, one_sided), specular)

    @classmethod
    def joined(cls, parts: list[WallSegments]) -> WallSegments:
        """All walls of several collections, in order."""
        ends = np.zeros((0, 2))
        return cls(
            np.concatenate([ends, *(part.starts_m for part in parts)]),
            np.concatenate([ends, *(part.ends_m for part in parts)]),
            np.concatenate([np.zeros(0, dtype=bool), *(part.one_sided for part in parts)]),
            np.concatenate([np.zeros(0), *(part.specular_reflectivity for part in parts)]),
        )

    def __len__(self) -> int:
        return len(self.starts_m)

    @property
    def normals(self) -> FloatArray:
        """Unit vectors towards the front, shape (n, 2)."""
        return left_normals(self.starts_m, self.ends_m)


@dataclass(frozen=True)
class WallScatterers:
    """Points of rough walls."""

    #: (n, 2) array: where they are.
    positions_m: FloatArray
    #: (n,) array: of each, struck squarely.
    reflectivities: FloatArray
    #: (n,) int array: index of the wall that each lies on.
    walls: IntArray

    def of_walls_from(self, first: int) -> WallScatterers:
        """The same on walls that are counted from `first` on."""
        return WallScatterers(self.positions_m, self.reflectivities, self.walls + first)

    @classmethod
    def joined(cls, parts: list[WallScatterers]) -> WallScatterers:
        """All scatterers of several collections, in order."""
        return cls(
            np.concatenate([np.zeros((0, 2)), *(part.positions_m for part in parts)]),
            np.concatenate([np.zeros(0), *(part.reflectivities for part in parts)]),
            np.concatenate([np.zeros(0, dtype=np.int64), *(part.walls for part in parts)]),
        )


def scatterer_counts(walls: WallSegments, surface: Surface) -> IntArray:
    """How many scatterers `scatter_along` draws on each of `walls`."""
    if surface.diffuse_reflectivity == 0.0:
        return np.zeros(len(walls), dtype=np.int64)
    lengths = np.linalg.norm(walls.ends_m - walls.starts_m, axis=-1)
    counts: IntArray = np.ceil(lengths * surface.scatterers_per_m).astype(np.int64)
    return counts


def scatter_along(
    walls: WallSegments, surface: Surface, rng: np.random.Generator
) -> WallScatterers:
    """Draw the scatterers of `walls`: one at random in every stretch of 1 / density.

    Strengths are Rayleigh distributed, as the sum of many small facets is.
    """
    lengths = np.linalg.norm(walls.ends_m - walls.starts_m, axis=-1)
    counts = scatterer_counts(walls, surface)
    owners = np.repeat(np.arange(len(walls)), counts)
    rank = np.arange(len(owners)) - np.repeat(np.cumsum(counts) - counts, counts)
    fraction = (rank + rng.random(len(owners))) / counts[owners]
    along = fraction[:, np.newaxis] * (walls.ends_m - walls.starts_m)[owners]
    # Outwards, so that a neighbouring wall around a corner does not hide them.
    depth = surface.roughness_m * rng.random(len(owners))
    positions = walls.starts_m[owners] + along + depth[:, np.newaxis] * walls.normals[owners]
    rms = surface.diffuse_reflectivity * np.sqrt(lengths[owners] / counts[owners])
    return WallScatterers(positions, rng.rayleigh(rms / np.sqrt(2.0)), owners)


def edges_of(walls: WallSegments, surface: Surface) -> WallScatterers:
    """Ends of walls, where sound is diffracted; an end that walls share counts once.

    They stand a millimetre in front of their walls, which therefore do not hide them.
    """
    if surface.edge_reflectivity == 0.0:
        return WallScatterers.joined([])
    ends_m = np.concatenate([walls.starts_m, walls.ends_m])
    owners = np.tile(np.arange(len(walls)), 2)
    _, first = np.unique(np.round(ends_m / _SAME_END_M), axis=0, return_index=True)
    first.sort()
    positions_m = ends_m[first] + _SAME_END_M * walls.normals[owners[first]]
    strengths = np.full(len(first), surface.edge_reflectivity)
    return WallScatterers(positions_m, strengths, owners[first])


def walls_of_cells(
    occupied: BoolArray, resolution_m: float, origin_m: tuple[float, float]
) -> tuple[FloatArray, FloatArray]:
    """Edges between occupied and other cells, straight runs merged into one.

    Parameters
    ----------
    occupied : (rows, columns) bool array
        Row 0 at the lowest y.
    resolution_m : float
        Side of a cell.
    origin_m : (float, float)
        Lower-left corner of cell (0, 0).

    Returns
    -------
    starts_m, ends_m : (n, 2) arrays
        End points, the open side on the left hand.
    """
    padded = np.pad(occupied, 1)
    below, above = padded[:-1, 1:-1], padded[1:, 1:-1]
    left, right = padded[1:-1, :-1], padded[1:-1, 1:]
    # Walking towards +x the left hand points to +y; towards +y it points to -x.
    starts, ends = zip(
        _runs(below & ~above, reverse=False, swap=False),
        _runs(above & ~below, reverse=True, swap=False),
        _runs((right & ~left).T, reverse=False, swap=True),
        _runs((left & ~right).T, reverse=True, swap=True),
        strict=True,
    )
    offset = np.asarray(origin_m)
    return (
        np.concatenate(starts) * resolution_m + offset,
        np.concatenate(ends) * resolution_m + offset,
    )


def _runs(edges: BoolArray, *, reverse: bool, swap: bool) -> tuple[FloatArray, FloatArray]:
    """Start and end (x, y in cells) of the runs of True along each row of `edges`.

    `swap` exchanges x and y, for edges that were transposed; `reverse` exchanges start and end.
    """
    steps = np.diff(np.pad(edges, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    rows, firsts = np.nonzero(steps == 1)
    lasts = np.nonzero(steps == -1)[1]
    order = slice(None, None, -1) if swap else slice(None)
    starts = np.stack([firsts, rows], axis=-1)[:, order].astype(float)
    ends = np.stack([lasts, rows], axis=-1)[:, order].astype(float)
    return (ends, starts) if reverse else (starts, ends)
