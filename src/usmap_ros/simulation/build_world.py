"""From the world section of a scenario to the scene and its bounds."""

from dataclasses import replace

import numpy as np

from usmap_ros.bounds import MAX_SCATTERERS
from usmap_ros.errors import UsmapError
from usmap_ros.grids import FREE_PROBABILITY, OCCUPIED_PROBABILITY
from usmap_ros.io.nav2_map import Nav2Map
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.simulation.models.world import PointModel, RandomPolesModel, WorldModel
from usmap_ros.simulation.motion import Bounds
from usmap_ros.simulation.reflectors import EVERYWHERE, Reflectors
from usmap_ros.simulation.scene import Discs, FreeCells, Scene
from usmap_ros.simulation.surfaces import (
    Surface,
    WallScatterers,
    WallSegments,
    edges_of,
    scatter_along,
    scatterer_counts,
    walls_of_cells,
)

#: How many places are tried on average for a random pole.
_ATTEMPTS_PER_POLE = 300


def build_scene(world: WorldModel, plan: Nav2Map | None, seed: np.random.SeedSequence) -> Scene:
    """The scene of a world.

    Parameters
    ----------
    world : WorldModel
        What stands where.
    plan : Nav2Map or None
        The world's map.
    seed : numpy.random.SeedSequence
        For the random poles and the roughness of the walls.

    Raises
    ------
    UsmapError
        If the random poles do not fit.
    """
    pole_seed, roughness_seed = seed.spawn(2)
    walls, scatterers, edges = _rough_walls(world, plan, np.random.default_rng(roughness_seed))
    scene = Scene(
        _stated_discs(world),
        walls,
        scatterers,
        world.moving,
        None if plan is None else FreeCells(plan.geometry, plan.probability <= FREE_PROBABILITY),
        _reflectors(world),
        world.wall_paths,
        world.wall_bounces,
        edges,
    )
    if world.random_poles is None:
        return scene
    area = world_bounds(world, plan)
    poles = _random_poles(world.random_poles, scene, area, np.random.default_rng(pole_seed))
    return replace(scene, discs=Discs.joined([scene.discs, poles]))


def _reflectors(world: WorldModel) -> Reflectors:
    balls, facets = world.balls, world.facets
    count = len(balls)
    places = [(ball.x_m, ball.y_m, ball.z_m) for ball in balls]
    places += [(one.x_m, one.y_m, np.nan if one.z_m is None else one.z_m) for one in facets]
    # A ball that states no reflectivity returns what a large rigid one would.
    strengths = [ball.reflectivity or 0.5 * ball.radius_m for ball in balls]
    turned = np.array([(one.normal_rad, one.elevation_rad) for one in facets]).reshape(-1, 2)
    azimuth, elevation = turned.T
    normals = np.zeros((count + len(facets), 3))
    normals[count:] = np.stack(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ],
        axis=-1,
    )
    return Reflectors(
        centers_m=np.array(places, dtype=float).reshape(-1, 3),
        radii_m=np.array([ball.radius_m for ball in balls] + [0.0] * len(facets)),
        reflectivities=np.array(strengths + [facet.reflectivity for facet in facets]),
        normals=normals,
        lobes_rad=np.array([EVERYWHERE] * count + [facet.lobe_rad for facet in facets]),
    )


def _stated_discs(world: WorldModel) -> Discs:
    stated: list[tuple[PointModel, float]] = [(point, 0.0) for point in world.points]
    stated += [(cylinder, cylinder.radius_m) for cylinder in world.cylinders]
    return Discs(
        np.array([(disc.x_m, disc.y_m) for disc, _ in stated]).reshape(-1, 2),
        np.array([radius for _, radius in stated]),
        np.array([disc.reflectivity for disc, _ in stated]),
    )


def world_bounds(world: WorldModel, plan: Nav2Map | None) -> Bounds:
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
    corners += [(ball.x_m, ball.y_m) for ball in world.balls]
    corners += [(facet.x_m, facet.y_m) for facet in world.facets]
    if plan is not None:
        x_min, x_max, y_min, y_max = plan.geometry.extent_m
        corners += [(x_min, y_min), (x_max, y_max)]
    if not corners:
        raise UsmapError("world.area_m: is needed, since nothing stands that has a place")
    x, y = np.array(corners).T
    return float(x.min()), float(x.max()), float(y.min()), float(y.max())


def _rough_walls(
    world: WorldModel, plan: Nav2Map | None, rng: np.random.Generator
) -> tuple[WallSegments, WallScatterers, WallScatterers]:
    parts: list[tuple[WallSegments, Surface]] = []
    for wall in world.walls:
        corners = [*wall.corners_m, wall.corners_m[0]] if wall.closed else wall.corners_m
        surface = wall.surface or world.surface
        parts.append((WallSegments.along(np.array(corners), surface), surface))
    if plan is not None and world.map is not None:
        surface = world.map.surface or world.surface
        occupied = plan.probability >= OCCUPIED_PROBABILITY
        geometry = plan.geometry
        starts, ends = walls_of_cells(occupied, geometry.resolution_m, geometry.origin_m)
        parts.append((WallSegments.between(starts, ends, surface, one_sided=True), surface))
    points = sum(scatterer_counts(walls, surface).sum() for walls, surface in parts)
    if points > MAX_SCATTERERS:
        raise UsmapError(
            f"world.walls: scatter from {points:.3g} points (length times scatterers_per_m), at"
            f" most {MAX_SCATTERERS} are simulated"
        )
    drawn, edges, first = [], [], 0
    for walls, surface in parts:
        drawn.append(scatter_along(walls, surface, rng).of_walls_from(first))
        edges.append(edges_of(walls, surface).of_walls_from(first))
        first += len(walls)
    walls = WallSegments.joined([walls for walls, _ in parts])
    return walls, WallScatterers.joined(drawn), WallScatterers.joined(edges)


def _random_poles(
    model: RandomPolesModel, scene: Scene, area: Bounds, rng: np.random.Generator
) -> Discs:
    """Poles drawn one by one where there is room for them."""
    spread, median = model.reflectivity_spread, model.median_reflectivity
    reflectivities = median * np.exp(spread * rng.standard_normal(model.count))
    centers: FloatArray = np.zeros((0, 2))
    for _ in range(_ATTEMPTS_PER_POLE * model.count):
        center = rng.uniform(area[0::2], area[1::2])
        apart = np.hypot(*(centers - center).T)
        room_m = max(model.radius_m, model.separation_m / 2.0)
        if np.all(apart >= model.separation_m) and scene.has_room(center, room_m):
            centers = np.concatenate([centers, center[np.newaxis]])
        if len(centers) == model.count:
            return Discs(centers, np.full(model.count, model.radius_m), reflectivities)
    raise UsmapError(
        f"world.random_poles: only {len(centers)} of {model.count} fit"
        f" {model.separation_m:g} m apart"
    )
