"""Lines of places whose walls are square to each other, as those of most buildings are."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.surfaces.lines import BEGIN, DISTANCE, END, NORMAL_X, NORMAL_Y
from usmap_ros.mapping.joint.surfaces.mirrors import turns_to, usual_direction
from usmap_ros.numerics.arrays import BoolArray, FloatArray

#: Walls are square to each other, at the least, by this share of their length, where they are off
#: that by no more than such an angle, rad: a hexagon's are not.
LEAST_SHARE, MOST_OFF_RAD = 0.7, np.deg2rad(10.0)
#: Lines of so many cells count: the sides of small things face anywhere.
LEAST_CELLS = 15.0
#: A direction is unsure by what moves a line's ends by so many cells.
UNSURE_CELLS = 1.5


class SquareLines(NamedTuple):
    """Lines, by how they face."""

    #: (lines, 5) array: as they were, but for those turned that may face as most do.
    lines: FloatArray
    #: (lines,) bool array: which do, where most are square to each other.
    are_square: BoolArray


def squared(lines: FloatArray) -> SquareLines:
    """Turn lines to the direction that most are parallel or square to, if they may have it.

    Parameters
    ----------
    lines : (lines, 5) array
        See `usmap_ros.mapping.joint.surfaces.lines`.
    """
    direction_rad = square_direction(lines)
    if direction_rad is None:
        return SquareLines(lines, np.zeros(len(lines), bool))
    length = lines[:, END] - lines[:, BEGIN]
    turns_rad = turns_to(direction_rad, _normals_rad(lines))
    are_square = np.abs(turns_rad) <= MOST_OFF_RAD
    are_unsure = are_square & (np.abs(turns_rad) * 0.5 * length <= UNSURE_CELLS)
    turned = lines.copy()
    for number in np.flatnonzero(are_unsure):
        turned[number] = _turned(lines[number], float(turns_rad[number]))
    return SquareLines(turned, are_square)


def square_direction(lines: FloatArray) -> float | None:
    """Direction, rad, that lines are parallel or square to, if most of their length is.

    Parameters
    ----------
    lines : (lines, 5) array
        See `usmap_ros.mapping.joint.surfaces.lines`.
    """
    length = lines[:, END] - lines[:, BEGIN]
    is_long = length >= LEAST_CELLS
    if not is_long.any():
        return None
    length, normals_rad = length[is_long], _normals_rad(lines[is_long])
    direction_rad = usual_direction(normals_rad, length, length)
    are_square = np.abs(turns_to(direction_rad, normals_rad)) <= MOST_OFF_RAD
    if length[are_square].sum() < LEAST_SHARE * length.sum():
        return None
    return direction_rad


def _normals_rad(lines: FloatArray) -> FloatArray:
    """Directions of the normals of lines."""
    normals_rad: FloatArray = np.arctan2(lines[:, NORMAL_Y], lines[:, NORMAL_X])
    return normals_rad


def _turned(line: NDArray[np.float64], turn_rad: float) -> NDArray[np.float64]:
    """A line turned about its middle."""
    cosine, sine = np.cos(turn_rad), np.sin(turn_rad)
    along, half = 0.5 * (line[BEGIN] + line[END]), 0.5 * (line[END] - line[BEGIN])
    # In the frame of the line, whose middle is at its distance and so far along its tangent.
    distance, along = (
        line[DISTANCE] * cosine + along * sine,
        along * cosine - line[DISTANCE] * sine,
    )
    normal_x = line[NORMAL_X] * cosine - line[NORMAL_Y] * sine
    normal_y = line[NORMAL_Y] * cosine + line[NORMAL_X] * sine
    return np.array([normal_x, normal_y, distance, along - half, along + half])
