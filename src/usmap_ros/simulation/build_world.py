"""From the world section of a scenario to the scene, its bounds and its truth map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from usmap_ros.errors import UsmapError
from usmap_ros.grids import GridGeometry, TruthMap
from usmap_ros.simulation.motion import Bounds
from usmap_ros.simulation.scene import Discs, Scene
from usmap_ros.simulation.surfaces import Scatterers, Walls, scatter_along, walls_of_cells
from usmap_ros.simulation.world import RandomPolesModel, SurfaceModel, WorldModel

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: How often the place of a random pole is redrawn.
_POLE_ATTEMPTS = 10_000
#: Distance between the points that trace an outline, in cells.
_SAMPLING = 0.1


def build_scene(world: WorldModel, cells: TruthMap | None, seed: np.random.SeedSequence) -> Scene:
    """The scene of a world.

    Parameters
    ----------
    world : WorldModel
        What stands where.
    cells : TruthMap or None
        Occupied cells of the world's map.
    seed : numpy.random.SeedSequence
        For the random poles and the roughness of the walls.

    Raises
    ------
    UsmapError
        If the random poles do not fit.
    """
    pole_seed, roughness_seed = seed.spawn(2)
    walls, scatterers = _rough_walls(world, cells, np.random.default_rng(roughness_seed))
    stated = [*world.points, *world.cylinders]
    discs = Discs(
        np.array([(disc.x_m, disc.y_m) for disc in stated]).reshape(-1, 2),
        np.array([getattr(disc, "radius_m", 0.0) for disc in stated]),
        np.array([disc.reflectivity for disc in stated]),
    )
    scene = Scene(discs, walls, scatterers, [disc.build() for disc in world.moving])
    if world.random_poles is None:
        return scene
    poles = _random_poles(
        world.random_poles, scene, world_bounds(world, cells), np.random.default_rng(pole_seed)
    )
    return Scene(Discs.joined([discs, poles]), walls, scatterers, scene.moving)


def world_bounds(world: WorldModel, cells: TruthMap | None) -> Bounds:
    """Lowest and highest x, lowest and highest y of a world.

    Raises
    ------
    UsmapError
        If nothing stands there that could have bounds.
    """
    if world.area_m is not None:
        return world.area_m
    corners = [corner for wall in world.walls for corner in wall.corners_m]
    corners += [(point.x_m, point.y_m) for point in world.points]
    for cylinder in world.cylinders:
        radius = cylinder.radius_m
        corners += [(cylinder.x_m - radius, cylinder.y_m - radius)]
        corners += [(cylinder.x_m + radius, cylinder.y_m + radius)]
    if cells is not None:
        x_min, x_max, y_min, y_max = cells.geometry.extent_m
        corners += [(x_min, y_min), (x_max, y_max)]
    if not corners:
        raise UsmapError("world.area_m: is needed, since nothing stands that has a place")
    x, y = np.array(corners).T
    return float(x.min()), float(x.max()), float(y.min()), float(y.max())


def _rough_walls(
    world: WorldModel, cells: TruthMap | None, rng: np.random.Generator
) -> tuple[Walls, Scatterers]:
    parts: list[tuple[Walls, SurfaceModel]] = []
    for wall in world.walls:
        corners = [*wall.corners_m, wall.corners_m[0]] if wall.closed else wall.corners_m
        surface = wall.surface or world.surface
        parts.append((Walls.along(np.array(corners), surface.build()), surface))
    if cells is not None and world.map is not None:
        surface = world.map.surface or world.surface
        geometry = cells.geometry
        starts, ends = walls_of_cells(cells.occupied, geometry.resolution_m, geometry.origin_m)
        parts.append((Walls.between(starts, ends, surface.build(), one_sided=True), surface))
    drawn, first = [], 0
    for walls, surface in parts:
        part = scatter_along(walls, surface.build(), rng)
        drawn.append(Scatterers(part.positions_m, part.reflectivities, part.walls + first))
        first += len(walls)
    return Walls.joined([walls for walls, _ in parts]), Scatterers.joined(drawn)


def _random_poles(
    model: RandomPolesModel, scene: Scene, area: Bounds, rng: np.random.Generator
) -> Discs:
    """Poles drawn one by one where there is room for them."""
    spread, median = model.reflectivity_spread, model.median_reflectivity
    reflectivities = median * np.exp(spread * rng.standard_normal(model.count))
    centers: FloatArray = np.zeros((0, 2))
    for _ in range(_POLE_ATTEMPTS):
        if len(centers) == model.count:
            return Discs(centers, np.full(model.count, model.radius_m), reflectivities)
        center = rng.uniform(area[0::2], area[1::2])
        apart = np.hypot(*(centers - center).T)
        if np.all(apart >= model.separation_m):
            room = scene.clearance_m(center, center)
            if room >= max(model.radius_m, model.separation_m / 2.0):
                centers = np.concatenate([centers, center[np.newaxis]])
    raise UsmapError(
        f"world.random_poles: only {len(centers)} of {model.count} fit"
        f" {model.separation_m:g} m apart"
    )


def build_truth_map(
    scene: Scene, area: Bounds, cells: TruthMap | None, resolution_m: float
) -> TruthMap:
    """Cells that hold the surface of something that stands.

    Parameters
    ----------
    scene : Scene
        The world.
    area : (x_min, x_max, y_min, y_max)
        To be covered; the map's origin is the next multiple of the resolution below.
    cells : TruthMap or None
        Occupied cells of the world's map; of these, the ones with an open side count.
    resolution_m : float
        Side of a cell.
    """
    outlines = [_disc_outlines(scene.discs, resolution_m)]
    drawn = ~scene.walls.one_sided
    outlines.append(_along(scene.walls.starts_m[drawn], scene.walls.ends_m[drawn], resolution_m))
    if cells is not None:
        outlines.append(_cell_samples(cells, resolution_m))
    index = np.floor(np.concatenate(outlines) / resolution_m + 1e-9).astype(np.int64)
    lowest = np.floor(np.array(area[0::2]) / resolution_m + 1e-9).astype(np.int64)
    highest = np.ceil(np.array(area[1::2]) / resolution_m - 1e-9).astype(np.int64)
    if len(index):
        lowest = np.minimum(lowest, index.min(axis=0))
        highest = np.maximum(highest, index.max(axis=0) + 1)
    columns, rows = highest - lowest
    occupied = np.zeros((rows, columns), dtype=bool)
    occupied[index[:, 1] - lowest[1], index[:, 0] - lowest[0]] = True
    origin = (float(lowest[0] * resolution_m), float(lowest[1] * resolution_m))
    return TruthMap(GridGeometry(resolution_m, origin, (int(rows), int(columns))), occupied)


def _disc_outlines(discs: Discs, resolution_m: float) -> FloatArray:
    """Points around every disc, close enough to touch each cell that it passes through."""
    outlines = [np.zeros((0, 2))]
    for center, radius in zip(discs.centers_m, discs.radii_m, strict=True):
        count = max(1, int(np.ceil(2.0 * np.pi * radius / (_SAMPLING * resolution_m))))
        angle = 2.0 * np.pi * np.arange(count) / count
        outlines.append(center + radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1))
    return np.concatenate(outlines)


def _along(starts_m: FloatArray, ends_m: FloatArray, resolution_m: float) -> FloatArray:
    """Points along every wall, close enough to touch each cell that it passes through."""
    points = [np.zeros((0, 2))]
    for start, end in zip(starts_m, ends_m, strict=True):
        count = 2 + int(np.hypot(*(end - start)) / (_SAMPLING * resolution_m))
        points.append(np.linspace(start, end, count))
    return np.concatenate(points)


def _cell_samples(cells: TruthMap, resolution_m: float) -> FloatArray:
    """Points inside those occupied cells of a map that have an open side."""
    padded = np.pad(cells.occupied, 1)
    enclosed = padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:]
    rows, columns = np.nonzero(cells.occupied & ~enclosed)
    centers = cells.geometry.cell_centers_m(rows, columns)
    side = cells.geometry.resolution_m
    count = max(1, int(np.ceil(2.0 * side / resolution_m)))
    offsets = side * ((np.arange(count) + 0.5) / count - 0.5)
    grid = np.stack(np.meshgrid(offsets, offsets), axis=-1).reshape(1, -1, 2)
    return (centers[:, np.newaxis] + grid).reshape(-1, 2)
