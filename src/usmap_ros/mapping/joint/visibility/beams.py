"""Directions off a ping's beam, and how well it hears there."""

import math

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.mapping.ping_bins import GAIN_STEPS
from usmap_ros.mapping.ping_table import (
    AXIS_X,
    AXIS_Y,
    AXIS_Z,
    COS_HALF_ANGLE,
    GREATEST_RANGE,
    HALF_ANGLE,
    HEADING,
    PingTable,
    X,
    Y,
)
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.compiled import inlined

#: Share of the half angle within which a smooth thing must answer for a ping to count; and how far
#: within the least and the greatest range, m.
LOOKING_SHARE, WITHIN_LEAST_M, WITHIN_GREATEST_M = 0.93, 0.02, 0.05
#: Edges of a beam that are nearer to level than this, by their sine, bound no columns.
LEVEL = 1e-6


@inlined
def off_axis(table: PingTable, ping: int, bearing_rad: float) -> float:
    """Angle of a direction off a beam's axis, between -π and π."""
    off: float = bearing_rad - table.numbers[ping, HEADING]
    return off - 2.0 * math.pi * math.floor((off + math.pi) / (2.0 * math.pi))


@inlined
def is_beside(numbers: FloatArray, x_m: float, y_m: float, radius_m: float) -> bool:
    """Whether a disc is sure to lie beside a beam, or behind it.

    Parameters
    ----------
    numbers : (NUMBERS,) array
        Of the ping, see `usmap_ros.mapping.ping_table.PingTable`.
    x_m, y_m, radius_m : float
        Middle of the disc, from the transducer, and its radius.
    """
    cos_half, along = numbers[COS_HALF_ANGLE], numbers[AXIS_X] * x_m + numbers[AXIS_Y] * y_m
    if cos_half <= 0.0:
        return False
    if along < -radius_m:
        return True
    if numbers[AXIS_Z] != 0.0:
        return False
    across = numbers[AXIS_X] * y_m - numbers[AXIS_Y] * x_m
    outside: float = abs(across) * cos_half - along * math.sqrt(1.0 - cos_half * cos_half)
    return outside > radius_m


@inlined
def rows_in_reach(numbers: FloatArray, field: Field) -> tuple[int, int]:
    """First and end of the rows of cells that a ping reaches."""
    res, y0, reach = field.resolution_m, numbers[Y], numbers[GREATEST_RANGE]
    bottom = max(0, math.floor((y0 - reach) / res) - field.first_row)
    return bottom, min(field.rows, math.ceil((y0 + reach) / res) - field.first_row + 1)


@inlined
def columns_in_beam(numbers: FloatArray, field: Field, y_m: float) -> tuple[int, int]:
    """First and end of the columns between which all cells of a row lie that a beam touches.

    Parameters
    ----------
    numbers : (NUMBERS,) array
        Of the ping, see `usmap_ros.mapping.ping_table.PingTable`.
    field : Field
        The cells.
    y_m : float
        Of the row's middle, from the transducer.
    """
    res, reach = field.resolution_m, numbers[GREATEST_RANGE]
    across_m = max(0.0, abs(y_m) - res)
    most = math.sqrt(max(0.0, reach * reach - across_m * across_m)) + res
    least, cos_half = -most, numbers[COS_HALF_ANGLE]
    if cos_half > 0.0 and numbers[AXIS_Z] == 0.0:
        x, y, sine = numbers[AXIS_X], numbers[AXIS_Y], math.sqrt(1.0 - cos_half * cos_half)
        for side in (-1.0, 1.0):
            # Unit vector out of the beam, square to its edge.
            out_x, out_y = -side * y * cos_half - x * sine, side * x * cos_half - y * sine
            if out_x > LEVEL:
                most = min(most, (res - out_y * y_m) / out_x)
            elif out_x < -LEVEL:
                least = max(least, (res - out_y * y_m) / out_x)
    left = math.floor((numbers[X] + least) / res) - field.first_column
    right = math.ceil((numbers[X] + most) / res) - field.first_column + 1
    left = max(0, left)
    return left, max(left, min(field.columns, right))


@inlined
def amplitude_gain(table: PingTable, ping: int, off_rad: float) -> float:
    """Amplitude gain of a beam at an angle off its axis."""
    half = table.numbers[ping, HALF_ANGLE]
    entry = int((1.0 - math.cos(off_rad)) / (1.0 - math.cos(half)) * GAIN_STEPS)
    return math.sqrt(table.power_gain[ping, min(max(entry, 0), GAIN_STEPS)])


def amplitude_gains(table: PingTable, pings: NDArray[np.int64], off_rad: FloatArray) -> FloatArray:
    """The same of some rows of the table, each at an angle of its own: (pings,) array."""
    half = table.numbers[pings, HALF_ANGLE]
    entry = (1.0 - np.cos(off_rad)) / (1.0 - np.cos(half)) * GAIN_STEPS
    gain = table.power_gain[pings, np.clip(entry.astype(int), 0, GAIN_STEPS)]
    return np.asarray(np.sqrt(gain), np.float64)
