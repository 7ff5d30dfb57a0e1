"""What a ping saw: how far its sound went, and what it found free on the way."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from usmap_ros.compiled import compiled
from usmap_ros.mapping.superposition.cells import Tiles, slot_at
from usmap_ros.mapping.superposition.evidence import Bounds, Evidence, add_gain
from usmap_ros.mapping.superposition.look import SILENCE, Look
from usmap_ros.mapping.superposition.seen import Rays, power_gain

#: Visibility below which silence says nothing, and a ray is not followed any further.
LEAST_SIGHT = 0.3
LEAST_TRUST = 0.02
#: Share of the sound below which none counts.
HIDDEN = 1e-4
#: Radius of the place that a robot itself takes up.
PRESENCE_M = 0.12


@compiled
def cast_rays(look: Look, tiles: Tiles, depth: NDArray[np.float32], rays: Rays) -> None:
    """Share of the sound that reaches each step of each ray, by the cells' optical depth.

    A surface does not hide itself: the two steps before a place do not count.

    Parameters
    ----------
    look : Look
        The ping.
    tiles : Tiles
        The grid.
    depth : (slots,) float32 array
        Optical depth of each cell for sound that crosses it.
    rays : Rays
        `in_sight` is set.
    """
    ray_count, steps = rays.in_sight.shape
    res = tiles.resolution_m
    for ray in range(ray_count):
        angle = look.heading_rad + ((ray + 0.5) / ray_count * 2.0 - 1.0) * look.half_angle_rad
        x_step, y_step = math.cos(angle) * rays.step_m, math.sin(angle) * rays.step_m
        in_sight, last, before_last = 1.0, 0.0, 0.0
        for step in range(steps):
            rays.in_sight[ray, step] = in_sight
            row = math.floor((look.y_m + (step + 0.5) * y_step) / res)
            column = math.floor((look.x_m + (step + 0.5) * x_step) / res)
            slot = slot_at(row, column, tiles)
            here = depth[slot] * rays.step_m / res if slot >= 0 else 0.0
            if before_last > 0.0:
                in_sight *= math.exp(-before_last)
                if in_sight < HIDDEN:
                    in_sight = 0.0
            before_last, last = last, here


@compiled
def deal_proof(look: Look, tiles: Tiles, rays: Rays, clear: NDArray[np.float32]) -> None:
    """Count for every cell the rays that are known to have passed through it.

    A cell's length before what the sound came back from is left out.

    Parameters
    ----------
    look, tiles, rays
        As above, `rays.proven_m` set.
    clear : (slots,) float32 array
        Added to.
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


@compiled
def deal_presence(
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
        Changed.
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


@compiled
def deal_silence(
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
        See above.
    median_power : float
        Power that an object scatters.
    silent : (slots,) float32 array
        Added to.
    """
    ray_count, steps = rays.in_sight.shape
    res = tiles.resolution_m
    ray_width = 2.0 * look.half_angle_rad / ray_count
    a_step = math.exp(-rays.step_m / trust_m)
    level = math.sqrt(look.axis_x * look.axis_x + look.axis_y * look.axis_y)
    for ray in range(ray_count):
        off_axis = ((ray + 0.5) / ray_count * 2.0 - 1.0) * look.half_angle_rad
        angle = look.heading_rad + off_axis
        x_step, y_step = math.cos(angle) * rays.step_m, math.sin(angle) * rays.step_m
        proven = 1.0
        for step in range(steps):
            distance = (step + 0.5) * rays.step_m
            if distance >= look.greatest_range_m:
                break
            row = math.floor((look.y_m + (step + 0.5) * y_step) / res)
            column = math.floor((look.x_m + (step + 0.5) * x_step) / res)
            slot = slot_at(row, column, tiles)
            if slot < 0:
                break
            if clear[slot] < proof:
                proven *= a_step
            trust = rays.in_sight[ray, step] * proven
            if trust < LEAST_TRUST:
                break
            slant = math.sqrt(distance * distance + look.rise_m * look.rise_m)
            b = int((slant - look.least_range_m) / look.bin_m)
            if slant < look.least_range_m or b >= len(look.kind) or look.kind[b] != SILENCE:
                continue
            cosine = (level * math.cos(off_axis) * distance + look.axis_z * look.rise_m) / slant
            if trust > LEAST_SIGHT and cosine > look.cos_half_angle:
                spread = math.exp(-look.absorption_per_m * slant) / slant**4
                gain = power_gain(look, cosine)
                audible = math.exp(-look.limit[b] / (gain * spread * median_power + 1e-30))
                # Near the transducer several rays cross a cell, and count once between them.
                sharing = max(1.0, res / (distance * ray_width))
                silent[slot] += (trust - LEAST_SIGHT) / (1.0 - LEAST_SIGHT) * audible / sharing
