"""Ray casting: how much of a ping's sound is left along each ray."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.field import GREATEST_RANGE, HALF_ANGLE, HEADING, Field
from usmap_ros.mapping.looks import Looks
from usmap_ros.numerics.compiled import compiled
from usmap_ros.processes.threads import for_each

#: Rays into which a beam is divided, and samples along each.
RAYS, STEPS = 96, 192
#: Optical depth behind which nothing is left.
OPAQUE = 7.0
#: What one is in the tables of `cast_rays`.
WHOLE = 255
#: Pings whose rays one thread casts at a time.
BATCH = 64


def cast_all_rays(
    looks: Looks, pings: NDArray[np.int64], field: Field, depth: NDArray[np.float32]
) -> NDArray[np.uint8]:
    """The same as `cast_rays`, with as many threads as there are cores."""
    batches = [pings[first : first + BATCH] for first in range(0, len(pings), BATCH)]
    return np.concatenate(for_each(lambda batch: cast_rays(looks, batch, field, depth), batches))


@compiled
def cast_rays(
    looks: Looks, pings: NDArray[np.int64], field: Field, depth: NDArray[np.float32]
) -> NDArray[np.uint8]:
    """Share of the sound that reaches each sample of each ray.

    Parameters
    ----------
    looks : Looks
        Pings.
    pings : (pings,) integer array
        Their rows.
    field : Field
        The cells.
    depth : (rows, columns) float32 array
        Optical depth of each.

    Returns
    -------
    left : (pings, RAYS, STEPS) uint8 array
        exp(-optical depth) up to sample k, at range k / STEPS of the greatest, times `WHOLE`.
    """
    left = np.zeros((len(pings), RAYS, STEPS), np.uint8)
    if not depth.any():
        left[:] = WHOLE
        return left
    res = field.resolution_m
    for index in range(len(pings)):
        numbers = looks.numbers[pings[index]]
        half, step_m = numbers[HALF_ANGLE], numbers[GREATEST_RANGE] / STEPS
        x0, y0 = numbers[0] / res - field.first_column, numbers[1] / res - field.first_row
        stride = step_m / res
        for ray in range(RAYS):
            angle = numbers[HEADING] - half + (ray + 0.5) * 2.0 * half / RAYS
            dx, dy = stride * math.cos(angle), stride * math.sin(angle)
            passed, share, before = 0.0, WHOLE, 0.0
            for step in range(STEPS):
                left[index, ray, step] = share
                column, row = int(x0 + (step + 0.5) * dx), int(y0 + (step + 0.5) * dy)
                if row < 0 or column < 0 or row >= field.rows or column >= field.columns:
                    continue
                here = depth[row, column]
                if here > 0.0:
                    passed += here * stride
                    if passed > OPAQUE:
                        break
                    if passed != before:
                        share = int(WHOLE * math.exp(-passed) + 0.5)
                        before = passed
    return left
