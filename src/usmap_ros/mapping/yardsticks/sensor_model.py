"""How likely an object in a cell would have been heard by a ping."""

from __future__ import annotations

import math

import numpy as np

from usmap_ros.mapping.footprint import Footprint
from usmap_ros.mapping.reflectivity import LogReflectivity
from usmap_ros.numerics.arrays import RealArray
from usmap_ros.numerics.special import running_maximum
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

#: Deviations of range, from the pose's uncertainty, over which a detection limit is taken.
LIMIT_DEVIATIONS = 1.5


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


def prior_reflectivity(
    parameters: MappingParameters, precision: RealArray, information: RealArray
) -> LogReflectivity:
    """Belief about ln reflectivity: the prior, and what was learnt beyond it."""
    prior_precision = 1.0 / parameters.reflectivity_spread**2
    prior_information = prior_precision * math.log(parameters.reflectivity)
    # Single precision may leave a trace less than nothing where evidence was taken back.
    return LogReflectivity(
        prior_precision + np.maximum(precision, 0.0), prior_information + information
    )
