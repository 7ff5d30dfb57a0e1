"""What stands in front of a cell, as the map believes it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usmap_ros.mapping.footprint import Footprint
from usmap_ros.mapping.grid import FloatArray, IndexArray

#: Rays into which the beam is divided.
RAYS = 48
#: Share of its own width that an occupied cell blocks: most objects are narrower than a cell.
OPACITY = 0.5
#: No cell is believed to be occupied more than this.
MOST_CERTAIN = 0.98


@dataclass(frozen=True)
class Rays:
    """The cells of a cone sorted into rays and steps along them.

    Parameters
    ----------
    place : (cells,) integer array
        Of each cell in a flat table of rays by steps.
    shadow_place : (4 * cells,) integer array
        Where in that table, which has one ray more, the shadows of the cells set in and end.
    shadow_change : (4 * cells,) array
        By how much the share of a ray that a shadow covers changes there from ray to ray.
    steps : int
        Steps along a ray.
    """

    place: IndexArray
    shadow_place: IndexArray
    shadow_change: FloatArray
    steps: int


def cast_rays(footprint: Footprint, resolution_m: float) -> Rays:
    """Sort the cells of a cone into rays; a step along a ray is as deep as a cell.

    Near the transducer a cell shadows several rays, far from it a part of one.  The share of
    ray k left of a place x, summed over all rays before k, is a ramp that begins at x: two
    entries at either edge of a shadow, summed up along the rays, make it.
    """
    half_angle = float(np.abs(footprint.bearing_rad).max(initial=0.0)) + 1e-9
    rays_per_rad = 0.5 * RAYS / half_angle
    position = (footprint.bearing_rad + half_angle) * rays_per_rad
    step = (footprint.range_m / resolution_m).astype(np.intp)
    steps = int(step.max(initial=0)) + 1
    half_width = 0.5 * rays_per_rad * resolution_m / footprint.range_m
    places, changes = [], []
    for edge, sign in ((position - half_width, 1.0), (position + half_width, -1.0)):
        inside = np.clip(edge, 0.0, float(RAYS))
        ray = np.minimum(inside.astype(np.intp), RAYS - 1)
        late = sign * (inside - ray)
        places += [ray * steps + step, (ray + 1) * steps + step]
        changes += [sign - late, late]
    return Rays(
        place=np.minimum(position.astype(np.intp), RAYS - 1) * steps + step,
        shadow_place=np.concatenate(places),
        shadow_change=np.concatenate(changes),
        steps=steps,
    )


def visibility(rays: Rays, probability: FloatArray) -> FloatArray:
    """Probability that sound reaches each cell of a cone unblocked.

    The cells of a ray in front of a cell each dim it: their optical depth, −ln(1 − p) times
    their opacity, counts with the share of the ray's width that they cover.

    Parameters
    ----------
    rays : Rays
        Cells of the cone.
    probability : (cells,) array
        Belief that each is occupied.
    """
    depth = -OPACITY * np.log1p(-np.minimum(probability, MOST_CERTAIN))
    changes = np.bincount(
        rays.shadow_place, rays.shadow_change * np.tile(depth, 4), (RAYS + 1) * rays.steps
    )
    optical_depth = np.cumsum(changes.reshape(RAYS + 1, rays.steps), axis=0)[:RAYS]
    # A surface is a cell or two thick: it does not hide itself.
    before = np.zeros((RAYS, rays.steps))
    np.cumsum(optical_depth[:, :-2], axis=1, out=before[:, 2:])
    in_sight: FloatArray = np.exp(-before).reshape(-1)[rays.place]
    return in_sight
