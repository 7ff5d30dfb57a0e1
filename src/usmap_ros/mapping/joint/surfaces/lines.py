"""Straight lines on the field, and the cells that they go through."""

import numpy as np
from numpy.typing import NDArray

from usmap_ros.numerics.arrays import BoolArray

#: Columns of an array of lines, in cells from the middle of cell (0, 0): unit normal, distance
#: along it, and where along the tangent (-ny, nx) the line begins and ends.
NORMAL_X, NORMAL_Y, DISTANCE, BEGIN, END = range(5)
NO_LINES: NDArray[np.float64] = np.zeros((0, 5))
#: Lines face in a direction if the cosine to it is greater, either way: 10 degrees.
ALIKE_COSINE = 0.985
#: Distance of the points that a line is drawn by, in cells.
_STEP = 0.4
#: A line is another one's double if it is as parallel, and so near to it for such a share.
PARALLEL_COSINE, DOUBLE_CELLS, DOUBLE_SHARE = 0.94, 4.0, 0.6
#: It is askew if one of its ends is by so many cells farther off than the other.
ASKEW_CELLS = 3.0


def points_on(
    line: NDArray[np.float64], begin: float, end: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows and columns of cells along a line, from one place on it to another."""
    along = np.arange(begin, end + 0.01, _STEP)
    columns = np.rint(line[NORMAL_X] * line[DISTANCE] - line[NORMAL_Y] * along)
    rows = np.rint(line[NORMAL_Y] * line[DISTANCE] + line[NORMAL_X] * along)
    return rows.astype(np.int64), columns.astype(np.int64)


def cells_beyond(
    line: NDArray[np.float64], end: float, sign: float, most: float, shape: tuple[int, int]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows and columns of the cells beyond an end of a line, as far as the field goes.

    Parameters
    ----------
    line : (5,) array
        The line.
    end, sign : float
        Where along it, and which way they follow.
    most : float
        How many.
    shape : (int, int)
        Of the field.
    """
    along = end + sign * np.arange(1.0, most + 0.5)
    columns = np.rint(line[NORMAL_X] * line[DISTANCE] - line[NORMAL_Y] * along).astype(np.int64)
    rows = np.rint(line[NORMAL_Y] * line[DISTANCE] + line[NORMAL_X] * along).astype(np.int64)
    count = leading((rows >= 0) & (columns >= 0) & (rows < shape[0]) & (columns < shape[1]))
    return rows[:count], columns[:count]


def leading(true: BoolArray) -> int:
    """How many are true before the first that is not."""
    return int(np.argmin(true)) if not true.all() else len(true)


def crossings(
    line: NDArray[np.float64], lines: NDArray[np.float64], most_cosine: float
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Which lines cross another one, had they no ends, and where along that and along each.

    Parameters
    ----------
    line : (5,) array
        The one.
    lines : (lines, 5) array
        The others.
    most_cosine : float
        Lines cross if the cosine of the angle between them is less.
    """
    cosine = lines[:, NORMAL_X] * line[NORMAL_X] + lines[:, NORMAL_Y] * line[NORMAL_Y]
    sine = lines[:, NORMAL_Y] * line[NORMAL_X] - lines[:, NORMAL_X] * line[NORMAL_Y]
    which = np.flatnonzero(np.abs(cosine) < most_cosine)
    others, cosine, sine = lines[which], cosine[which], sine[which]
    along = (others[:, DISTANCE] - cosine * line[DISTANCE]) / sine
    theirs = (cosine * others[:, DISTANCE] - line[DISTANCE]) / sine
    return which, along, theirs


def facing_so(lines: NDArray[np.float64], normal_rad: float) -> NDArray[np.float64]:
    """Those of some lines that are parallel to a wall which faces in a direction, or nearly so."""
    cosine = lines[:, NORMAL_X] * np.cos(normal_rad) + lines[:, NORMAL_Y] * np.sin(normal_rad)
    found: NDArray[np.float64] = lines[np.abs(cosine) > ALIKE_COSINE]
    return found


def drawn(lines: NDArray[np.float64], shape: tuple[int, int]) -> BoolArray:
    """Mask of the cells that lines go through."""
    mask = np.zeros(shape, bool)
    for line in lines:
        rows, columns = points_on(line, line[BEGIN], line[END])
        inside = (rows >= 0) & (columns >= 0) & (rows < shape[0]) & (columns < shape[1])
        mask[rows[inside], columns[inside]] = True
    return mask


def middles_in(lines: NDArray[np.float64], cells: BoolArray) -> NDArray[np.float64]:
    """Those of some lines whose middles are in some cells.

    Parameters
    ----------
    lines : (lines, 5) array
        The lines.
    cells : (rows, columns) bool array
        The cells.
    """
    middles = 0.5 * (lines[:, BEGIN] + lines[:, END])
    are_in = [
        bool((drawn(np.array([[*line[:BEGIN], at, at]]), cells.shape) & cells).any())
        for line, at in zip(lines, middles, strict=True)
    ]
    found: NDArray[np.float64] = lines[np.array(are_in, bool)]
    return found


def off_line(
    line: NDArray[np.float64], rows: NDArray[np.int64], columns: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Distance of cells from a line, with a sign, and where along it they are."""
    across = columns * line[NORMAL_X] + rows * line[NORMAL_Y] - line[DISTANCE]
    along = -columns * line[NORMAL_Y] + rows * line[NORMAL_X]
    return across, along


def without_doubles(lines: NDArray[np.float64]) -> NDArray[np.float64]:
    """Lines but for those close beside a heavier one: echoes of a wall that are told from others.

    Parameters
    ----------
    lines : (lines, 5) array
        The heaviest first.
    """
    kept: list[NDArray[np.float64]] = []
    for line in lines:
        if all(_across_beside(line, other) is None for other in kept):
            kept.append(line)
    return np.array(kept).reshape(-1, 5)


def without_askew(lines: NDArray[np.float64], walls: NDArray[np.float64]) -> NDArray[np.float64]:
    """Lines but for those that run beside walls askew: of two that do one is none.

    Parameters
    ----------
    lines, walls : (lines, 5) arrays
        Those that may be none, and others that are certain.
    """

    def is_askew(line: NDArray[np.float64]) -> bool:
        off = (_across_beside(line, wall) for wall in walls)
        return any(across is not None and np.ptp(across) > ASKEW_CELLS for across in off)

    return np.array([line for line in lines if not is_askew(line)]).reshape(-1, 5)


def _across_beside(
    line: NDArray[np.float64], other: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """How far cells of a line are off another, if it is as parallel, and for the most part near."""
    cosine = line[NORMAL_X] * other[NORMAL_X] + line[NORMAL_Y] * other[NORMAL_Y]
    if abs(cosine) < PARALLEL_COSINE:
        return None
    across, along = off_line(other, *points_on(line, line[BEGIN], line[END]))
    beside = (np.abs(across) <= DOUBLE_CELLS) & (along > other[BEGIN]) & (along < other[END])
    return across if beside.mean() > DOUBLE_SHARE else None
