"""Evidence of each cell: how much worse all pings would be explained without it.

Besides, from where a cell was heard: echoes from one direction leave its place along their rings
open, and so the spread of directions says how well it is known where it is.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.forward_model.cell_parts import LEAST_SHARE, Cells
from usmap_ros.mapping.joint.forward_model.likelihood_ratios import LikelihoodRatios
from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.mapping.joint.visibility.projection import first_from
from usmap_ros.mapping.ping_table import PingTable, X, Y
from usmap_ros.numerics.compiled import compiled, inlined

#: A ping with a log-likelihood ratio beyond this contradicts what speaks for the opposite.
CONTRADICTION = 0.5


class CellEvidence(NamedTuple):
    """Sums over all pings; (cells,) float32 arrays."""

    #: Log-likelihood ratio with the cell to without it, and with its eight neighbours.
    own: NDArray[np.float32]
    block: NDArray[np.float32]
    #: Echoes that the block explains, by its share in each.
    heard: NDArray[np.float32]
    #: The same times cosine and sine of twice the direction that the cell was heard from.
    axis_cos: NDArray[np.float32]
    axis_sin: NDArray[np.float32]
    #: The same times the unit vector from the cell to who heard it.
    from_x: NDArray[np.float32]
    from_y: NDArray[np.float32]
    #: The same times the number of echoes that crowd around each.
    crowd: NDArray[np.float32]
    #: Pings with an echo that may be the block's.
    asked: NDArray[np.float32]


def no_evidence(field: Field) -> CellEvidence:
    """Evidence before any ping."""
    cells = field.rows * field.columns
    return CellEvidence(*(np.zeros(cells, np.float32) for _ in CellEvidence._fields))


@compiled
def add_ratios(  # noqa: PLR0913, PLR0917 - a kernel takes arrays
    table: PingTable,
    pings: NDArray[np.int64],
    weights: NDArray[np.float32],
    ratios: LikelihoodRatios,
    cells: Cells,
    field: Field,
    forgetting: float,
    evidence: CellEvidence,
    first: int,
    stop: int,
) -> None:
    """Add what some pings say of some cells, one after the other, to what was said before.

    Parameters
    ----------
    table, pings, ratios, cells, field
        As in `usmap_ros.mapping.joint.forward_model.likelihood_ratios.weigh_pings`.
    weights : (pings,) float32 array
        How much each ping counts.
    forgetting : float
        Share of what speaks for a cell that is forgotten with a ping that contradicts it.
    evidence : CellEvidence
        Added to.
    first, stop : int
        The first of the cells, and the end.
    """
    for index in range(len(pings)):
        weight, numbers = weights[index], table.numbers[pings[index]]
        end = ratios.start[index + 1]
        begin = first_from(ratios.cell, ratios.start[index], end, first)
        for row in range(begin, first_from(ratios.cell, begin, end, stop)):
            cell = cells.number[ratios.cell[row]]
            evidence.own[cell] = _added(evidence.own[cell], ratios.own[row], weight, forgetting)
            evidence.block[cell] = _added(
                evidence.block[cell], ratios.block[row], weight, forgetting
            )
            evidence.asked[cell] += ratios.asked[row] * weight
            if ratios.share[row] <= LEAST_SHARE:
                continue
            # From where the cell is heard, and how many echoes crowd around its own.
            share, (up, right) = ratios.share[row] * weight, divmod(cell, field.columns)
            x = (field.first_column + right + 0.5) * field.resolution_m - numbers[X]
            y = (field.first_row + up + 0.5) * field.resolution_m - numbers[Y]
            squared = x * x + y * y
            distance = math.sqrt(squared)
            evidence.heard[cell] += share
            evidence.axis_cos[cell] += share * (x * x - y * y) / squared
            evidence.axis_sin[cell] += share * 2.0 * x * y / squared
            evidence.from_x[cell] -= share * x / distance
            evidence.from_y[cell] -= share * y / distance
            evidence.crowd[cell] += share * ratios.crowd[row]


@inlined
def _added(sum_so_far: float, ratio: float, weight: float, forgetting: float) -> float:
    """A sum of evidence with one more ping, of which contradictions make it forget."""
    if ratio < -CONTRADICTION and sum_so_far > 0.0:
        sum_so_far *= 1.0 - forgetting
    return sum_so_far + ratio * weight
