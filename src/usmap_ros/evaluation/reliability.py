"""Whether a map means its probabilities: of cells given 0.8, about 80 % should hold a surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_dilation

from usmap_ros.evaluation.alignment import align
from usmap_ros.grids import OccupancyMap, TruthMap
from usmap_ros.numerics.arrays import FloatArray, IndexArray

#: Of probability, equally wide.
BINS = 20
#: Cells that are surer to be free than this are nearly all cells, and nearly all right.
SURELY_FREE = 0.05
#: Bins with a smaller share of the other cells than this say too little.
LEAST_SHARE = 0.01


@dataclass(frozen=True)
class Reliability:
    """What became of cells by the probability they were given; reliabilities of maps add up."""

    #: (BINS,) integer array: observed cells in each bin of probability.
    cells: IndexArray
    #: (BINS,) array: sum of their probabilities.
    probability_sums: FloatArray
    #: (BINS,) integer arrays: cells that hold a surface; that hold one or have one among their
    #: eight neighbours.
    holding: IndexArray
    touching: IndexArray

    def __add__(self, other: Reliability) -> Reliability:
        return Reliability(
            self.cells + other.cells,
            self.probability_sums + other.probability_sums,
            self.holding + other.holding,
            self.touching + other.touching,
        )

    @property
    def mean_probability(self) -> FloatArray:
        """Of each bin's cells; NaN for a bin without any."""
        return self._share(self.probability_sums)

    @property
    def share_holding(self) -> FloatArray:
        """Share of each bin's cells that hold a surface; NaN for a bin without any."""
        return self._share(self.holding)

    @property
    def share_touching(self) -> FloatArray:
        """Share of each bin's cells that hold or touch a surface; NaN for a bin without any."""
        return self._share(self.touching)

    def worst(self, *, touching: bool = True) -> float:
        """Largest distance from the diagonal of a bin above `SURELY_FREE` that holds enough cells.

        Parameters
        ----------
        touching : bool
            Whether a cell that touches a surface counts as right, or only one that holds it.

        Returns
        -------
        distance : float
            NaN if no cell is above.
        """
        cells = np.where(np.arange(BINS) >= round(SURELY_FREE * BINS), self.cells, 0)
        enough = cells > LEAST_SHARE * cells.sum()
        if not enough.any():
            return float("nan")
        share = self.share_touching if touching else self.share_holding
        return float(np.abs(share - self.mean_probability)[enough].max())

    def _share(self, sums: FloatArray | IndexArray) -> FloatArray:
        with np.errstate(invalid="ignore"):
            return sums / self.cells


def reliability(occupancy: OccupancyMap, truth: TruthMap) -> Reliability:
    """Count what became of a map's observed cells.

    Raises
    ------
    ValueError
        If the two have different resolutions, or origins that are not whole cells apart.
    """
    maps = align(occupancy, truth)
    probability = maps.probability[maps.observed]
    near = binary_dilation(maps.occupied, np.ones((3, 3), dtype=bool))
    index = np.minimum((probability * BINS).astype(np.int64), BINS - 1)
    holding, touching = index[maps.occupied[maps.observed]], index[near[maps.observed]]
    return Reliability(
        cells=np.bincount(index, minlength=BINS),
        probability_sums=np.bincount(index, probability, BINS).astype(np.float64),
        holding=np.bincount(holding, minlength=BINS),
        touching=np.bincount(touching, minlength=BINS),
    )
