"""What stands in front of a cell, as the map believes it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usmap_ros.mapping.footprint import Footprint
from usmap_ros.mapping.grid import FloatArray, IndexArray

#: Rays into which the beam is divided.
RAYS = 48
#: No cell blocks more than this share of a ray.
MOST_OPAQUE = 0.98


@dataclass(frozen=True)
class Rays:
    """The cells of a cone sorted into rays and steps along them.

    Parameters
    ----------
    place : (cells,) integer array
        Ray times `steps`, plus step, of each cell.
    covered : (cells,) array
        Share of its ray's width that a cell covers.
    steps : int
        Steps along a ray.
    """

    place: IndexArray
    covered: FloatArray
    steps: int


def cast_rays(footprint: Footprint, resolution_m: float) -> Rays:
    """Sort the cells of a cone into rays; a step along a ray is as deep as a cell."""
    half_angle = float(np.abs(footprint.bearing_rad).max(initial=0.0)) + 1e-9
    ray_width_rad = 2.0 * half_angle / RAYS
    ray = ((footprint.bearing_rad + half_angle) / ray_width_rad).astype(np.intp)
    step = (footprint.range_m / resolution_m).astype(np.intp)
    steps = int(step.max(initial=0)) + 1
    return Rays(
        place=np.minimum(ray, RAYS - 1) * steps + step,
        covered=np.minimum(1.0, resolution_m / (footprint.range_m * ray_width_rad)),
        steps=steps,
    )


def visibility(rays: Rays, probability: FloatArray) -> FloatArray:
    """Probability that sound reaches each cell of a cone unblocked.

    The cells of a ray in front of a cell each block it with their probability of being
    occupied, times the share of the ray's width that they cover.

    Parameters
    ----------
    rays : Rays
        Cells of the cone.
    probability : (cells,) array
        Belief that each is occupied.
    """
    depth = -np.log1p(-np.minimum(probability, MOST_OPAQUE)) * rays.covered
    shape = (RAYS, rays.steps)
    optical_depth = np.bincount(rays.place, depth, RAYS * rays.steps).reshape(shape)
    # A surface is a cell or two thick: it does not hide itself.
    before = np.zeros(shape)
    np.cumsum(optical_depth[:, :-2], axis=1, out=before[:, 2:])
    in_sight: FloatArray = np.exp(-before).reshape(-1)[rays.place]
    return in_sight
