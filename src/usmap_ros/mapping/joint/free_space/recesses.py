"""Where walls may be short, however long others are: beside doors, and in recesses."""

import math

import numpy as np

from usmap_ros.mapping.joint.free_space.usual_directions import (
    ONE_SIDE_M,
    ONE_SIDE_RAD,
    face_one_way,
)
from usmap_ros.mapping.joint.surfaces.mirrors import MirrorWall
from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.numerics.arrays import BoolArray, FloatArray

#: How far from the line of a wall it may go on, in cells; and how deep a recess may be, m.
BESIDE_CELLS, DEEPEST_M = 1.5, 1.5


def may_be_short(
    field: Field, mirrors: list[MirrorWall], normal_rad: float, asked: BoolArray
) -> BoolArray:
    """Cells in which a wall that faces so may have little room.

    Beyond a door, or an alcove, a wall goes on in its line, and may end soon.  Of two walls that
    face the same way one a step behind the other, something leads from one to the other, which is
    as short as that step: the side of an alcove.

    Parameters
    ----------
    field : Field
        The cells.
    mirrors : list of MirrorWall
        Those that were found there.
    normal_rad : float
        Direction that it faces, or opposite.
    asked : (rows, columns) bool array
        Cells that are asked for.

    Returns
    -------
    may : (rows, columns) bool array
        Those of the cells.
    """
    rows, columns = np.nonzero(asked)
    places_m = field.geometry().cell_centers_m(rows, columns)
    may_here = np.zeros(len(rows), bool)
    for wall in mirrors:
        turned_rad, behind_m = wall.normal_rad - normal_rad, _behind_m(wall, places_m)
        if abs(math.cos(turned_rad)) > math.cos(ONE_SIDE_RAD):
            may_here |= np.abs(behind_m) < BESIDE_CELLS * field.resolution_m
        elif abs(math.sin(turned_rad)) > math.cos(ONE_SIDE_RAD):
            for step_m in _steps_m(wall, mirrors):
                may_here |= (behind_m > 0.0) & (behind_m < step_m)
    may = np.zeros(field.shape, bool)
    may[rows, columns] = may_here
    return may


def _behind_m(wall: MirrorWall, places_m: FloatArray) -> FloatArray:
    """How far behind the line of a wall places are."""
    ahead_m: FloatArray = places_m @ [math.cos(wall.normal_rad), math.sin(wall.normal_rad)]
    return ahead_m - wall.distance_m


def _steps_m(wall: MirrorWall, mirrors: list[MirrorWall]) -> list[float]:
    """How far behind a wall others stand that face as it does, and no farther than recesses go."""
    steps_m = [other.distance_m - wall.distance_m for other in mirrors if face_one_way(wall, other)]
    return [step_m for step_m in steps_m if ONE_SIDE_M < step_m < DEEPEST_M]
