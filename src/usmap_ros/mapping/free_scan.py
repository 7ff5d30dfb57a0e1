"""How far one ping proves the space in front of it free, direction by direction."""

from typing import NamedTuple

import numpy as np

from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

#: Angle between two rays; at 3 m they are a cell of 10 cm apart.
RAY_STEP_RAD = 0.035
#: Standard deviations of an echo's range by which free space ends before it.
CAUTION = 3.0


class FreeScan(NamedTuple):
    """Rays of a ping."""

    #: (rays,) array: off the beam axis, ascending by equal steps, positive to the left.
    angles_rad: FloatArray
    #: (rays,) array: up to where nothing stands; 0 where nothing is known.
    ranges_m: FloatArray


def free_scan(cone: EchoCone, parameters: MappingParameters) -> FreeScan:
    """Rays through what a ping says is free.

    Each ends before the first echo, wherever in the beam that came from, and where a faint object
    would go unheard: one whose reflectivity is a standard deviation below the usual one, at that
    bearing and range.

    Parameters
    ----------
    cone : EchoCone
        One ping's echoes and detection limits.
    parameters : MappingParameters
        Cell size, and reflectivity of objects.
    """
    transducer = cone.transducer
    half_rad = min(float(transducer.beam.half_angle_rad), np.pi)
    steps = max(1, int(np.ceil(half_rad / RAY_STEP_RAD)))
    angles_rad = np.linspace(-half_rad, half_rad, 2 * steps + 1)
    faint = parameters.reflectivity * np.exp(-parameters.reflectivity_spread)
    limits = cone.limit_amplitudes()
    far_m = transducer.min_range_m + (np.arange(len(limits)) + 1.0) * cone.limit_step_m
    far_m = np.minimum(far_m, transducer.max_range_m)
    loss = 10.0 ** (-cone.attenuation_db_m * far_m / 10.0)
    gain = transducer.beam.gain(np.abs(angles_rad))
    is_heard = faint * gain[:, None] * loss / far_m**2 >= limits
    # Bins that are heard without a gap from the first one on.
    bins = np.where(is_heard.all(axis=1), len(limits), np.argmin(is_heard, axis=1))
    ranges_m = np.where(bins > 0, far_m[np.maximum(bins - 1, 0)], 0.0)
    if len(cone.ranges_m):
        margin_m = parameters.resolution_m + CAUTION * float(cone.range_stds_m[0])
        ranges_m = np.minimum(ranges_m, float(cone.ranges_m[0]) - margin_m)
    return FreeScan(angles_rad, np.where(ranges_m > transducer.min_range_m, ranges_m, 0.0))
