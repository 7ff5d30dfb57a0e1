"""Classic fusion: independent evidence, added up cell by cell.

Every cell of an echo's ring is told that it may be occupied, no matter what its ring-mates
explain already.  Single pings therefore draw arcs; the method is kept as the well-known
yardstick (Moravec & Elfes, "High resolution maps from wide angle sonar", 1985).
"""

import math

import numpy as np

from usmap_ros.mapping.footprint import Footprint, footprint
from usmap_ros.mapping.ring import Ring, find_ring
from usmap_ros.mapping.yardsticks.cell_fusion import CellFusion
from usmap_ros.numerics.arrays import RealArray
from usmap_ros.numerics.special import running_maximum
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

#: Deviations of range, from the pose's uncertainty, over which a detection limit is taken.
LIMIT_DEVIATIONS = 1.5


class AdditiveFusion(CellFusion):
    """A map in which each cell adds up log-odds as if it were alone on its ring."""

    def _take_up(self, cone: EchoCone, source: str) -> None:
        cells = footprint(cone, self.parameters.resolution_m)
        ring = find_ring(cone, cells, self.parameters)
        evidence = silence(log_reflectivity_bound(cone, cells), self.parameters)
        evidence[ring.cells] = self._gain(ring, fit_to_ring(ring, self.parameters))
        # What an echo says for a cell says as well that silence proves less of it.
        self._add(cells.rows, cells.columns, evidence, exposure=-np.expm1(evidence))

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


def log_reflectivity_bound(cone: EchoCone, cells: Footprint) -> RealArray:
    """Logarithm of the reflectivity at which an object in each cell would just be reported.

    The cone's detection limit, highest over the ranges at which the cell may lie, over the
    echo that an object of reflectivity 1 would return from there.
    """
    limits = cone.limit_amplitudes()
    reach_m = cells.half_depth_m + LIMIT_DEVIATIONS * cells.range_std_m
    bins = int(np.ceil(reach_m.max(initial=0.0) / cone.limit_step_m))
    highest = running_maximum(limits, 2 * bins + 1)
    index = ((cells.range_m - cone.transducer.min_range_m) / cone.limit_step_m).astype(np.intp)
    limit = highest[np.clip(index, 0, len(highest) - 1)]
    bound: RealArray = np.log(limit) - cells.log_unit_amplitude
    return bound


def silence(bound: RealArray, parameters: MappingParameters) -> RealArray:
    """Log-likelihood ratio of silence, of occupied against free: never positive, (cells,).

    An object is heard if ln s, its reflectivity's, plus its fluctuation exceeds a bound, unless
    something else keeps it from being heard.

    Parameters
    ----------
    bound : (cells,) array
        ln of the reflectivity at which an object there would just have been reported.
    parameters : MappingParameters
        Reflectivity, its spread and fluctuation, and the probability of hearing what is loud.
    """
    # Here, because it takes long to load, and the default way of mapping does without.
    from scipy.special import ndtr

    total = math.hypot(parameters.reflectivity_spread, parameters.fluctuation)
    unheard = ndtr((bound - math.log(parameters.reflectivity)) / total)
    heard = parameters.detection_probability
    log_ratio: RealArray = np.log((1.0 - heard) + heard * unheard)
    return log_ratio


def fit_to_ring(ring: Ring, parameters: MappingParameters) -> RealArray:
    """Likelihood of each pair's echo, had the cell returned it; 1 for a perfect fit, (pairs,)."""
    spread = parameters.reflectivity_spread**2 + ring.variance
    misfit = (ring.log_reflectivity - math.log(parameters.reflectivity)) ** 2 / spread
    loudness_fit = np.sqrt(ring.variance / spread) * np.exp(-0.5 * misfit)
    fit: RealArray = parameters.detection_probability * ring.range_fit * loudness_fit
    return fit
