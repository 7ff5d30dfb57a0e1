"""Directions in which the walls of a place face: mostly parallel, or square to one another."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.mirror_walls import MirrorWall, usual_direction
from usmap_ros.mapping.joint.open_space import ACROSS, ALONG, KINDS, ORIENTATIONS, OTHERS
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.compiled import compiled

#: Hits that speak for walls in directions in which none was heard.
PSEUDO_HITS = 1.0
#: What counts for an orientation is this near to it, by the sine of twice the angle.
NEAR = math.sin(math.pi / ORIENTATIONS)
#: Of what is never looked for.
NEVER = -1e3
#: Round columns that are found for each wall, or other thing, where there are as many, for they are
#: fainter; and how many speak for others where there are mirrors, but no columns were found.
COLUMNS_A_WALL, PSEUDO_COLUMNS = 0.5, 1.0
#: Ends that are so many times as far away as usual say nothing.
FAR = 2.0


def log_priors(walls: list[MirrorWall], columns: float, things: int) -> FloatArray:
    """Orientations that are asked for in each cell, and how much rarer surfaces like these are.

    Parameters
    ----------
    walls : list of MirrorWall
        All that are known. Where there are none, surfaces may face anywhere, and are heard from
        any side; where there are, orientations are counted from that of most, and something
        round that answers every view, as smooth walls answer square ones, is asked for as well.
    columns : float
        Round columns that are likely: the more there are for each wall, the more others may stand.
    things : int
        Lines of walls, and what stands alone, if there are no mirrors.

    Returns
    -------
    kinds : (KINDS, 3) array
        Direction of the normal, rad; logarithm of how often such surfaces are found, over that of
        the most usual ones; and group.
    """
    kinds = np.zeros((KINDS, 3))
    kinds[:, 2] = OTHERS
    kinds[:ORIENTATIONS, 0] = np.arange(ORIENTATIONS) * math.pi / ORIENTATIONS
    share = columns + (PSEUDO_COLUMNS if walls else 0.0)
    share /= COLUMNS_A_WALL * (len(walls) or things) + PSEUDO_COLUMNS
    kinds[ORIENTATIONS:, 1] = math.log(min(1.0, share)) if share else NEVER
    if not walls:
        return kinds
    normals = np.array([wall.normal_rad for wall in walls])
    hits = np.array([len(wall.echoes) for wall in walls])
    kinds[:ORIENTATIONS, 0] += usual_direction(walls)
    off = np.abs(np.sin(2.0 * (kinds[:ORIENTATIONS, :1] - normals)))
    heard = (off < NEAR) @ hits + PSEUDO_HITS
    kinds[:ORIENTATIONS, 1] = np.log(heard / heard.max())
    kinds[[0, ORIENTATIONS // 2], 2] = ALONG, ACROSS
    return kinds


@compiled
def lacks_room(
    said: NDArray[np.float32],
    is_refuted: BoolArray,
    asked: BoolArray,
    normal_rad: float,
    usual_cells: float,
    refuted: float,
) -> BoolArray:
    """Whether walls are refuted by how little room there is for them, with what was heard.

    From anywhere in a wall it is as far to either end as chance has it, exponentially distributed;
    a wall through a cell must end before the next cells on its line in which none can stand.

    Parameters
    ----------
    said : (rows, columns) float32 array
        Log-likelihood ratio of a wall in each cell; where it speaks for one, room says nothing.
    is_refuted : (rows, columns) bool array
        Where no wall that faces so can stand.
    asked : (rows, columns) bool array
        Cells that are asked for.
    normal_rad : float
        Direction that it faces.
    usual_cells : float
        How far it is from a place in a wall to an end, on the mean.
    refuted : float
        Log-likelihood ratio at which one is refuted.
    """
    rows, columns = is_refuted.shape
    lacks = np.zeros((rows, columns), np.bool_)
    up, right, farthest = math.cos(normal_rad), -math.sin(normal_rad), int(FAR * usual_cells)
    for row in range(rows):
        for column in range(columns):
            if not asked[row, column] or is_refuted[row, column] or said[row, column] > 0.0:
                continue
            total = said[row, column]
            for sign in (-1.0, 1.0):
                for step in range(1, farthest):
                    y = math.floor(row + sign * step * up + 0.5)
                    x = math.floor(column + sign * step * right + 0.5)
                    if not (0 <= y < rows and 0 <= x < columns):
                        break
                    if is_refuted[y, x]:
                        total += math.log(1.0 - math.exp(-(step - 0.5) / usual_cells))
                        break
            lacks[row, column] = total < refuted
    return lacks
