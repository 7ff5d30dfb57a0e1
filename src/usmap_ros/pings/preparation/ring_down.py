"""Cones without what their transducer hears of itself in every ping."""

import numpy as np

from usmap_ros.parameters import RingingParameters
from usmap_ros.pings.cone import EchoCone

#: How far from where the ringing was found its echoes may be, and how much louder.
_WIDTH_M, _LOUDER = 0.02, 1.5


def without_ringing(cone: EchoCone, ringing: RingingParameters) -> EchoCone:
    """Drop echoes that are no louder than the ringing where they are, and say what it hides.

    Parameters
    ----------
    cone : EchoCone
        As reconstructed, with what the transducer hears of itself among its echoes.
    ringing : RingingParameters
        What is heard in every ping.
    """
    if not any(ringing.amplitudes):
        return cone
    loudness = _LOUDER * np.asarray(ringing.amplitudes)
    at_m = np.asarray(ringing.ranges_m)
    near = np.abs(cone.ranges_m[:, np.newaxis] - at_m) < _WIDTH_M
    begin_m = cone.transducer.min_range_m + cone.limit_step_m * np.arange(
        len(cone.detection_limits)
    )
    reached = (begin_m[:, np.newaxis] < at_m + _WIDTH_M) & (
        begin_m[:, np.newaxis] + cone.limit_step_m > at_m - _WIDTH_M
    )
    return cone.louder_than(
        np.max(np.where(near, loudness, -1.0), axis=1),
        np.max(np.where(reached, loudness, 0.0), axis=1),
    )
