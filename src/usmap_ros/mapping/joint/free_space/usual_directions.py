"""How usual surfaces are: which way the walls of a place face, and how far they go on."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.free_space.kinds import (
    ACROSS,
    ALONG,
    KINDS,
    MIRRORS,
    ORIENTATIONS,
    OTHERS,
    ROUND,
)
from usmap_ros.mapping.joint.surfaces.lines import BEGIN, END, NORMAL_X, NORMAL_Y
from usmap_ros.mapping.joint.surfaces.mirrors import MirrorWall, how_they_face, usual_direction
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.compiled import compiled, inlined

#: Length of walls, m, that is expected in any direction: where nothing speaks for it, and what
#: each metre of walls that are not square to most, and of things that stand alone, adds.
EXPECTED_M, A_METRE_ASKEW, A_METRE_ALONE = 0.12, 0.1, 0.1
#: What counts for an orientation is this near to it, by the sine of twice the angle.
NEAR = math.sin(math.pi / ORIENTATIONS)
#: Of what is never looked for.
NEVER = -1e3
#: Round columns that are found for each wall, or other thing, where there are as many, for they are
#: fainter; among mirrors, the surface of one, m, and how many speak for others if none were found.
COLUMNS_A_WALL, COLUMN_M, PSEUDO_COLUMNS = 0.5, 1.25, 1.0
#: Ends that are so many times as far away as usual say nothing.
FAR = 2.0
#: Log-likelihood ratio from which on so much was heard of a wall that it may stand there.
HEARD = 2.0
#: How far it is from a place in what is long, and what is short, to an end of it, on the mean, m.
#: As ends come by chance, the first is the mean length of long walls, which more walls continue.
LONG_M, SHORT_M = 10.0, 0.3
#: Widest gaps, m, that may be too narrow for a side of a room that is missing, by how many of its
#: sides were found: none, one, two or three; and where none is missing.  Mirrors whose normals are
#: so near to each other (rad), and that are so near to one line (m), are of one side.
WIDEST_M, ANY_WIDTH_M = (0.5, 0.5, 1.5, 1.5), 1e9
ONE_SIDE_RAD, ONE_SIDE_M = 0.18, 0.15
#: What stands in a cell: anything, or a wall that is known to face as one that is asked for does.
STANDS, FACES_SO = 1, 2
#: Lines that are shorter than this are short things, for how many each that was found counts, and
#: how much of those is expected beside, m.  Robots strike less of short walls squarely: in eight
#: rooms of a public simulator a fifteenth of those was found, and of long ones three quarters.
SHORTER_M, A_SHORT_ONE, PSEUDO_SHORT_M = 1.0, 2.0, 1.0


class WallDirections(NamedTuple):
    """Walls by which way they face."""

    #: (walls,) arrays: direction of the normal, and length: how often a wall was heard depends on
    #: where robots went.
    normals_rad: FloatArray
    lengths_m: FloatArray
    #: (walls,) array: how much each says of the usual direction.
    weights: FloatArray


def facing(mirrors: list[MirrorWall], lines: FloatArray, resolution_m: float) -> WallDirections:
    """Which way mirrors face, or lines if there are no mirrors."""
    if mirrors:
        return WallDirections(*how_they_face(mirrors))
    lengths_m = (lines[:, END] - lines[:, BEGIN]) * resolution_m
    return WallDirections(np.arctan2(lines[:, NORMAL_Y], lines[:, NORMAL_X]), lengths_m, lengths_m)


def log_priors(
    walls: WallDirections,
    mirrors: int,
    columns: float,
    things: int,
    alone_m: float,
    mirrored: float,
) -> FloatArray:
    """Orientations that are asked for in each cell, and how much rarer surfaces like these are.

    Parameters
    ----------
    walls : WallDirections
        All that are known.  Orientations are counted from that of most.
    mirrors : int
        Mirrors that were found.  Where there are none, surfaces are mostly heard from any side;
        where there are, something round that answers every view, as smooth walls answer square
        ones, is asked for as well.
    columns : float
        Round columns that are likely: the more there are, the more others may stand.
    things : int
        Lines of walls, and what stands alone, if there are no mirrors.
    alone_m : float
        Length of what was found on no line: where much is, more may face anywhere.
    mirrored : float
        Share of surfaces that may answer as mirrors do, by
        `usmap_ros.mapping.joint.free_space.mirror_share.mirror_share`.

    Returns
    -------
    kinds : (KINDS, 3) array
        Direction of the normal, rad; logarithm of how often such surfaces are found, over that of
        the most usual ones; and group.
    """
    kinds = np.zeros((KINDS, 3))
    kinds[:, 2] = OTHERS
    kinds[ORIENTATIONS:ROUND, 2] = OTHERS if mirrors else MIRRORS
    normals_rad = np.arange(ORIENTATIONS) * math.pi / ORIENTATIONS
    if len(walls.normals_rad):
        normals_rad += usual_direction(*walls)
    off = np.abs(np.sin(2.0 * (normals_rad[:, np.newaxis] - walls.normals_rad)))
    askew_m = walls.lengths_m[off[0] >= NEAR].sum()
    expected_m = EXPECTED_M + A_METRE_ASKEW * askew_m + A_METRE_ALONE * alone_m
    found_m = (off < NEAR) @ walls.lengths_m + expected_m
    usual = np.log(found_m / found_m.max())
    kinds[:ORIENTATIONS, 0] = kinds[ORIENTATIONS:ROUND, 0] = normals_rad
    kinds[ORIENTATIONS:ROUND, 1] = usual + math.log(mirrored)
    kinds[:ORIENTATIONS, 1] = usual
    if mirrors:
        for first in (0, ORIENTATIONS):
            kinds[[first, first + ORIENTATIONS // 2], 2] = ALONG, ACROSS
        # By surface, as everything else.
        share = COLUMN_M * (columns + PSEUDO_COLUMNS) / found_m.max()
    else:
        # Rough walls are loud, and say much of what is far off, where columns are faint and would
        # be lost: each counts for two things, as one of two is found.
        share = columns / (COLUMNS_A_WALL * things + 1.0)
    kinds[ROUND, 1] = math.log(min(1.0, share)) if share else NEVER
    return kinds


def lengths(lines: FloatArray, alone_m: float, resolution_m: float) -> FloatArray:
    """How long surfaces are here: kinds of them, and the share of all surface that each is.

    Parameters
    ----------
    lines : (lines, 5) array
        All that were found, see `usmap_ros.mapping.joint.surfaces.lines`.
    alone_m : float
        Length of what was found on no line.
    resolution_m : float
        Of a cell.

    Returns
    -------
    kinds : (2, 2) array
        Of what is long and of what is short: how far it is from a place in it to an end, cells on
        the mean, and the share.
    """
    lengths_m = (lines[:, END] - lines[:, BEGIN]) * resolution_m
    is_short = lengths_m < SHORTER_M
    short_m = A_SHORT_ONE * lengths_m[is_short].sum() + alone_m + PSEUDO_SHORT_M
    share = float(short_m / (lengths_m[~is_short].sum() + short_m))
    return np.array([[LONG_M / resolution_m, 1.0 - share], [SHORT_M / resolution_m, share]])


def sides(mirrors: list[MirrorWall]) -> int:
    """How many sides of a place mirrors are: what is on the same line is of one."""
    apart: list[MirrorWall] = []
    for wall in mirrors:
        if not any(_is_of_one_side(wall, other) for other in apart):
            apart.append(wall)
    return len(apart)


def _is_of_one_side(wall: MirrorWall, other: MirrorWall) -> bool:
    """Whether the middle of a mirror is on the line of another one, and faces as it does."""
    turned_rad = wall.normal_rad - other.normal_rad
    middle_m = 0.5 * (wall.begin_m + wall.end_m)
    ahead_m = wall.distance_m * math.cos(turned_rad) - middle_m * math.sin(turned_rad)
    return abs(ahead_m - other.distance_m) < ONE_SIDE_M and face_one_way(wall, other)


def face_one_way(wall: MirrorWall, other: MirrorWall) -> bool:
    """Whether two mirrors face the same way, or nearly so."""
    return math.cos(wall.normal_rad - other.normal_rad) > math.cos(ONE_SIDE_RAD)


def widest_gap_m(found: int) -> float:
    """How wide a gap may be, m, that says by its width that no mirror is in it.

    Where fewer were found than a room has sides, one is missing that nobody struck, and goes from
    one end to the other of what was not refuted: sound let a robot out there.  Where several are
    missing, so may be the sides of an alcove.

    Parameters
    ----------
    found : int
        How many sides were, by `sides`.
    """
    return WIDEST_M[found] if found < len(WIDEST_M) else ANY_WIDTH_M


@compiled
def lacks_room(
    said: NDArray[np.float32],
    is_refuted: BoolArray,
    asked: BoolArray,
    stands: NDArray[np.uint8],
    normal_rad: float,
    kinds: FloatArray,
    refuted: float,
    widest: float,
) -> BoolArray:
    """Whether walls are refuted by how little room there is for them, with what was heard.

    From anywhere in a wall it is as far to either end as chance has it, exponentially distributed;
    a wall through a cell must end before the next cells on its line in which none can stand.  There
    are long ones and short ones: between boxes there is little room.  Where a wall stands on the
    line, or something was heard of one, room says nothing of how far it goes on.

    Parameters
    ----------
    said : (rows, columns) float32 array
        Log-likelihood ratio of a wall in each cell; where it speaks for one, room says nothing.
    is_refuted : (rows, columns) bool array
        Where no wall that faces so can stand.
    asked : (rows, columns) bool array
        Cells that are asked for.
    stands : (rows, columns) uint8 array
        What stands in each cell: `FACES_SO`, `STANDS` or nothing, 0.
    normal_rad : float
        Direction that it faces.
    kinds : (kinds, 2) array
        Of walls: how far it is from a place in one to an end, cells on the mean, and the share of
        all surface that they are, by `lengths`.
    refuted : float
        Log-likelihood ratio at which one is refuted.
    widest : float
        Room for a wall of more cells says nothing.
    """
    rows, columns = is_refuted.shape
    lacks, ends = np.zeros((rows, columns), np.bool_), np.empty(2)
    farthest = int(FAR * kinds[:, 0].max())
    for row in range(rows):
        for column in range(columns):
            if not asked[row, column] or is_refuted[row, column] or said[row, column] > 0.0:
                continue
            if _find_ends(said, is_refuted, stands, row, column, normal_rad, farthest, ends):
                continue
            if ends.min() > 0.0 and ends.sum() > widest:
                continue
            chance = 0.0
            for usual, share in kinds:
                fits = share
                for end in ends:
                    fits *= 1.0 - math.exp(-end / usual) if end > 0.0 else 1.0
                chance += fits
            lacks[row, column] = said[row, column] + math.log(chance) < refuted
    return lacks


@inlined
def _find_ends(
    said: NDArray[np.float32],
    is_refuted: BoolArray,
    stands: NDArray[np.uint8],
    row: int,
    column: int,
    normal_rad: float,
    farthest: int,
    ends: FloatArray,
) -> bool:
    """Set how far it is to where a wall must end, either way, 0 if that says nothing.

    Returns whether a wall is known to stand before that.
    """
    rows, columns = is_refuted.shape
    up, right, is_known = math.cos(normal_rad), -math.sin(normal_rad), False
    for side in range(2):
        ends[side] = 0.0
        for step in range(1, farthest):
            y = math.floor(row + (2 * side - 1) * step * up + 0.5)
            x = math.floor(column + (2 * side - 1) * step * right + 0.5)
            if not (0 <= y < rows and 0 <= x < columns):
                break
            if is_refuted[y, x]:
                ends[side] = step - 0.5
                break
            is_known = is_known or stands[y, x] == FACES_SO or said[y, x] > HEARD
            if stands[y, x]:
                break
    return is_known
