"""Directions in which the walls of a place face: mostly parallel, or square to one another."""

from __future__ import annotations

import math

import numpy as np

from usmap_ros.mapping.joint.mirror_walls import MirrorWall, usual_direction
from usmap_ros.mapping.joint.open_space import ACROSS, ALONG, KINDS, ORIENTATIONS, OTHERS
from usmap_ros.numerics.arrays import BoolArray, FloatArray

#: Hits that speak for walls in directions in which none was heard.
PSEUDO_HITS = 1.0
#: What counts for an orientation is this near to it, by the sine of twice the angle.
NEAR = math.sin(math.pi / ORIENTATIONS)
#: Of what is never looked for.
NEVER = -1e3


def log_priors(walls: list[MirrorWall], columns_a_line: float = 0.0) -> FloatArray:
    """Orientations that are asked for in each cell, and how much rarer surfaces like these are.

    Parameters
    ----------
    walls : list of MirrorWall
        All that are known. Where there are none, surfaces may face anywhere, and are heard from
        any side; where there are, orientations are counted from that of most, and something
        round that answers every view, as smooth walls answer square ones, is asked for as well.
    columns_a_line : float
        Round columns that were found for each line of a wall: so often others may stand, where
        there are no mirrors.

    Returns
    -------
    kinds : (KINDS, 3) array
        Direction of the normal, rad; logarithm of how often such surfaces are found, over that of
        the most usual ones; and group.
    """
    kinds = np.zeros((KINDS, 3))
    kinds[:, 2] = OTHERS
    kinds[:ORIENTATIONS, 0] = np.arange(ORIENTATIONS) * math.pi / ORIENTATIONS
    if not walls:
        is_round = min(1.0, columns_a_line)
        kinds[ORIENTATIONS:, 1] = math.log(is_round) if is_round else NEVER
        return kinds
    normals = np.array([wall.normal_rad for wall in walls])
    hits = np.array([len(wall.echoes) for wall in walls])
    kinds[:ORIENTATIONS, 0] += usual_direction(walls)
    off = np.abs(np.sin(2.0 * (kinds[:ORIENTATIONS, :1] - normals)))
    heard = (off < NEAR) @ hits + PSEUDO_HITS
    kinds[:ORIENTATIONS, 1] = np.log(heard / heard.max())
    kinds[[0, ORIENTATIONS // 2], 2] = ALONG, ACROSS
    return kinds


def is_too_short(is_refuted: BoolArray, normal_rad: float, length_cells: int) -> BoolArray:
    """Whether a wall through each cell would end on both sides before it has a length.

    Parameters
    ----------
    is_refuted : (rows, columns) bool array
        Where no wall that faces so can stand.
    normal_rad : float
        Direction that it faces.
    length_cells : int
        That walls have at the least.
    """
    room = np.zeros(is_refuted.shape, np.int32)
    for sign in (-1.0, 1.0):
        free = np.full(is_refuted.shape, length_cells, np.int32)
        for step in range(length_cells, 0, -1):
            up, right = (
                round(sign * step * part) for part in (math.cos(normal_rad), -math.sin(normal_rad))
            )
            free[np.roll(is_refuted, (-up, -right), axis=(0, 1))] = step - 1
        room += free
    return room + 1 < length_cells
