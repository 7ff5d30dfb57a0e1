"""Units of samples, where they are so far off that detection limits could not be told in them."""

import math

import numpy as np

from usmap_ros.pings.preparation.dc_offset import without_dc_offset
from usmap_ros.pings.trace import EchoTrace

#: What the loudest sample of a ping means as a reflectivity most often; and the powers of ten by
#: which it may mean less or more, noise included: a limit that is told may be 60 dB too low.
USUAL_REFLECTIVITY, USUAL_POWERS = 0.7, 2.0


def unit_of(trace: EchoTrace) -> float:
    """The power of ten by which samples are too large, such as a converter's counts; 1 as a rule.

    Parameters
    ----------
    trace : EchoTrace
        Any ping.

    Returns
    -------
    unit : float
        0 where it holds nothing that tells.
    """
    signal = without_dc_offset(trace).signal()
    range_m = 0.5 * trace.channel.sound_speed_m_s * trace.sample_times_s()
    is_heard = (range_m >= trace.transducer.min_range_m) & (range_m <= trace.transducer.max_range_m)
    level = float(np.max(np.abs(signal) * range_m**2, where=is_heard, initial=0.0))
    if level <= 0.0:
        return 0.0
    powers = math.log10(level / USUAL_REFLECTIVITY)
    return 10.0 ** round(powers) if abs(powers) > USUAL_POWERS else 1.0
