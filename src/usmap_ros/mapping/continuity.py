"""Walls are continuous: what lies between two believed cells along a line is taken for wall."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from usmap_ros.grids import OccupancyMap
from usmap_ros.numerics.arrays import BoolArray

#: Directions in which gaps are bridged, as steps in rows and columns; the opposite ones follow.
DIRECTIONS = ((0, 1), (1, 0), (1, 1), (1, -1), (1, 2), (2, 1), (1, -2), (2, -1))
#: Log-odds of a cell that only its neighbours speak for: of such cells nine in ten touch a surface.
BRIDGE_LOG_ODDS = 1.8


def bridge_gaps(occupancy: OccupancyMap, gap_m: float) -> OccupancyMap:
    """Close gaps in walls that are too narrow for anything to drive through.

    Echoes of a wall are explained by its strongest cells, and cells between them are crossed by
    the sound that others returned.  A gap is bridged if believed cells lie on both sides of it
    in opposite directions.

    Parameters
    ----------
    occupancy : OccupancyMap
        A finished map; it stays as it is.
    gap_m : float
        Widest gap that is bridged; 0: none.

    Returns
    -------
    OccupancyMap
        With the cells in between observed, and believed with `BRIDGE_LOG_ODDS`.
    """
    widest = int(gap_m / occupancy.geometry.resolution_m + 1e-6)
    believed = occupancy.predicted()
    if widest < 1 or not believed.any():
        return occupancy
    between = _between(believed, widest) & ~believed
    log_odds = np.where(between, np.float32(BRIDGE_LOG_ODDS), occupancy.log_odds)
    return replace(occupancy, log_odds=log_odds, observed=occupancy.observed | between)


def _between(believed: BoolArray, widest: int) -> BoolArray:
    """Cells with believed ones in opposite directions, at most `widest` cells between them."""
    # So wide that no step from one row leads into the next.
    margin = widest + 1
    padded = np.pad(believed, margin)
    width, inside = padded.shape[1], padded.ravel()
    between = np.zeros_like(inside)
    places = np.flatnonzero(inside)
    for row, column in DIRECTIONS:
        step = row * width + column
        # Believed cells are few: from each of them, it is looked for another one along the line.
        for steps in range(2, int((widest + 1) / np.hypot(row, column)) + 1):
            first = places[inside[places + steps * step]]
            for passed in range(1, steps):
                between[first + passed * step] = True
    return between.reshape(padded.shape)[margin:-margin, margin:-margin]
