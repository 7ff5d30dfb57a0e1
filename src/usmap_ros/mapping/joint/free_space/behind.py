"""Cells behind what was heard from one side alone: mostly, that is solid."""

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.forward_model.cell_evidence import CellEvidence
from usmap_ros.mapping.joint.forward_model.log_odds import over_block
from usmap_ros.mapping.joint.surfaces.lines import DISTANCE, NORMAL_X, NORMAL_Y, drawn
from usmap_ros.mapping.joint.surfaces.walls import Walls
from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.numerics.arrays import BoolArray, FloatArray

#: How far behind what was heard from one side alone silence must say as much as where walls
#: may go on, m.
BEHIND_M = 0.5
#: The same of mirrors: another side of it may be as far behind, as of walls between rooms.
BEHIND_MIRRORS_M = 0.25
#: A line was heard from one side if the mean of the cosines of its echoes' incidence, with the sign
#: of the side that they were heard from, is more.
ONE_SIDED = 0.4
#: What stands alone was heard from one side if the mean of the unit vectors to who heard it is
#: longer.
ALONE_ONE_SIDED = 0.7


def behind_walls(walls: Walls, evidence: CellEvidence, field: Field) -> BoolArray:
    """Cells behind walls, and things, that were heard from one side alone.

    What they enclose is seldom open: sound that came there through another side of it would have
    been returned by these walls' backs, too.

    Parameters
    ----------
    walls : Walls
        What stands.
    evidence : CellEvidence
        Of its cells.
    field : Field
        The cells.
    """
    heard, east, north = (
        each.reshape(field.shape) for each in (evidence.heard, evidence.from_x, evidence.from_y)
    )
    if not len(walls.all_lines):
        # What stands alone where no walls are is poles, which enclose nothing.
        return np.zeros(field.shape, bool)
    alone = walls.occupied & ~over_block(drawn(walls.all_lines, field.shape))
    backs = behind_alone(alone, heard, east, north, field, 0.5 * BEHIND_M)
    depth_cells = round(BEHIND_M / field.resolution_m)
    backs |= behind(walls.lines, heard, east, north, depth_cells)
    mirrors_cells = round(BEHIND_MIRRORS_M / field.resolution_m)
    # Normals of mirrors point away from who heard them.
    backs |= drawn(_shifted(walls.mirrors, np.arange(1.0, mirrors_cells + 1.0)), field.shape)
    return backs & ~walls.shown


def _shifted(lines: FloatArray, cells: FloatArray) -> FloatArray:
    """Lines, each moved along its normal by each of some numbers of cells."""
    moved = np.repeat(lines, len(cells), axis=0)
    moved[:, DISTANCE] += np.tile(cells, len(lines))
    return moved


def behind(
    lines: FloatArray,
    heard: NDArray[np.float32],
    east: NDArray[np.float32],
    north: NDArray[np.float32],
    depth_cells: int,
) -> BoolArray:
    """Cells that are behind lines which were heard from one side alone: mostly, that is solid.

    Parameters
    ----------
    lines : (lines, 5) array
        Walls.
    heard, east, north : (rows, columns) float32 arrays
        Echoes that were heard of each cell, and sums of the unit vectors to who heard them.
    depth_cells : int
        How far they reach.
    """
    mask = np.zeros(heard.shape, bool)
    for line in lines:
        on = drawn(line[np.newaxis], heard.shape)
        side = float(line[NORMAL_X] * east[on].sum() + line[NORMAL_Y] * north[on].sum())
        if abs(side) > ONE_SIDED * float(heard[on].sum()):
            cells = -np.sign(side) * np.arange(1.0, depth_cells + 1.0)
            mask |= drawn(_shifted(line[np.newaxis], cells), heard.shape)
    return mask


def behind_alone(
    alone: BoolArray,
    heard: NDArray[np.float32],
    east: NDArray[np.float32],
    north: NDArray[np.float32],
    field: Field,
    radius_m: float,
) -> BoolArray:
    """Discs behind what stands on no line and was heard from one side: it may be their front.

    Parameters
    ----------
    alone : (rows, columns) bool array
        Cells of what stands on no line.
    heard, east, north
        As in `behind`.
    field : Field
        The cells.
    radius_m : float
        Of the discs, which touch what was heard.
    """
    rows, columns = np.nonzero(alone)
    towards = np.stack([east[rows, columns], north[rows, columns]]).astype(np.float64)
    length = np.hypot(*towards)
    is_one_sided = length > ALONE_ONE_SIDED * heard[rows, columns]
    towards = radius_m * towards[:, is_one_sided] / length[is_one_sided]
    x_m = (field.first_column + columns[is_one_sided] + 0.5) * field.resolution_m - towards[0]
    y_m = (field.first_row + rows[is_one_sided] + 0.5) * field.resolution_m - towards[1]
    return field.cells_within(x_m, y_m, radius_m)
