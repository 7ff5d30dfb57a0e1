"""When a pulse that rises slowly begins: the start of the burst that resonators make it of.

Latency and a slow rise look alike.  What tells them apart is the shape: a burst of known length
through resonators has begun a known time before its echo is as loud as it is.
"""

from __future__ import annotations

import numpy as np

from usmap_ros.acoustics.profile import resonant_profile
from usmap_ros.acoustics.pulse import Pulse
from usmap_ros.numerics.arrays import FloatArray, Signal

#: Qualities to start from, and bounds of quality and of the resonance over the carrier.
_QUALITIES = (5.0, 20.0, 60.0)
_LEAST_QUALITY, _GREATEST_QUALITY = 1.0, 300.0
_DETUNED = 0.1
#: Misfit of resonators, relative to the pulse, from which on they do not explain it.
_EXPLAINED = 0.3
#: Points that are compared.
_POINTS = 160


def onset_s(template: Signal, rate_hz: float, pulse: Pulse) -> float | None:
    """When the burst began, after the template's first value; None if resonators do not explain it.

    Parameters
    ----------
    template : (n,) array
        A pulse as received, with silence before it.
    rate_hz : float
        Of its values.
    pulse : Pulse
        The burst that traces state.
    """
    drive = pulse.driven
    time_s = np.linspace(0.0, (len(template) - 1) / rate_hz, _POINTS)
    grid_s = np.arange(len(template)) / rate_hz
    seen: Signal = np.interp(time_s, grid_s, template)
    peak_s = float(grid_s[np.argmax(np.abs(template))])

    def left(unknowns: FloatArray) -> FloatArray:
        begins_s, log_first, log_second, detuning = unknowns
        frequency_hz = drive.carrier_hz * (1.0 + detuning)
        resonances = [(frequency_hz, float(np.exp(one))) for one in (log_first, log_second)]
        profile = resonant_profile(drive.envelope, drive.duration_s, drive.carrier_hz, resonances)
        shape = profile(time_s - 1e-3 * begins_s)
        scale = np.vdot(shape, seen) / max(float(np.linalg.norm(shape)) ** 2, 1e-12)
        return np.asarray((seen - scale * shape).view(float))

    # Here, because it takes a third of a second, and to look at a recording it is not needed.
    from scipy.optimize import least_squares

    bounds = (
        [1e3 * (peak_s - 3.0 * drive.duration_s - 1e-3), *[np.log(_LEAST_QUALITY)] * 2, -_DETUNED],
        [1e3 * peak_s, *[np.log(_GREATEST_QUALITY)] * 2, _DETUNED],
    )
    lowest, highest = (np.array(side, dtype=float) for side in bounds)
    best, least = None, _EXPLAINED * float(np.linalg.norm(seen))
    for quality in _QUALITIES:
        guess = [1e3 * (peak_s - drive.duration_s), np.log(quality), np.log(0.5 * quality), 0.0]
        start = np.clip(np.array(guess), lowest, highest)
        found = least_squares(left, start, bounds=(lowest, highest), max_nfev=40)
        misfit = float(np.sqrt(2.0 * found.cost))
        if misfit < least:
            best, least = 1e-3 * float(found.x[0]), misfit
    return best
