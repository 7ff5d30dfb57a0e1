"""How well a robot's pings agree with what a map expects of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from usmap_ros.mapping.joint.leave_one_out import Expected
from usmap_ros.mapping.ping_bins import (
    ECHO,
    NOISE_BELOW_LIMIT,
    SILENCE,
    UNJUDGED,
    Look,
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
    """Of one robot's pings with the map that the others made.

    Parameters
    ----------
    pings : int
        Of which the others' map expects anything.
    echoes : float
        Mean number of echoes in a ping.
    audible, heard : int
        Echoes that are certain to be expected, and how many of them were heard.
    matches : int
        Echoes where the map expects them; those that `loudness_db` is from.
    loudness_db : float, optional
        Median of the amplitudes of echoes over what the map expects.
    fit : float, optional
        By how much the pings are likelier with what is expected of them than with the same
        shifted in range: log-likelihood for a range bin, the median of the pings.
    """

    pings: int
    echoes: float
    audible: int
    heard: int
    matches: int
    loudness_db: float | None
    fit: float | None


def agreement(expected: Sequence[Expected]) -> Agreement:
    """Compare pings with what was expected of them."""
    fits = [fit for ping in expected if (fit := _fit(ping)) is not None]
    echoes = audible = heard = 0
    loudness: list[float] = []
    for look, power in expected:
        echoes += int(np.count_nonzero(look.kind == ECHO))
        width = 2 * round(TOLERANCE_M / look.bin_m) + 1
        signal = power - look.noise
        near = running_maximum((look.kind == ECHO).astype(np.uint8), width) > 0
        peak = (signal == running_maximum(signal, width)) & (
            signal > AUDIBLE * look.noise / NOISE_BELOW_LIMIT
        )
        # An echo that another one may have covered is not missed.
        counts = peak & (near | ((signal > AUDIBLE * look.limit) & (look.kind != UNJUDGED)))
        matched = peak & near
        audible += int(counts.sum())
        heard += int(matched.sum())
        loudest = running_maximum(look.power, width)
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
    look, power = expected.look, expected.power
    gain, bins, likelihood = 0.0, 0, log_likelihood(look, power)
    for shift_m in SHIFTS_M:
        shifted = np.full_like(power, look.noise)
        shift = round(shift_m / look.bin_m)
        if abs(shift) >= len(power):
            continue
        if shift > 0:
            shifted[shift:] = power[:-shift]
        else:
            shifted[:shift] = power[-shift:]
        likelier, told = _compared(look, shifted, power, likelihood)
        gain, bins = gain - likelier, bins + told
    return gain / bins if bins else None


def _compared(
    look: Look, power: FloatArray, other: FloatArray, likelihood: FloatArray
) -> tuple[float, int]:
    """How much likelier an expectation makes a ping than another, and how many bins tell.

    The log-likelihood of the other's bins is given: it is compared with several.
    """
    loud = 4.0 * look.noise / NOISE_BELOW_LIMIT
    # Where either says that there is an echo.
    tells = (np.maximum(power, other) > loud) & (look.kind != UNJUDGED)
    difference = (log_likelihood(look, power) - likelihood)[tells]
    return float(np.clip(difference, -MOST_A_BIN, MOST_A_BIN).sum()), int(tells.sum())


def log_likelihood(look: Look, power: FloatArray) -> FloatArray:
    """Log-likelihood of each range bin: of an echo, or of silence up to a limit.

    Parameters
    ----------
    look : Look
        What was heard.
    power : (bins,) array
        Expected power of each range bin, noise included.
    """
    heard = -look.power / power - np.log(power)
    silent = np.log(-np.expm1(-np.maximum(look.limit / power, 1e-9)))
    return np.where(look.kind == ECHO, heard, np.where(look.kind == SILENCE, silent, 0.0))
