"""What stands in front of a cell, as the map believes it."""

from __future__ import annotations

import numpy as np

from usmap_ros.mapping.footprint import Footprint
from usmap_ros.mapping.grid import FloatArray

#: Rays into which the beam is divided.
RAYS = 48
#: No cell blocks more than this share of a ray.
MOST_OPAQUE = 0.98


def visibility(footprint: Footprint, probability: FloatArray, resolution_m: float) -> FloatArray:
    """Probability that sound reaches each cell of a cone unblocked.

    The cells of a ray in front of a cell each block it with their probability of being
    occupied, times the share of the ray's width that they cover.

    Parameters
    ----------
    footprint : Footprint
        Cells of the cone.
    probability : (cells,) array
        Belief that each is occupied.
    resolution_m : float
        Side of a cell, and depth of a step along a ray.
    """
    half_angle = float(np.abs(footprint.bearing_rad).max(initial=0.0)) + 1e-9
    ray_width_rad = 2.0 * half_angle / RAYS
    ray = ((footprint.bearing_rad + half_angle) / ray_width_rad).astype(np.intp)
    ray = np.minimum(ray, RAYS - 1)
    step = (footprint.range_m / resolution_m).astype(np.intp)
    steps = int(step.max(initial=0)) + 1
    covered = np.minimum(1.0, resolution_m / (footprint.range_m * ray_width_rad))
    depth = -np.log1p(-np.minimum(probability, MOST_OPAQUE)) * covered
    optical_depth = np.bincount(ray * steps + step, depth, RAYS * steps).reshape(RAYS, steps)
    # A surface is a cell or two thick: it does not hide itself.
    before = np.zeros((RAYS, steps + 2))
    np.cumsum(optical_depth, axis=1, out=before[:, 2:])
    blocked: FloatArray = np.exp(-before[ray, step])
    return blocked
