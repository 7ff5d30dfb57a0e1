"""The cells that the echoes of one cone may have come from."""

from dataclasses import dataclass

import numpy as np

from usmap_ros.mapping.footprint import footprint
from usmap_ros.mapping.ring import find_ring
from usmap_ros.numerics.arrays import IndexArray, RealArray
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

#: A cell less likely than this, relative to the best one for its echo, is no candidate.
LEAST_LIKELIHOOD = 0.01


@dataclass(frozen=True)
class CandidateCells:
    """Cells that may have returned an echo, each array of shape (cells,)."""

    #: Of the cells, counted from the world's origin.
    rows: IndexArray
    columns: IndexArray
    #: How well the cell fits range and strength of an echo, 1 for the cell that fits best.
    likelihood: RealArray
    #: Reflectivity that an object in the cell would need to return that echo.
    coefficient: RealArray
    #: Side of a cell.
    resolution_m: float

    @property
    def centers_m(self) -> RealArray:
        """Centres of the cells, shape (cells, 2), x before y."""
        cells = np.column_stack([self.columns, self.rows]).astype(np.float64)
        return (cells + 0.5) * self.resolution_m


def candidate_cells(cone: EchoCone, parameters: MappingParameters) -> CandidateCells:
    """Weigh all cells of a cone by how well they explain its echoes.

    This is what a single ping can say: mirror images are as likely as what they mirror.

    Parameters
    ----------
    cone : EchoCone
        One ping's echoes.
    parameters : MappingParameters
        Cells and sensor model.
    """
    cells = footprint(cone, parameters.resolution_m)
    ring = find_ring(cone, cells, parameters)
    spread = parameters.reflectivity_spread**2 + ring.variance
    misfit = (ring.log_reflectivity - np.log(parameters.reflectivity)) ** 2 / spread
    fit = ring.range_fit * np.exp(-0.5 * misfit)
    best = np.zeros(ring.echo_count)
    np.maximum.at(best, ring.echo, fit)
    relative = fit / np.maximum(best[ring.echo], np.finfo(float).tiny)
    # Of the echoes that a cell fits, the one that it fits best: the last in ascending order.
    order = np.argsort(relative, kind="stable")
    favourite = np.zeros(len(ring.cells), dtype=np.intp)
    favourite[ring.cell[order]] = order
    kept = relative[favourite] >= LEAST_LIKELIHOOD
    places, favourite = ring.cells[kept], favourite[kept]
    return CandidateCells(
        rows=cells.rows[places],
        columns=cells.columns[places],
        likelihood=relative[favourite],
        coefficient=np.exp(ring.log_reflectivity[favourite]),
        resolution_m=parameters.resolution_m,
    )
