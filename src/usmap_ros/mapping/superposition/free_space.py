"""Free space: what sound that came back proves, and what silence near to it says."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.superposition.cells import Tiles, slot_at
from usmap_ros.mapping.superposition.inverse_sensor_model import Bounds, Evidence, add_gain
from usmap_ros.mapping.superposition.ping_bins import SILENCE, Look
from usmap_ros.mapping.superposition.visible_cells import Rays, power_gain
from usmap_ros.numerics.compiled import compiled_within, inlined
from usmap_ros.numerics.elementary import exp32

#: Visibility below which silence says nothing, and a ray is not followed any further.
LEAST_SIGHT = 0.3
LEAST_TRUST = 0.02
#: Radius of the place that a robot itself takes up.
PRESENCE_M = 0.12


@compiled_within
def prove_free(look: Look, tiles: Tiles, rays: Rays, clear: NDArray[np.float32]) -> None:
    """Count for every cell the rays that are known to have passed through it.

    A cell's length before what the sound came back from is left out.

    Parameters
    ----------
    look, tiles, rays
        As above, `rays.proven_m` set.
    clear : (slots,) float32 array
        Rays that passed each cell; those of this ping are added.
    """
    ray_count = len(rays.proven_m)
    res = tiles.resolution_m
    for ray in range(ray_count):
        angle = look.heading_rad + ((ray + 0.5) / ray_count * 2.0 - 1.0) * look.half_angle_rad
        cosine, sine = math.cos(angle), math.sin(angle)
        last = -1
        distance = 0.0
        while distance < rays.proven_m[ray] - res:
            row = math.floor((look.y_m + distance * sine) / res)
            column = math.floor((look.x_m + distance * cosine) / res)
            slot = slot_at(row, column, tiles)
            if slot >= 0 and slot != last:
                clear[slot] += 1.0
            last = slot
            distance += 0.5 * res


@compiled_within
def clear_under_robot(
    look: Look, tiles: Tiles, amount: float, bounds: Bounds, evidence: Evidence
) -> None:
    """Where a robot is, nothing else stands: clear all cells that it covers.

    Parameters
    ----------
    look, tiles
        As above.
    amount : float
        Rays that prove that a cell is clear.
    bounds : Bounds
        Of what can be said against one.
    evidence : Evidence
        Of the cells under the robot, `clear`, `own` and `block` are changed.
    """
    res = tiles.resolution_m
    reach = int(PRESENCE_M / res) + 1
    own_row, own_column = math.floor(look.y_m / res), math.floor(look.x_m / res)
    for row in range(own_row - reach, own_row + reach + 1):
        for column in range(own_column - reach, own_column + reach + 1):
            x, y = (column + 0.5) * res - look.x_m, (row + 0.5) * res - look.y_m
            slot = slot_at(row, column, tiles)
            if slot >= 0 and x * x + y * y < PRESENCE_M * PRESENCE_M:
                evidence.clear[slot] += amount
                add_gain(evidence.own, slot, -bounds.of_all, bounds)
                add_gain(evidence.block, slot, -bounds.of_all, bounds)


@compiled_within
def trust_silence(
    look: Look,
    tiles: Tiles,
    rays: Rays,
    clear: NDArray[np.float32],
    proof: float,
    trust_m: float,
    median_power: float,
    silent: NDArray[np.float32],
) -> None:
    """Count for every cell how often something there would have been heard, and was not.

    A smooth wall that is struck obliquely is silent, and hides what is behind it.  So silence
    is trusted only near to where the way is known to be open: trust falls by 1/e over
    `trust_m` of a ray through cells that nothing has proven clear.

    Parameters
    ----------
    look, tiles, rays
        As above, `rays.in_sight` set.
    clear : (slots,) float32 array
        Rays known to have passed each cell.
    proof : float
        How many of them prove that a cell is clear.
    trust_m : float
        Way over which trust in silence falls by 1/e, m.
    median_power : float
        Power that an object scatters.
    silent : (slots,) float32 array
        Times that something would have been heard; this ping's are added.
    """
    ray_count, res = rays.in_sight.shape[1], tiles.resolution_m
    ray_width = 2.0 * look.half_angle_rad / ray_count
    a_step = np.float32(math.exp(-rays.step_m / trust_m))
    level = math.sqrt(look.axis_x * look.axis_x + look.axis_y * look.axis_y)
    last = _find_loudness(look, median_power, rays)
    for ray in range(ray_count):
        off_axis = ((ray + 0.5) / ray_count * 2.0 - 1.0) * look.half_angle_rad
        angle, ahead = look.heading_rad + off_axis, level * math.cos(off_axis)
        x_step, y_step = math.cos(angle) * rays.step_m / res, math.sin(angle) * rays.step_m / res
        gain = power_gain(look, ahead)
        proven = np.float32(1.0)
        for step in range(last):
            row = math.floor(look.y_m / res + (step + 0.5) * y_step)
            column = math.floor(look.x_m / res + (step + 0.5) * x_step)
            slot = slot_at(row, column, tiles)
            if slot < 0:
                break
            if clear[slot] < proof:
                proven *= a_step
            trust = rays.in_sight[step, ray] * proven
            if trust < LEAST_TRUST:
                break
            if rays.loudness[step] == 0.0 or trust <= LEAST_SIGHT:
                continue
            distance = (step + 0.5) * rays.step_m
            if look.rise_m != 0.0:
                slant = math.sqrt(distance * distance + look.rise_m * look.rise_m)
                cosine = (ahead * distance + look.axis_z * look.rise_m) / slant
                gain = power_gain(look, cosine) if cosine > look.cos_half_angle else 0.0
            audible = exp32(-1.0 / (gain * rays.loudness[step] + 1e-30))
            # Near the transducer several rays cross a cell, and count once between them.
            sharing = max(1.0, res / (distance * ray_width))
            silent[slot] += (trust - LEAST_SIGHT) / (1.0 - LEAST_SIGHT) * audible / sharing


@inlined
def _find_loudness(look: Look, median_power: float, rays: Rays) -> int:
    """Set `loudness` of all steps in reach; returns how many those are."""
    for step in range(len(rays.loudness)):
        distance = (step + 0.5) * rays.step_m
        if distance >= look.greatest_range_m:
            return step
        slant = math.sqrt(distance * distance + look.rise_m * look.rise_m)
        b = int((slant - look.least_range_m) / look.bin_m)
        rays.loudness[step] = 0.0
        if slant >= look.least_range_m and b < len(look.kind) and look.kind[b] == SILENCE:
            spread = math.exp(-look.absorption_per_m * slant) / (slant * slant * slant * slant)
            rays.loudness[step] = spread * median_power / look.limit[b]
    return len(rays.loudness)
