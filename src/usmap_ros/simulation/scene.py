"""The world that is sounded out: discs, walls, their roughness, and what moves."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from usmap_ros.grids import GridGeometry
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.parameters import ParameterGroup, quantity
from usmap_ros.simulation.occlusion import path_wall_distances, point_segment_distances
from usmap_ros.simulation.polyline import Point, Polyline
from usmap_ros.simulation.reflectors import Reflectors
from usmap_ros.simulation.surfaces import WallScatterers, WallSegments


@dataclass(frozen=True)
class Discs:
    """Upright cylinders seen from above; points are discs of radius 0."""

    #: (n, 2) array: where they stand.
    centers_m: FloatArray
    #: (n,) array: radius of each disc; 0 for a point.
    radii_m: FloatArray
    #: (n,) array: each echoes like a point target of this reflectivity at the nearest point of its
    #: surface.
    reflectivities: FloatArray

    @classmethod
    def joined(cls, parts: list[Discs]) -> Discs:
        """All discs of several collections, in order."""
        return cls(
            np.concatenate([np.zeros((0, 2)), *(part.centers_m for part in parts)]),
            np.concatenate([np.zeros(0), *(part.radii_m for part in parts)]),
            np.concatenate([np.zeros(0), *(part.reflectivities for part in parts)]),
        )

    def __len__(self) -> int:
        return len(self.centers_m)


class MovingDisc(ParameterGroup):
    """A disc that moves along waypoints."""

    waypoints_m: list[Point] = quantity(..., "x, y of each waypoint.", "m", min_length=2)
    loop: bool = quantity(True, "Whether it goes round; otherwise it stays at the end.")
    speed_m_s: float = quantity(0.5, "Speed.", "m/s", ge=0.0, le=100.0)
    radius_m: float = quantity(0.2, "Radius; 0: a point.", "m", ge=0.0, le=10.0)
    reflectivity: float = quantity(1.0, "As a point target.", gt=0.0, le=100.0)

    @cached_property
    def _path(self) -> Polyline:
        return Polyline(np.array(self.waypoints_m), self.loop)

    def at(self, time_s: float) -> Discs:
        """The disc at a time after the scene's start."""
        position, _ = self._path.at(self.speed_m_s * time_s)
        return Discs(position[np.newaxis], np.array([self.radius_m]), np.array([self.reflectivity]))


@dataclass(frozen=True)
class FreeCells:
    """Cells of a map that are known to be free."""

    geometry: GridGeometry
    #: (rows, columns) bool array: neither occupied nor unknown.
    free: BoolArray

    def contains(self, position_m: FloatArray) -> bool:
        """Whether a position (2,) is in a free cell."""
        origin, resolution = np.array(self.geometry.origin_m), self.geometry.resolution_m
        column, row = np.floor((position_m - origin) / resolution).astype(int)
        rows, columns = self.geometry.shape
        return bool(0 <= row < rows and 0 <= column < columns and self.free[row, column])


@dataclass(frozen=True)
class Scene:
    """Everything that can echo or stand in the way."""

    #: Points and cylinders that stand still.
    discs: Discs
    #: Wall segments, those of a map among them.
    walls: WallSegments
    scatterers: WallScatterers
    #: What moves.  Robots' paths do not keep clear of it.
    moving: list[MovingDisc] = field(default_factory=list)
    #: Where robots and random poles may be put down; None: anywhere.
    free_space: FreeCells | None = None
    #: Balls and facets, which hide nothing and stand in nobody's way.
    reflectors: Reflectors = field(default_factory=Reflectors.none)
    #: Whether sound reaches objects by way of walls too.
    wall_paths: bool = False
    #: Most walls that sound is returned by in turn.
    wall_bounces: int = 1
    #: Ends of walls, as far as they answer by themselves, from wherever they are heard.
    edges: WallScatterers = field(default_factory=lambda: WallScatterers.joined([]))

    def discs_at(self, time_s: float) -> Discs:
        """All discs, the moving ones where they are at a time after the scene's start."""
        if not self.moving:
            return self.discs
        return Discs.joined([self.discs, *(disc.at(time_s) for disc in self.moving)])

    def has_room(self, position_m: FloatArray, clearance_m: float) -> bool:
        """Whether something may be put down at a position (2,) that needs `clearance_m` around."""
        if self.free_space is not None and not self.free_space.contains(position_m):
            return False
        return self.clearance_m(position_m, position_m) >= clearance_m

    def clearance_m(self, start_m: FloatArray, end_m: FloatArray) -> float:
        """Distance between a straight stretch of path and the nearest thing that stands still.

        0 or less where the path touches or crosses it; infinite in an empty scene.
        """
        to_walls = path_wall_distances(start_m, end_m, self.walls.starts_m, self.walls.ends_m)
        to_discs = point_segment_distances(self.discs.centers_m, start_m, end_m)
        nearest = np.concatenate([to_walls, to_discs - self.discs.radii_m, [np.inf]]).min()
        return float(nearest)
