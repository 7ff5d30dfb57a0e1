"""The DC offset of samples, as behind a converter without a sign, taken off."""

from dataclasses import replace

import numpy as np

from usmap_ros.numerics.arrays import FloatArray, median, quantiles
from usmap_ros.numerics.compiled import IS_COMPILED, compiled
from usmap_ros.pings.trace import EchoTrace, Encoding

#: Quantiles of a magnitude's quiet part, and where those of Rayleigh noise put zero: so many times
#: their distance below the lower one.
_LOW, _HIGH = 0.05, 0.25
_ZERO_BELOW = 0.226 / (0.536 - 0.226)
#: Levels nearer to zero than so many times the spread of the noise are zero.
_SPREADS, _SPREADS_OF_MAGNITUDES = 1.0, 3.0
#: Half the magnitude that most samples exceed is looked for in so many steps.
_STEPS = 10


def without_dc_offset(trace: EchoTrace) -> EchoTrace:
    """Return `trace` with samples that are around zero where nothing is heard.

    Raw and I/Q samples rest at their median, since echoes are few and their phases cancel.
    """
    samples = np.asarray(trace.samples, dtype=np.float64)
    has_sign = trace.encoding is Encoding.IQ or (
        trace.encoding is Encoding.RAW and trace.transducer.pulse.has_carrier
    )
    values = 2 if trace.encoding is Encoding.IQ else 1
    if not has_sign:
        levels = [_least_level(samples)]
    elif IS_COMPILED and _is_around_zero(samples, values):
        return trace
    else:
        levels = [_median_level(samples[first::values]) for first in range(values)]
    if not any(levels):
        return trace
    rested = samples.reshape(-1, values) - np.array(levels)
    return replace(trace, samples=rested.reshape(-1).astype(np.float32))


@compiled
def _is_around_zero(samples: FloatArray, values: int) -> bool:
    """Whether `_median_level` is 0 beyond doubt, of each value of pairs or of all samples.

    It is if more than half are so far from zero that they are farther from the median than that is
    from zero, whatever it is.  Compiled, that takes a fraction of what it takes to find a median.
    """
    for first in range(values):
        part = samples[first::values].copy()
        near, far = 0.0, 0
        for sample in part:
            near += abs(sample) / len(part)
        for _ in range(_STEPS):
            far = 0
            for sample in part:
                far += abs(sample) >= (1.0 + 1.0 / _SPREADS) * near
            if 2 * far > len(part) + 1:
                break
            near *= 0.5
        below = above = 0
        for sample in part:
            below += sample < near
            above += sample > -near
        if 2 * min(below, above, far) <= len(part) + 1:
            return False
    return True


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
    low, high = quantiles(samples, _LOW, _HIGH)
    level = low - _ZERO_BELOW * (high - low)
    return level if level > _SPREADS_OF_MAGNITUDES * (high - low) > 0.0 else 0.0
