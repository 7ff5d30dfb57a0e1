"""What the map tells of its cells beside its belief, from the evidence that the fusion keeps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.grids import AMBIGUITY, LOOKS_COS, LOOKS_SIN, NORMAL, OccupancyMap
from usmap_ros.mapping.export import LOG_ODDS, on_map
from usmap_ros.mapping.grid import TiledGrid
from usmap_ros.mapping.normals import surface_normals
from usmap_ros.mapping.superposition.responsibilities import Responsibilities
from usmap_ros.numerics.arrays import IndexArray
from usmap_ros.numerics.special import entropy, logistic, running_maximum


class Suspects(NamedTuple):
    """The cells that may hold something, and what is known of them.

    Parameters
    ----------
    rows, columns, slots : (n,) integer arrays
        Row, column and place in memory of each suspected cell.
    log_odds : (n,) float32 array
        By their evidence, not clamped.
    responsibilities : Responsibilities of (n,) float32 arrays
        In what was heard.
    """

    rows: IndexArray
    columns: IndexArray
    slots: IndexArray
    log_odds: NDArray[np.float32]
    responsibilities: Responsibilities


def map_layers(occupancy: OccupancyMap, suspects: Suspects) -> dict[str, NDArray[np.float32]]:
    """All layers of a map."""
    responsibilities = suspects.responsibilities

    def placed(values: NDArray[np.float32]) -> NDArray[np.float32]:
        return on_map(occupancy.geometry, suspects.rows, suspects.columns, values)

    looks: NDArray[np.float32] = np.maximum(responsibilities.heard, np.float32(1.0))
    explained = _around(placed(responsibilities.explained / looks))
    heard: NDArray[np.float32] = np.maximum(
        _around(placed(responsibilities.heard)), np.float32(1.0)
    )
    belief = _greatest_around(placed(logistic(suspects.log_odds)))
    return {
        NORMAL: map_normals(occupancy, suspects),
        AMBIGUITY: undecided(explained, belief),
        LOOKS_COS: _around(placed(responsibilities.axis_cos)) / heard,
        LOOKS_SIN: _around(placed(responsibilities.axis_sin)) / heard,
    }


def _around(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Sum over each cell and its eight neighbours."""
    padded = np.pad(values, 1)
    rows: NDArray[np.float32] = padded[:-2] + padded[1:-1] + padded[2:]
    sums: NDArray[np.float32] = rows[:, :-2] + rows[:, 1:-1] + rows[:, 2:]
    return sums


def _greatest_around(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Greatest of each cell and its eight neighbours."""
    return running_maximum(running_maximum(values, 3).T, 3).T


def undecided(explained: NDArray[np.float32], belief: NDArray[np.float32]) -> NDArray[np.float32]:
    """How undecided it is what cells hold: the entropy, in bits, of its being something.

    A block of nine cells that explains its echoes holds their source, and one whose echoes
    others explain does not.  What lies between is undecided, unless evidence has
    decided it: the cells of a wall share their echoes, and stand there all the same.

    Parameters
    ----------
    explained : (rows, columns) float32 array
        Mean share of each cell and its neighbours in the echoes that may have come from there.
    belief : (rows, columns) float32 array
        Greatest probability by the evidence of each cell and its neighbours.
    """
    probability = np.clip(np.maximum(explained, belief), 0.0, 1.0)
    bits = np.zeros_like(probability)
    # Nothing is suspected in most cells of a map, and logarithms take long.
    in_doubt = (probability > 0.0) & (probability < 1.0)
    likely = probability[in_doubt].astype(np.float64)
    nats = entropy(likely) + entropy(1.0 - likely)
    bits[in_doubt] = np.clip(nats / np.log(2.0), 0.0, 1.0)
    return bits


def map_normals(occupancy: OccupancyMap, suspects: Suspects) -> NDArray[np.float32]:
    """Layer `usmap_ros.grids.NORMAL` of a map."""
    heard_from = [
        on_map(occupancy.geometry, suspects.rows, suspects.columns, heard)
        for heard in (suspects.responsibilities.heard_x, suspects.responsibilities.heard_y)
    ]
    believed = occupancy.predicted()
    return surface_normals(believed, occupancy.probability(), np.stack(heard_from, axis=-1))


def directions_heard_from(grid: TiledGrid, occupancy: OccupancyMap) -> NDArray[np.float32]:
    """Vectors from the cells of a map to those who heard them, as far as its normals tell.

    Parameters
    ----------
    grid : TiledGrid
        Which has all cells of the map.
    occupancy : OccupancyMap
        A map that was exported before.

    Returns
    -------
    heard : (2, slots) float32 array
        Unit vectors; 0 where no normal is known.
    """
    heard = np.zeros((2, len(grid.layer(LOG_ODDS))), np.float32)
    if NORMAL in occupancy.layers:
        normal_rad = occupancy.layers[NORMAL]
        left, top = occupancy.geometry.first_cell
        # Of cells that nothing is known of there is no side either.
        known = np.isfinite(normal_rad) & occupancy.observed
        rows, columns = np.nonzero(known)
        slots = grid.slots(rows + top, columns + left)
        heard[:, slots] = np.cos(normal_rad[rows, columns]), np.sin(normal_rad[rows, columns])
    return heard
