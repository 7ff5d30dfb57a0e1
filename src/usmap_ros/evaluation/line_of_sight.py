"""Which cells pings can have reached, where occupied cells stop sound and sight."""

import math

import numpy as np

from usmap_ros.grids import GridGeometry
from usmap_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from usmap_ros.numerics.compiled import compiled, compiled_within
from usmap_ros.pings.fields_of_view import PingViews

#: Distance between neighbouring rays where they end, in cells.
_RAY_SPACING_CELLS = 0.5
#: Of the angle between a ray and an axis; what is smaller never comes to the next border.
_SMALLEST_COSINE = 1e-12


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
    # From here on, lengths are in cells.
    places = (views.positions_m - np.array(geometry.origin_m)) / geometry.resolution_m
    yaws, half_angles = views.beams[:, 0], np.minimum(views.beams[:, 1], np.pi)
    size = np.array(geometry.shape[::-1], dtype=float)
    nearest = np.hypot(*np.maximum(np.maximum(-places, places - size), 0.0).T)
    farthest = np.hypot(*np.maximum(np.abs(places), np.abs(places - size)).T)
    reaches = views.beams[:, 2] / geometry.resolution_m
    kept = nearest <= reaches
    rays = np.column_stack([yaws, half_angles, np.minimum(reaches, farthest)])[kept]
    return _cast(np.ascontiguousarray(occupied), places[kept], rays)


@compiled
def _cast(occupied: BoolArray, places: FloatArray, beams: FloatArray) -> IntArray:
    """Count the pings whose rays reach each cell.

    Parameters
    ----------
    occupied : (rows, columns) bool array
        What stops rays.
    places : (pings, 2) array
        Column and row of each ping, in cells.
    beams : (pings, 3) array
        Direction and half-angle of each, radians, and how far it reaches, in cells.

    Returns
    -------
    counts : (rows, columns) int array
    """
    counts = np.zeros(occupied.shape, np.int64)
    # The last ping that reached each cell: several of its rays do.
    newest = np.full(occupied.shape, -1)
    for ping in range(len(places)):
        x, y = places[ping]
        yaw, half_angle, reach = beams[ping]
        rays = math.ceil(2.0 * half_angle * reach / _RAY_SPACING_CELLS) + 2
        for ray in range(rays):
            angle = yaw + half_angle * (2.0 * ray / (rays - 1) - 1.0)
            _follow(occupied, x, y, angle, reach, ping, newest, counts)
    return counts


@compiled_within
def _follow(
    occupied: BoolArray,
    x: float,
    y: float,
    angle: float,
    reach: float,
    ping: int,
    newest: IntArray,
    counts: IntArray,
) -> None:
    """Count a ping in each cell that one of its rays reaches, unless it is counted there.

    Exact traversal of the grid (Amanatides & Woo, "A fast voxel traversal algorithm for ray
    tracing", Eurographics 1987), so that no ray slips between two cells that touch at a corner.
    Lengths are in cells.
    """
    rows, columns = occupied.shape
    cosine, sine = math.cos(angle), math.sin(angle)
    own_column, own_row = math.floor(x), math.floor(y)
    column, row = own_column, own_row
    step_x, step_y = (1 if cosine > 0.0 else -1), (1 if sine > 0.0 else -1)
    # Way along the ray across a cell, and to the next border, in x and in y.
    across_x = 1.0 / max(abs(cosine), _SMALLEST_COSINE)
    across_y = 1.0 / max(abs(sine), _SMALLEST_COSINE)
    border_x = (column + 1.0 - x if cosine > 0.0 else x - column) * across_x
    border_y = (row + 1.0 - y if sine > 0.0 else y - row) * across_y
    way = 0.0
    while way <= reach:
        if 0 <= row < rows and 0 <= column < columns:
            if newest[row, column] != ping:
                newest[row, column] = ping
                counts[row, column] += 1
            # The cell that the ping stands in stops nothing.
            if occupied[row, column] and (column != own_column or row != own_row):
                break
        way = min(border_x, border_y)
        if border_x <= border_y:
            column += step_x
            border_x += across_x
        else:
            row += step_y
            border_y += across_y
