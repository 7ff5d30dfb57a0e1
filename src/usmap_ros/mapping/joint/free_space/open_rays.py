"""Rays that end at nothing: where they go, walls may stand that answer nobody who looks askew.

In a place of rough walls most rays end at one of them, and what such walls teach frees the cells
before the next.  A room of mirrors beside them shows itself by what is not heard there: rays end at
nothing that is shown, and their pings hear no echo besides that something unknown might have
returned.  So where that is usual and elsewhere is not, mirrors are as likely as anything else.
"""

import math

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.free_space.response import HeardBins
from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.mapping.joint.visibility.ray_casting import RAYS, STEPS, WHOLE, ray_angle
from usmap_ros.mapping.ping_bins import ECHO
from usmap_ros.mapping.ping_table import GREATEST_RANGE, PingTable, X, Y
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.compiled import compiled

#: Chance of an echo by what stands, from which on that explains it.
EXPLAINED = 0.3
#: Share of open rays, among those through a cell, from which on mirrors are likelier there, and
#: from which on they are as likely as anything.  Of the nearest 20 pings around any, 18 recordings
#: of 30 and 100 pings a robot among rough walls have 0.36 at the most, and rooms of mirrors beside
#: rough ones that had been taken for rough up to 0.74.
FEW_OPEN, MANY_OPEN = 0.3, 0.55
#: The same of all pings, from which on open rays say less, and nothing: in halls that are wider
#: than sensors reach they are usual.
USUAL_OPEN, MOST_OPEN = 0.25, 0.35
#: Side of the squares of which a ping's own and those beside it are around it, m: from anywhere
#: in a room of rough walls some ways end.
AROUND_M = 0.5
#: Cells along the side of a square in which rays are counted, and of rays and their samples every
#: so many.
SQUARE, EVERY_RAY, EVERY_STEP = 4, 2, 4


def open_shares(
    table: PingTable, pings: NDArray[np.int64], left: NDArray[np.uint8], listening: HeardBins
) -> NDArray[np.float32]:
    """Share of rays that end at nothing, of all pings around each.

    Those of pings that heard what nothing explains may end there.

    Parameters
    ----------
    table : PingTable
        Pings.
    pings : (pings,) integer array
        Rows of those that count.
    left : (pings, RAYS, STEPS) uint8 array
        How much of their sound is left, if nothing but what stands is in the way.
    listening : HeardBins
        What was heard, and was to be heard by what stands.
    """
    is_open = left[:, :, -1] > WHOLE // 2
    ping, bins = np.nonzero(table.kind[pings] == ECHO)
    shares: NDArray[np.float32] = is_open.mean(axis=1, dtype=np.float32)
    shares[ping[listening.chance[ping, bins] <= EXPLAINED]] = 0.0
    return _mean_around(shares, table.numbers[pings][:, [X, Y]])


def _mean_around(values: NDArray[np.float32], places_m: FloatArray) -> NDArray[np.float32]:
    """Mean over all pings in the same square, and the eight around it, of each ping."""
    squares = np.floor((places_m - places_m.min(axis=0)) / AROUND_M).astype(np.int64) + 1
    up, right = squares[:, 1], squares[:, 0]
    sums = np.zeros((2, int(up.max()) + 2, int(right.max()) + 2))
    for layer, each in zip(sums, (values, np.ones_like(values)), strict=True):
        np.add.at(layer, (up, right), each)
    total, count = np.sum(
        [sums[:, up + above, right + beside] for above in (-1, 0, 1) for beside in (-1, 0, 1)],
        axis=0,
    )
    mean: NDArray[np.float32] = (total / count).astype(np.float32)
    return mean


def likely_as_anything(
    table: PingTable,
    pings: NDArray[np.int64],
    field: Field,
    left: NDArray[np.uint8],
    shares: NDArray[np.float32],
    usually_open: float,
) -> FloatArray:
    """How far mirrors are as likely in each cell as anything else, by rays that end at nothing.

    Parameters
    ----------
    table, pings, left
        As in `open_shares`.
    field : Field
        The cells.
    shares : (pings,) float32 array
        By `open_shares`.
    usually_open : float
        Its mean over all pings of the place.

    Returns
    -------
    likely : (rows, columns) array
        From 0, no more than elsewhere, to 1.
    """
    squares = [math.ceil(cells / SQUARE) for cells in field.shape]
    sums = np.zeros((*squares, 2), np.float32)
    _add_rays(table, pings, field, left, shares, sums)
    through = sums[:, :, 1] / np.maximum(sums[:, :, 0], 1.0)
    is_told = np.clip((MOST_OPEN - usually_open) / (MOST_OPEN - USUAL_OPEN), 0.0, 1.0)
    likely: FloatArray = is_told * np.clip((through - FEW_OPEN) / (MANY_OPEN - FEW_OPEN), 0.0, 1.0)
    rows, columns = field.shape
    likely = likely.repeat(SQUARE, axis=0).repeat(SQUARE, axis=1)
    return likely[:rows, :columns]


@compiled
def _add_rays(
    table: PingTable,
    pings: NDArray[np.int64],
    field: Field,
    left: NDArray[np.uint8],
    shares: NDArray[np.float32],
    sums: NDArray[np.float32],
) -> None:
    """Add up the sound that gets to squares, and the same times the open share of its ping.

    Parameters
    ----------
    sums : (squares up, squares right, 2) float32 array
        Added to; others as in `likely_as_anything`.
    """
    side_m = SQUARE * field.resolution_m
    for index in range(len(pings)):
        numbers = table.numbers[pings[index]]
        step_m = numbers[GREATEST_RANGE] / STEPS
        x = (numbers[X] - field.first_column * field.resolution_m) / side_m
        y = (numbers[Y] - field.first_row * field.resolution_m) / side_m
        for ray in range(0, RAYS, EVERY_RAY):
            angle = ray_angle(numbers, ray)
            right, up = step_m / side_m * math.cos(angle), step_m / side_m * math.sin(angle)
            for step in range(0, STEPS, EVERY_STEP):
                column, row = int(x + (step + 0.5) * right), int(y + (step + 0.5) * up)
                is_inside = 0 <= row < sums.shape[0] and 0 <= column < sums.shape[1]
                if not left[index, ray, step] or not is_inside:
                    break
                # Rays diverge: each stands for what is as wide as it is far away.
                sound = np.float32(left[index, ray, step]) * np.float32(step + 0.5)
                sums[row, column, 0] += sound
                sums[row, column, 1] += sound * shares[index]
