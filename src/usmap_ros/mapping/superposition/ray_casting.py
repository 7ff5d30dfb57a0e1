"""Ray casting: how much of a ping's sound is left along each ray, past what hides."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.superposition.ping_bins import Look
from usmap_ros.mapping.superposition.visible_cells import Rays, VisibleCells, bearing_of
from usmap_ros.numerics.compiled import compiled, inlined

#: Share of the sound below which none counts.
HIDDEN = np.float32(1e-4)
#: Steps behind the one that hides from which on it does.
OWN_STEPS = 3


@compiled
def cast_shadows(
    look: Look, res: float, seen: VisibleCells, listed: int, depth: NDArray[np.float32], rays: Rays
) -> None:
    """Share of the sound that reaches each step of each ray, by the cells' optical depth.

    A step in a cell that hides takes its share of the sound from all that are `OWN_STEPS` or more
    behind it: a surface does not hide itself.

    Parameters
    ----------
    look : Look
        The ping in bins of range.
    res : float
        Side of a cell, m.
    seen : VisibleCells
        Cells in the cone; `slot`, `row` and `column` are used.
    listed : int
        How many there are.
    depth : (slots,) float32 array
        Optical depth of each cell for sound that crosses it.
    rays : Rays
        `in_sight` is set.
    """
    in_sight = rays.in_sight
    steps, ray_count = in_sight.shape
    for step in range(steps):
        for ray in range(ray_count):
            in_sight[step, ray] = 1.0
    any_hides = False
    for cell in range(listed):
        if depth[seen.slot[cell]] > 0.0:
            _hide_behind(look, res, seen.row[cell], seen.column[cell], depth[seen.slot[cell]], rays)
            any_hides = True
    passed = np.ones(ray_count, np.float32)
    for step in range(steps if any_hides else 0):
        for ray in range(ray_count):
            passed[ray] *= in_sight[step, ray]
            in_sight[step, ray] = passed[ray] if passed[ray] >= HIDDEN else np.float32(0.0)


@inlined
def _hide_behind(look: Look, res: float, row: int, column: int, depth: float, rays: Rays) -> None:
    """Weaken each ray `OWN_STEPS` after each of its steps that lies in a cell."""
    steps, ray_count = rays.in_sight.shape
    ray_width = 2.0 * look.half_angle_rad / ray_count
    x, y = (column + 0.5) * res - look.x_m, (row + 0.5) * res - look.y_m
    # No corner of a cell is farther from its middle.
    distance, around = math.sqrt(x * x + y * y), 0.75 * res
    bearing = bearing_of(look, x, y)
    half = math.pi if distance <= around else math.asin(around / distance)
    first = math.floor((bearing - half + look.half_angle_rad) / ray_width - 0.5)
    last = math.ceil((bearing + half + look.half_angle_rad) / ray_width - 0.5)
    if look.half_angle_rad < math.pi:
        first, last = max(first, 0), min(last, ray_count - 1)
    start = max(math.floor((distance - around) / rays.step_m - 0.5), 0)
    end = min(math.ceil((distance + around) / rays.step_m), steps - OWN_STEPS)
    share = np.float32(math.exp(-depth * rays.step_m / res))
    for ray in range(first, min(last + 1, first + ray_count)):
        angle = look.heading_rad + (ray + 0.5) * ray_width - look.half_angle_rad
        x_step, y_step = math.cos(angle) * rays.step_m, math.sin(angle) * rays.step_m
        for step in range(start, end):
            is_row = math.floor((look.y_m + (step + 0.5) * y_step) / res) == row
            if is_row and math.floor((look.x_m + (step + 0.5) * x_step) / res) == column:
                rays.in_sight[step + OWN_STEPS, ray % ray_count] *= share
