"""Classic fusion: independent evidence, added up cell by cell.

Every cell of an echo's ring is told that it may be occupied, no matter what its ring-mates
explain already.  Single pings therefore draw arcs; the method is kept as the well-known
yardstick (Moravec & Elfes, "High resolution maps from wide angle sonar", 1985).
"""

from __future__ import annotations

import numpy as np

from usmap_ros.mapping.export import EXPOSURE, LOG_ODDS
from usmap_ros.mapping.footprint import footprint
from usmap_ros.mapping.fusion import Fusion
from usmap_ros.mapping.reflectivity import silence
from usmap_ros.mapping.ring import Ring, find_ring, fit_to_ring
from usmap_ros.mapping.yardsticks.sensor_model import log_reflectivity_bound, prior_reflectivity
from usmap_ros.numerics.arrays import RealArray
from usmap_ros.pings.cone import EchoCone


class AdditiveFusion(Fusion):
    """A map in which each cell adds up log-odds as if it were alone on its ring."""

    def _take_up(self, cone: EchoCone, source: str) -> None:
        cells = footprint(cone, self.parameters.resolution_m)
        slots = self._grid.slots(cells.rows, cells.columns)
        ring = find_ring(cone, cells, self.parameters)
        nothing = np.zeros(len(slots))
        belief = prior_reflectivity(self.parameters, nothing, nothing)
        detection_probability = np.full(len(slots), self.parameters.detection_probability)
        bound = log_reflectivity_bound(cone, cells)
        quiet = silence(belief, bound, detection_probability, self.parameters.fluctuation)
        evidence = quiet.log_ratio
        fit = fit_to_ring(ring, belief.at(ring.cells), detection_probability[ring.cells])
        evidence[ring.cells] = self._gain(ring, fit)
        log_odds = self._grid.layer(LOG_ODDS)
        log_odds[slots] = self._clamped(log_odds[slots] + evidence)
        self._grid.layer(EXPOSURE)[slots] += quiet.detection_probability

    def _gain(self, ring: Ring, fit: RealArray) -> RealArray:
        """Log-likelihood ratios of the ring's cells.

        A cell that fits is as likely to have returned the echo as any other cell of its ring
        that fits as well: its share of the echo, against the prior.
        """
        by_echo = np.bincount(ring.echo, fit, ring.echo_count)
        share = fit / np.maximum(by_echo[ring.echo], np.finfo(float).tiny)
        prior = self.parameters.prior
        gain = np.log1p(share * (1.0 - prior) / prior)
        return np.bincount(ring.cell, gain, len(ring.cells)).astype(np.float64)
