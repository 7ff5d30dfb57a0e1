"""The level that samples rest at, as behind a converter without a sign, taken off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from usmap_ros.arrays import FloatArray, median
from usmap_ros.trace import EchoTrace, Encoding

#: Quantiles of a magnitude's quiet part, and where those of Rayleigh noise put zero: so many times
#: their distance below the lower one.
_LOW, _HIGH = 0.05, 0.25
_ZERO_BELOW = 0.226 / (0.536 - 0.226)
#: Levels nearer to zero than so many times the spread of the noise are zero.
_SPREADS, _SPREADS_OF_MAGNITUDES = 1.0, 3.0


def at_rest_zero(trace: EchoTrace) -> EchoTrace:
    """Return `trace` with samples that are around zero where nothing is heard.

    Raw and I/Q samples rest at their median, since echoes are few and their phases cancel.
    """
    samples = np.asarray(trace.samples, dtype=np.float64)
    if trace.encoding is Encoding.IQ:
        level = np.array([_median_level(samples[0::2]), _median_level(samples[1::2])])
    elif trace.encoding is Encoding.RAW and trace.transducer.pulse.has_carrier:
        level = np.array([_median_level(samples)])
    else:
        level = np.array([_least_level(samples)])
    if not level.any():
        return trace
    rested = samples.reshape(-1, len(level)) - level
    return replace(trace, samples=rested.reshape(-1).astype(np.float32))


def _median_level(samples: FloatArray) -> float:
    """Level of samples of either sign; 0 unless it is beyond doubt."""
    level = median(samples)
    apart = np.abs(samples - level)
    # A spread that most samples exceed needs not be known exactly.
    if 2 * np.count_nonzero(_SPREADS * apart >= abs(level)) > len(samples) + 1:
        return 0.0
    return 0.0 if abs(level) <= _SPREADS * median(apart) else level


def _least_level(samples: FloatArray) -> float:
    """Level of magnitudes, which noise and echoes only add to; 0 unless it is beyond doubt."""
    low, high = (float(one) for one in np.quantile(samples, [_LOW, _HIGH]))
    level = low - _ZERO_BELOW * (high - low)
    return level if level > _SPREADS_OF_MAGNITUDES * (high - low) > 0.0 else 0.0
