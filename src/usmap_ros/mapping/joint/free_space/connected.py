"""Free cells that are no slits, and that lead to what is known to be open."""

import math

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from usmap_ros.mapping.joint.forward_model.log_odds import over_block
from usmap_ros.mapping.joint.surfaces.walls import Walls
from usmap_ros.numerics.arrays import BoolArray
from usmap_ros.numerics.compiled import compiled

#: Width of what is no slit, m.
SLIT_M = 0.2


def without_slits(free: BoolArray, is_silent: BoolArray, resolution_m: float) -> BoolArray:
    """Free cells, but for slits that nothing but sound which came back through them speaks for.

    What goes along a smooth wall comes back from the one that it ends at: its way, as thin as a
    ray, may lie in the wall itself.

    Parameters
    ----------
    free : (rows, columns) bool array
        Cells that seem to be free.
    is_silent : (rows, columns) bool array
        Those that are so by silence, or because a robot stood there.
    resolution_m : float
        Of a cell.
    """
    width = min(max(1, math.ceil(SLIT_M / resolution_m - 1e-9)), *free.shape)
    fits = sliding_window_view(free, (width, width)).all(axis=(2, 3))
    wide = sliding_window_view(np.pad(fits, width - 1), (width, width)).any(axis=(2, 3))
    left: BoolArray = free & (is_silent | wide)
    return left


def led_to(free: BoolArray, stood: BoolArray, proven: BoolArray, walls: Walls) -> BoolArray:
    """Free cells that something leads to.

    Among walls that is where robots stood: what comes back from beyond them may be an image, or
    have come by a way that is not on the map.  Among poles, rings that are not known divide what is
    open, and sound that came back through a cell is enough.

    Parameters
    ----------
    free, stood, proven : (rows, columns) bool arrays
        Cells that seem to be free, where robots stood, and through which sound came back.
    walls : Walls
        What stands.
    """
    is_open = stood if len(walls.all_lines) else stood | (free & proven)
    return connected(free, is_open, walls.shown)


def connected(free: BoolArray, is_open: BoolArray, occupied: BoolArray) -> BoolArray:
    """Free cells that are connected with what is known to be open, or nearly so.

    Sound gets to each free cell through open ones.  Where none of them lead there, it has come
    through something that was not heard.

    Parameters
    ----------
    free : (rows, columns) bool array
        Cells that seem to be free.
    is_open : (rows, columns) bool array
        Those of them where a robot stood, or sound came back through.
    occupied : (rows, columns) bool array
        What stands, and leads nowhere.
    """
    leads = over_block(free) & ~occupied
    reached = is_open & leads
    _flood(leads, reached)
    connected: BoolArray = free & reached
    return connected


@compiled
def _flood(leads: BoolArray, reached: BoolArray) -> None:
    """Reach whatever lies beside what is reached, if it leads anywhere."""
    rows, columns = leads.shape
    waiting = np.empty((rows * columns, 2), np.int64)
    count = 0
    for row in range(rows):
        for column in range(columns):
            if reached[row, column]:
                waiting[count, 0], waiting[count, 1] = row, column
                count += 1
    while count > 0:
        count -= 1
        row, column = waiting[count, 0], waiting[count, 1]
        for step in range(4):
            beside_row = row + (step == 0) - (step == 1)
            beside = column + (step == 2) - (step == 3)
            if not (0 <= beside_row < rows and 0 <= beside < columns):
                continue
            if leads[beside_row, beside] and not reached[beside_row, beside]:
                reached[beside_row, beside] = True
                waiting[count, 0], waiting[count, 1] = beside_row, beside
                count += 1
