"""What could be known of a place: the cells in sight of at least two pings, by the truth."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_dilation, binary_erosion, find_objects, label

from usmap_ros.evaluation.alignment import AlignedMaps
from usmap_ros.evaluation.line_of_sight import pings_in_sight
from usmap_ros.grids import TruthMap
from usmap_ros.numerics.arrays import BoolArray, IntArray
from usmap_ros.pings.fields_of_view import PingViews

#: Pings that must have a cell in line of sight before it could be known.
PINGS_TO_KNOW = 2
#: Nothing in a truth of lone poles is longer than this along an axis, or than so many cells.
POLE_SIDE_M, POLE_CELLS = 0.25, 2

_AROUND = np.ones((3, 3), dtype=bool)


@dataclass(frozen=True)
class InSight:
    """Cells of which a map could know, whatever it says."""

    #: (rows, columns) bool array: all of them, within the rectangle of the truth: beyond, it says
    #: nothing.
    cells: BoolArray
    #: (rows, columns) bool array: those that are occupied and have an unoccupied one among their
    #: eight neighbours.
    surface: BoolArray
    #: (rows, columns) bool array: those farther than one cell (Chebyshev) from any occupied one.
    open: BoolArray


def in_sight(
    maps: AlignedMaps, truth: TruthMap, views: PingViews | None, sightings: IntArray | None
) -> InSight:
    """Cells that at least `PINGS_TO_KNOW` pings have in line of sight.

    Occupied cells stop sight behind themselves, but not where the truth is lone poles: sound
    passes them on both sides, and is heard behind them.

    Parameters
    ----------
    maps : AlignedMaps
        The map and the truth.
    truth : TruthMap
        The truth on its own cells.
    views : PingViews or None
        What pings looked at; without them, all within one cell of an observed cell stands in.
    sightings : (rows, columns) int array or None
        Pings that have each cell in line of sight where occupied cells stop it; with `views`.
    """
    if views is None or sightings is None:
        cells = binary_dilation(maps.observed, _AROUND)
    else:
        if is_lone_poles(truth):
            nothing = np.zeros_like(maps.occupied)
            sightings = pings_in_sight(nothing, maps.geometry, views)
        cells = sightings >= PINGS_TO_KNOW
    cells = cells & maps.charted
    inside = binary_erosion(maps.occupied, _AROUND)
    return InSight(
        cells=cells,
        surface=cells & maps.occupied & ~inside,
        open=cells & ~binary_dilation(maps.occupied, _AROUND),
    )


def is_lone_poles(truth: TruthMap) -> bool:
    """Whether a truth holds nothing but poles that stand alone.

    That is so if no group of occupied cells that touch one another, diagonals included, is longer
    along either axis than `POLE_SIDE_M` or `POLE_CELLS` of its cells, whichever is more.  One wall,
    crate or thick column anywhere is enough for a truth to be none of lone poles.

    Parameters
    ----------
    truth : TruthMap
        On its own cells, so that the cells of a map that is scored have no say.
    """
    groups, _ = label(truth.occupied, structure=_AROUND)
    longest = max(
        (side.stop - side.start for found in find_objects(groups) for side in found), default=0
    )
    # Sizes of cells have no exact binary form.
    most = max(POLE_SIDE_M / truth.geometry.resolution_m + 1e-6, POLE_CELLS)
    return bool(longest <= most)
