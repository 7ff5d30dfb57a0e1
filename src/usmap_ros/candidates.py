"""The places at which the objects that one ping heard may stand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usmap_ros.cone import EchoCone
from usmap_ros.mapping.footprint import footprint


@dataclass(frozen=True)
class CandidateCells:
    """Cells that may have returned an echo, each array of shape (cells,).

    Parameters
    ----------
    x_m, y_m, z_m : arrays
        Centres, at the height of the transducer.
    coefficient : array
        Reflectivity that an object there would have.
    """

    x_m: NDArray[np.float64]
    y_m: NDArray[np.float64]
    z_m: NDArray[np.float64]
    coefficient: NDArray[np.float64]


def candidate_cells(
    cone: EchoCone, resolution_m: float, greatest_coefficient: float
) -> CandidateCells:
    """Cells at the ranges of a cone's echoes: the ambiguity that one ping leaves.

    A cell that fits several echoes counts for the one that it fits best.

    Parameters
    ----------
    cone : EchoCone
        What was heard.
    resolution_m : float
        Side of the cells; their corners are multiples of it.
    greatest_coefficient : float
        A cell where an object would need a higher reflectivity is left out, such as those at
        the edge of the beam.
    """
    cells = footprint(cone, resolution_m)
    if len(cone.ranges_m) == 0:
        nothing = np.zeros(0)
        return CandidateCells(nothing, nothing, nothing, nothing)
    ranges_m = cone.ranges_m.astype(np.float64)
    nearest = np.abs(cells.range_m[:, np.newaxis] - ranges_m).argmin(axis=1)
    std_m = np.hypot(cells.range_std_m, cone.range_stds_m[nearest])
    misfit_m = np.abs(cells.range_m - ranges_m[nearest])
    amplitude = np.maximum(
        cone.amplitudes[nearest].astype(np.float64), cone.amplitude_stds[nearest]
    )
    coefficient = amplitude / np.exp(cells.log_unit_amplitude)
    chosen = (misfit_m <= cells.half_depth_m + std_m) & (coefficient <= greatest_coefficient)
    return CandidateCells(
        x_m=(cells.columns[chosen] + 0.5) * resolution_m,
        y_m=(cells.rows[chosen] + 0.5) * resolution_m,
        z_m=np.full(np.count_nonzero(chosen), cone.pose.position_m[2]),
        coefficient=coefficient[chosen],
    )
