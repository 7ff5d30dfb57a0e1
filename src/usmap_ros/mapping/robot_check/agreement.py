"""How well a robot's pings agree with what a map expects of them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from usmap_ros.mapping.joint.leave_one_out import Expected
from usmap_ros.mapping.ping_bins import (
    ECHO,
    NOISE_BELOW_LIMIT,
    SILENCE,
    UNJUDGED,
    PingBins,
)
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.special import running_maximum

#: Echoes within this of where they are expected are those that were expected, m.
TOLERANCE_M = 0.05
#: An echo is certainly audible if its expected power is so many times the detection limit's.
AUDIBLE = 3.0
#: Shifts of range that expectations are compared with: more than errors of poses make, m.
SHIFTS_M = (-0.35, -0.25, -0.15, 0.15, 0.25, 0.35)
#: Bound of the difference of a range bin's log-likelihoods.
MOST_A_BIN = 3.0
#: Pings with expectations that are needed to judge a robot.
LEAST_PINGS = 8


@dataclass(frozen=True)
class Agreement:
    """Of one robot's pings with the map that the others made."""

    #: Of which the others' map expects anything.
    pings: int
    #: Mean number of echoes in a ping.
    echoes: float
    #: Echoes that are certain to be expected, and how many of them were heard.
    audible: int
    heard: int
    #: Echoes where the map expects them; those that `loudness_db` is from.
    matches: int
    #: Median of the amplitudes of echoes over what the map expects.
    loudness_db: float | None
    #: By how much the pings are likelier with what is expected of them than with the same shifted
    #: in range: log-likelihood for a range bin, the median of the pings.
    fit: float | None


def agreement(expected: Sequence[Expected]) -> Agreement:
    """Compare pings with what was expected of them."""
    fits = [fit for ping in expected if (fit := _fit(ping)) is not None]
    echoes = audible = heard = 0
    loudness: list[float] = []
    for ping_bins, power in expected:
        echoes += int(np.count_nonzero(ping_bins.kind == ECHO))
        width = 2 * round(TOLERANCE_M / ping_bins.bin_m) + 1
        signal = power - ping_bins.noise
        near = running_maximum((ping_bins.kind == ECHO).astype(np.uint8), width) > 0
        peak = (signal == running_maximum(signal, width)) & (
            signal > AUDIBLE * ping_bins.noise / NOISE_BELOW_LIMIT
        )
        # An echo that another one may have covered is not missed.
        counts = peak & (
            near | ((signal > AUDIBLE * ping_bins.limit) & (ping_bins.kind != UNJUDGED))
        )
        matched = peak & near
        audible += int(counts.sum())
        heard += int(matched.sum())
        loudest = running_maximum(ping_bins.power, width)
        loudness += (10.0 * np.log10(loudest[matched] / signal[matched])).tolist()
    return Agreement(
        pings=len(fits),
        echoes=echoes / max(len(expected), 1),
        audible=audible,
        heard=heard,
        matches=len(loudness),
        loudness_db=float(np.median(loudness)) if loudness else None,
        fit=float(np.median(fits)) if fits else None,
    )


def _fit(expected: Expected) -> float | None:
    """Mean gain in log-likelihood over shifted expectations; None where nothing is expected."""
    ping_bins, power = expected.ping_bins, expected.power
    gain, bins, likelihood = 0.0, 0, log_likelihood(ping_bins, power)
    for shift_m in SHIFTS_M:
        shifted = np.full_like(power, ping_bins.noise)
        shift = round(shift_m / ping_bins.bin_m)
        if abs(shift) >= len(power):
            continue
        if shift > 0:
            shifted[shift:] = power[:-shift]
        else:
            shifted[:shift] = power[-shift:]
        likelier, told = _compared(ping_bins, shifted, power, likelihood)
        gain, bins = gain - likelier, bins + told
    return gain / bins if bins else None


def _compared(
    ping_bins: PingBins, power: FloatArray, other: FloatArray, likelihood: FloatArray
) -> tuple[float, int]:
    """How much likelier an expectation makes a ping than another, and how many bins tell.

    The log-likelihood of the other's bins is given: it is compared with several.
    """
    loud = 4.0 * ping_bins.noise / NOISE_BELOW_LIMIT
    # Where either says that there is an echo.
    tells = (np.maximum(power, other) > loud) & (ping_bins.kind != UNJUDGED)
    difference = (log_likelihood(ping_bins, power) - likelihood)[tells]
    return float(np.clip(difference, -MOST_A_BIN, MOST_A_BIN).sum()), int(tells.sum())


def log_likelihood(ping_bins: PingBins, power: FloatArray) -> FloatArray:
    """Log-likelihood of each range bin: of an echo, or of silence up to a limit.

    Parameters
    ----------
    ping_bins : PingBins
        What was heard.
    power : (bins,) array
        Expected power of each range bin, noise included.
    """
    heard = -ping_bins.power / power - np.log(power)
    silent = np.log(-np.expm1(-np.maximum(ping_bins.limit / power, 1e-9)))
    return np.where(ping_bins.kind == ECHO, heard, np.where(ping_bins.kind == SILENCE, silent, 0.0))
