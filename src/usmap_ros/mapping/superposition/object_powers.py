"""What each of few pings says of one object by itself, over the powers that it may scatter with."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.superposition.ping_bins import ECHO, SILENCE
from usmap_ros.mapping.superposition.sources import Sources
from usmap_ros.numerics.compiled import compiled, compiled_within
from usmap_ros.numerics.elementary import exp32, log32
from usmap_ros.parameters import MappingParameters

#: Powers that an object may have, and how many standard deviations about the median they span.
POWER_STEPS, POWER_SPREAD = 80, 3.2
#: Bounds of likelihoods: of an echo's power, and of silence.
LEAST_LOG_DENSITY, LEAST_SILENCE = np.float32(-12.0), np.float32(0.0025)
_ZERO, _ONE = np.float32(0.0), np.float32(1.0)


class PowerSteps(NamedTuple):
    """Powers that an object may have; (POWER_STEPS,) float32 arrays.

    Parameters
    ----------
    log_power : float32 array
        Their logarithms, rising.
    inverse : float32 array
        1 over them.
    log_prior : float32 array
        Logarithms of their prior.
    """

    log_power: NDArray[np.float32]
    inverse: NDArray[np.float32]
    log_prior: NDArray[np.float32]


def power_steps(parameters: MappingParameters) -> PowerSteps:
    """Powers that an object may have by what is known of objects beforehand."""
    off = np.linspace(-POWER_SPREAD, POWER_SPREAD, POWER_STEPS)
    log_prior = -0.5 * off**2 - np.log(np.exp(-0.5 * off**2).sum())
    spread = 2.0 * parameters.reflectivity_spread
    log_power = 2.0 * np.log(parameters.reflectivity) + spread * off
    columns = (log_power, np.exp(-log_power), log_prior)
    return PowerSteps(*(column.astype(np.float32) for column in columns))


@compiled_within
def compare_powers(
    kind: int,
    level: float,
    weight: float,
    variance: float,
    steps: PowerSteps,
    likelihood: NDArray[np.float32],
    total: NDArray[np.float32],
) -> None:
    """Likelihood of what a look has of one object, for each power that it may have.

    Parameters
    ----------
    kind : int
        ECHO, SILENCE or UNJUDGED.
    level : float
        Power of the echo, or below which one may have gone unreported.
    weight : float
        Power that is returned of power 1.
    variance : float
        Of the logarithm of the echo's power.
    steps : PowerSteps
        Powers that an object may scatter, and how likely each is beforehand.
    likelihood : (POWER_STEPS,) float32 array
        Set to the likelihood of what was heard, for each power.
    total : (POWER_STEPS,) float32 array
        The logarithms are added.
    """
    if kind == ECHO:
        best, scale = np.float32(math.log(level / weight)), np.float32(-0.5 / variance)
        middle = np.float32(-0.5 * math.log(2.0 * math.pi * variance))
        for step in range(POWER_STEPS):
            off = best - steps.log_power[step]
            value = max(middle + scale * off * off, LEAST_LOG_DENSITY)
            total[step] += value
            likelihood[step] = exp32(value)
    elif kind == SILENCE:
        least = np.float32(level / weight)
        for step in range(POWER_STEPS):
            value = max(_ONE - exp32(-least * steps.inverse[step]), LEAST_SILENCE)
            total[step] += log32(value)
            likelihood[step] = value
    else:
        for step in range(POWER_STEPS):
            likelihood[step] = _ONE


@compiled
def judge_alone(
    sources: Sources,
    steps: PowerSteps,
    fluctuation: float,
    density: NDArray[np.float64],
    power: NDArray[np.float64],
) -> None:
    """Density of what each look has of each suspect, given what the other looks have.

    Parameters
    ----------
    sources : Sources
        Quarters that may have returned echoes, as `compare` left them.
    steps : PowerSteps
        Powers that an object may have.
    fluctuation : float
        Standard deviation of ln amplitude from look to look.
    density : (looks, quarters) float64 array
        Set to the density of each ping's echo if it came from a quarter.
    power : (quarters,) float64 array
        Set to the mean of the power, if there is an object.
    """
    looks, quarters = sources.kind.shape
    likelihood = np.empty((looks, POWER_STEPS), np.float32)
    total = np.empty(POWER_STEPS, np.float32)
    for here in range(quarters):
        for step in range(POWER_STEPS):
            total[step] = steps.log_prior[step]
        for index in range(looks):
            level, noise = sources.level[index, here], sources.noise[index]
            variance = 4.0 * fluctuation * fluctuation
            if sources.kind[index, here] == ECHO:
                variance += 2.0 * noise / level
                level = max(level - noise, 0.25 * level)
            compare_powers(
                sources.kind[index, here],
                level,
                sources.weight[index, here],
                variance,
                steps,
                likelihood[index],
                total,
            )
        greatest = total[0]
        for step in range(1, POWER_STEPS):
            greatest = max(greatest, total[step])
        with_it, log_power = _ZERO, _ZERO
        for step in range(POWER_STEPS):
            total[step] = exp32(total[step] - greatest)
            with_it += total[step]
            log_power += total[step] * steps.log_power[step]
        for index in range(looks):
            without = _ZERO
            for step in range(POWER_STEPS):
                without += total[step] / likelihood[index, step]
            density[index, here] = with_it / without * sources.fit[index, here]
        power[here] = math.exp(log_power / with_it)
