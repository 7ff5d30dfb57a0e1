"""How well a robot's pings agree with what a map expects of them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.leave_one_out import Expected
from usmap_ros.mapping.ping_bins import (
    ECHO,
    NOISE_BELOW_LIMIT,
    SILENCE,
    UNJUDGED,
)
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.compiled import compiled, inlined
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

    @property
    def gain(self) -> float:
        """The same of all of them: who looks elsewhere may fit what little is expected there."""
        return self.pings * (self.fit or 0.0)


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
    shifts = np.array([round(shift_m / ping_bins.bin_m) for shift_m in SHIFTS_M])
    gain, bins = gain_over_shifted(
        ping_bins.kind, ping_bins.power, ping_bins.limit, power, ping_bins.noise, shifts
    )
    return gain / bins if bins else None


@compiled
def gain_over_shifted(
    kind: NDArray[np.uint8],
    heard: NDArray[np.float32],
    limit: NDArray[np.float32],
    power: FloatArray,
    noise: float,
    shifts: NDArray[np.int64],
) -> tuple[float, int]:
    """How much likelier an expectation makes a ping than the same shifted, and how many bins tell.

    Parameters
    ----------
    kind, heard, limit
        Of each range bin: `kind`, `power` and `limit` of `PingBins`.
    power : (bins,) array
        Expected power of each, noise included.
    noise : float
        Power of the noise.
    shifts : (shifts,) integer array
        By how many bins it is shifted; all that tell are added up.
    """
    gain, told, loud = 0.0, 0, 4.0 * noise / NOISE_BELOW_LIMIT
    likelihood = np.empty(len(power))
    for b in range(len(power)):
        likelihood[b] = _log_likelihood(kind[b], heard[b], limit[b], power[b])
    for shift in shifts:
        if abs(shift) >= len(power):
            continue
        for b in range(len(power)):
            shifted = power[b - shift] if 0 <= b - shift < len(power) else noise
            # Where either says that there is an echo.
            if max(power[b], shifted) > loud and kind[b] != UNJUDGED:
                likelier = likelihood[b] - _log_likelihood(kind[b], heard[b], limit[b], shifted)
                gain += min(max(likelier, -MOST_A_BIN), MOST_A_BIN)
                told += 1
    return gain, told


@inlined
def _log_likelihood(kind: int, heard: float, limit: float, power: float) -> float:
    """Log-likelihood of a range bin: of an echo, or of silence up to a limit."""
    likelihood = 0.0
    if kind == ECHO:
        likelihood = -heard / power - math.log(power)
    elif kind == SILENCE:
        likelihood = math.log(-math.expm1(-max(limit / power, 1e-9)))
    return likelihood
