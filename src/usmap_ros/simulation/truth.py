"""The truth map of a scene: what a map made from its echoes is scored against."""

import numpy as np

from usmap_ros.bounds import MAX_MAP_SIDE
from usmap_ros.errors import UsmapError
from usmap_ros.grids import FREE_PROBABILITY, OCCUPIED_PROBABILITY, GridGeometry, TruthMap
from usmap_ros.io.nav2_map import Nav2Map
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.simulation.motion import Bounds
from usmap_ros.simulation.scene import Scene

#: Distance between the points that trace an outline, in cells.
_SAMPLING = 0.1


def build_truth_map(
    scene: Scene, area: Bounds, plan: Nav2Map | None, resolution_m: float
) -> TruthMap:
    """Cells that hold the surface of something that stands.

    Parameters
    ----------
    scene : Scene
        Discs, walls and facets; what moves is left out.
    area : (x_min, x_max, y_min, y_max)
        To be covered; the map's origin is the next multiple of the resolution below.
    plan : Nav2Map or None
        The world's map; of its occupied cells those count that have a free one among their
        eight neighbours: what is deeper inside no sound can reach.
    resolution_m : float
        Side of a cell.

    Raises
    ------
    UsmapError
        If it would have more than `MAX_MAP_SIDE` rows or columns.
    """
    walls = scene.walls
    # Those of a map have one side; the cells behind them are what counts.
    thin = ~walls.one_sided
    outlines = [
        _disc_outlines(scene.discs.centers_m, scene.discs.radii_m, resolution_m),
        _disc_outlines(scene.reflectors.centers_m[:, :2], scene.reflectors.radii_m, resolution_m),
        _along(walls.starts_m[thin], walls.ends_m[thin], resolution_m),
    ]
    if plan is not None:
        outlines.append(_cell_samples(plan, resolution_m))
    # Cell borders are multiples of a number that has no exact binary form.
    index = np.floor(np.concatenate(outlines) / resolution_m + 1e-9).astype(np.int64)
    lowest = np.floor(np.array(area[0::2]) / resolution_m + 1e-9).astype(np.int64)
    highest = np.ceil(np.array(area[1::2]) / resolution_m - 1e-9).astype(np.int64)
    if len(index):
        lowest = np.minimum(lowest, index.min(axis=0))
        highest = np.maximum(highest, index.max(axis=0) + 1)
    columns, rows = highest - lowest
    if max(columns, rows) > MAX_MAP_SIDE:
        raise UsmapError(
            f"world: a truth map of {columns} x {rows} cells is larger than {MAX_MAP_SIDE} a side;"
            " choose a coarser resolution"
        )
    occupied = np.zeros((rows, columns), dtype=bool)
    occupied[index[:, 1] - lowest[1], index[:, 0] - lowest[0]] = True
    origin = (float(lowest[0] * resolution_m), float(lowest[1] * resolution_m))
    return TruthMap(GridGeometry(resolution_m, origin, (int(rows), int(columns))), occupied)


def _disc_outlines(centers_m: FloatArray, radii_m: FloatArray, resolution_m: float) -> FloatArray:
    """Points around every disc, close enough to touch each cell that it passes through."""
    outlines = [np.zeros((0, 2))]
    for center, radius in zip(centers_m, radii_m, strict=True):
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


def _cell_samples(plan: Nav2Map, resolution_m: float) -> FloatArray:
    """Points inside those occupied cells of a map that border on free ones."""
    # Here, because few worlds are maps, and it takes as long to load as all the rest.
    from scipy.ndimage import maximum_filter

    near_free = maximum_filter(plan.probability <= FREE_PROBABILITY, size=3)
    rows, columns = np.nonzero((plan.probability >= OCCUPIED_PROBABILITY) & near_free)
    centers = plan.geometry.cell_centers_m(rows, columns)
    side = plan.geometry.resolution_m
    # Two points or more in each of the finer cells, none on their borders.
    count = max(1, int(np.ceil(2.0 * side / resolution_m)) - 1)
    offsets = side * ((np.arange(count) + 0.5) / count - 0.5)
    grid = np.stack(np.meshgrid(offsets, offsets), axis=-1).reshape(1, -1, 2)
    return (centers[:, np.newaxis] + grid).reshape(-1, 2)
