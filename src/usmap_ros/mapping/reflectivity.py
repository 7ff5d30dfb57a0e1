"""What is known of the reflectivity of whatever may stand in a cell.

Sound comes back from one object with much the same strength every time.  So each cell carries
a normal belief about ln s, its reflectivity if it is occupied.  Echoes sharpen it, which tells
a cell from its mirror image (their gains differ from view to view, the object does not); and
silence bounds it, so that ten silent looks at an object too weak to be heard are not ten
independent proofs of absence.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from usmap_ros.numerics.arrays import IndexArray, RealArray

#: A belief is never made sharper than this (ln s).
LEAST_VARIANCE = 0.02
#: Below this many deviations the normal tail is replaced by its asymptote.
TAIL = -8.0
SQRT_TWO_PI = math.sqrt(2.0 * math.pi)
#: Keeps quotients finite in the tail, in single precision too.
TINY = 1e-30


@dataclass(frozen=True)
class LogReflectivity:
    """Normal beliefs about ln s in natural parameters, each of shape (cells,).

    Parameters
    ----------
    precision : array
        One over the variance.
    information : array
        Precision times the mean.
    """

    precision: RealArray
    information: RealArray

    @property
    def variance(self) -> RealArray:
        """Variance of ln s."""
        return 1.0 / self.precision

    @property
    def mean(self) -> RealArray:
        """Mean of ln s."""
        return self.information / self.precision

    def at(self, cells: IndexArray) -> LogReflectivity:
        """Beliefs of some of the cells."""
        return LogReflectivity(self.precision[cells], self.information[cells])


@dataclass(frozen=True)
class Silence:
    """What hearing nothing says of cells, each array of shape (cells,).

    Parameters
    ----------
    log_ratio : array
        Log-likelihood ratio of occupied against free: never positive.
    precision, information : arrays
        What is added to the belief about ln s.
    """

    log_ratio: RealArray
    precision: RealArray
    information: RealArray

    @property
    def detection_probability(self) -> RealArray:
        """Probability that an object in the cell would have been heard."""
        return -np.expm1(self.log_ratio)


def silence(
    belief: LogReflectivity, bound: RealArray, detection_probability: RealArray, fluctuation: float
) -> Silence:
    """Evidence of a silent look.

    An object is heard if ln s plus its fluctuation exceeds `bound`, unless something else keeps
    it from being heard.  The belief is updated by matching the moments of the normal that the
    bound cuts off (assumed-density filtering with a probit likelihood; Minka 2001).

    Parameters
    ----------
    belief : LogReflectivity
        Before the look.
    bound : (cells,) array
        ln of the reflectivity at which an object there would just have been reported.
    detection_probability : (cells,) array
        Probability that a loud enough object is heard at all.
    fluctuation : float
        Standard deviation of ln s from look to look.
    """
    # Here, because it takes long to load, and the default way of mapping does without.
    from scipy.special import ndtr

    variance = belief.variance
    total = np.sqrt(variance + fluctuation**2)
    deviations = (bound - belief.mean) / total
    below = ndtr(deviations)
    silent = (1.0 - detection_probability) + detection_probability * below
    # Share of the silence that is due to the object being too weak, and so bounds ln s.
    due_to_weakness = detection_probability * below / silent
    density = np.exp(-0.5 * deviations**2) / SQRT_TWO_PI
    hazard = np.where(deviations < TAIL, -deviations, density / np.maximum(below, TINY))
    shrinkage = variance**2 / total**2 * hazard * (hazard + deviations)
    bounded = np.clip(variance - shrinkage, np.minimum(LEAST_VARIANCE, variance), variance)
    mean = belief.mean - variance / total * hazard
    return Silence(
        log_ratio=np.log(silent),
        precision=due_to_weakness * (1.0 / bounded - belief.precision),
        information=due_to_weakness * (mean / bounded - belief.information),
    )
