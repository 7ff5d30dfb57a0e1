"""The search for echoes: on a grid of delays, and off it.

There are two ways to do it with the same outcome: compiled, for the echoes of one pulse, which is
what a transducer by itself hears; and by a sensing operator of any kind, for several pulses at
once and where nothing is compiled.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from usmap_ros.numerics.arrays import FloatArray, IndexArray
from usmap_ros.numerics.compiled import IS_COMPILED
from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.reconstruction.baseband import Baseband
from usmap_ros.reconstruction.cosamp import Halt, Solution, check_signal, cosamp
from usmap_ros.reconstruction.delay_domain import DelayDomainOperator
from usmap_ros.reconstruction.detection import noise_thresholds
from usmap_ros.reconstruction.joint import DelayOperator
from usmap_ros.reconstruction.refinement import between_samples, delay_step
from usmap_ros.reconstruction.sampled import search as sampled

#: A round of refinement whose largest step is below this share of a grid step is the last.
SETTLED_STEP = 0.05
#: A step below this share needs no other after it, unless it let new echoes be found: Gauss-Newton
#: steps converge quadratically, and next to nothing of a grid step is left.
SMALL_STEP = 0.6
#: What such a step leaves, as a share of a grid step.
LEFT_OVER = 0.001
#: Why compiled CoSaMP stopped, by the numbers of `usmap_ros.reconstruction.sampled.cosamp`.
HALTS = (
    Halt.NOISE_LEVEL,
    Halt.NOTHING_LEFT,
    Halt.STABLE_SUPPORT,
    Halt.NO_PROGRESS,
    Halt.ITERATIONS,
)


@dataclass(frozen=True)
class Searched:
    """Echoes that were found in a signal.

    Parameters
    ----------
    solution : Solution
        Support, coefficients and residual.
    ranges_m, delay_stds_s : (k,) arrays
        Ranges of its blocks off the grid, and standard deviations of their delays.
    strengths : (k,) array
        Scores that its echoes have by themselves.
    overlaps : (k, k) array
        Correlation of each two of its direct echoes, 0 of one with itself.
    thresholds, residual_scores : (blocks,) arrays
        What a score had to exceed, and the scores of the residual.
    """

    solution: Solution
    ranges_m: FloatArray
    delay_stds_s: FloatArray
    strengths: FloatArray
    overlaps: FloatArray
    thresholds: FloatArray
    residual_scores: FloatArray


def search(
    operator: DelayOperator, baseband: Baseband, parameters: ReconstructionParameters
) -> Searched:
    """Search on the grid and move delays off it in turn, until they have settled.

    CoSaMP picks delays on a grid, Gauss-Newton steps move them off it, and CoSaMP goes on from
    there: what a misplaced strong echo leaves behind would otherwise be taken for weak ones.

    Parameters
    ----------
    operator : DelayDomainOperator or JointOperator
        The sensing matrix, with all blocks on the grid.
    baseband : Baseband
        Signal, templates and noise of a trace.
    parameters : ReconstructionParameters
        Sparsity, thresholds, rounds.
    """
    if IS_COMPILED and isinstance(operator, DelayDomainOperator):
        return compiled_search(operator, baseband, parameters)
    return operator_search(operator, baseband, parameters)


def compiled_search(
    operator: DelayDomainOperator, baseband: Baseband, parameters: ReconstructionParameters
) -> Searched:
    """Search for the echoes of one pulse, compiled; see `search`."""
    check_signal(operator, baseband.signal)
    found = sampled.search(
        operator.sampled,
        baseband.signal.astype(np.complex128, copy=False),
        noise_thresholds(operator, baseband, parameters.false_alarms_per_ping),
        sampled.Search(
            sparsity=parameters.sparsity,
            max_iterations=parameters.max_iterations,
            non_negative=_without_phase(baseband, parameters),
            model_error=_model_error(baseband, parameters),
            refinements=parameters.refinements if baseband.template.is_smooth else -1,
            settled=SETTLED_STEP,
            small=SMALL_STEP,
        ),
    )
    is_silent = len(found.support) == 0 and not baseband.signal.any()
    halt = Halt.SILENCE if is_silent else HALTS[found.halt]
    is_complex = np.iscomplexobj(baseband.signal)
    solution = Solution(
        found.support,
        found.coefficients,
        found.residual if is_complex else found.residual.real,
        found.iterations,
        halt,
    )
    if baseband.template.is_smooth:
        ranges_m = found.ranges_m
        stds_s = _with_left_over(operator, baseband, found.support, found.unit_stds_s)
    else:
        steps_s, stds_s = _between_samples(operator, baseband, solution)
        ranges_m = found.ranges_m + 0.5 * operator.channel.sound_speed_m_s * steps_s
    overlaps = baseband.template.overlaps(2.0 * ranges_m / operator.channel.sound_speed_m_s)
    return Searched(
        solution, ranges_m, stds_s, found.strengths, overlaps, found.thresholds, found.scores
    )


def operator_search(
    operator: DelayOperator, baseband: Baseband, parameters: ReconstructionParameters
) -> Searched:
    """Search for the echoes of any pulses, by their operator alone; see `search`."""
    loud = operator.loudness(operator.scores(operator.adjoint(baseband.signal)))
    noise = noise_thresholds(operator, baseband, parameters.false_alarms_per_ping)
    thresholds = noise + _model_error(baseband, parameters) * loud
    operator, solution, stds_s = _refined(operator, baseband, thresholds, parameters)
    return Searched(
        solution,
        operator.block_ranges_m(solution.support),
        stds_s,
        operator.echo_scores(solution.support, solution.coefficients),
        operator.overlaps(solution.support),
        thresholds,
        operator.scores(operator.adjoint(solution.residual)),
    )


def _refined(
    operator: DelayOperator,
    baseband: Baseband,
    thresholds: FloatArray,
    parameters: ReconstructionParameters,
) -> tuple[DelayOperator, Solution, FloatArray]:
    """Operator with the moved blocks, the solution, and standard deviations of its delays."""

    def find(support: IndexArray) -> Solution:
        return cosamp(
            operator,
            baseband.signal,
            parameters.sparsity,
            thresholds=thresholds,
            non_negative=_without_phase(baseband, parameters),
            warm_start=support,
            max_iterations=parameters.max_iterations,
        )

    solution = find(np.empty(0, dtype=np.intp))
    if not all(template.is_smooth for template in baseband.templates):
        step_s, stds_s = _between_samples(operator, baseband, solution)
        return operator.moved(solution.support, step_s), solution, stds_s
    step_s, unit_std_s = delay_step(operator, solution)
    for _ in range(parameters.refinements):
        largest = np.abs(step_s).max(initial=0.0) / operator.delay_step_s
        if largest < SETTLED_STEP:
            break
        operator = operator.moved(solution.support, step_s)
        before, solution = solution, find(solution.support)
        if largest < SMALL_STEP and np.array_equal(solution.support, before.support):
            step_s = np.zeros_like(step_s)
            break
        step_s, unit_std_s = delay_step(operator, solution)
    # The last step is worth taking, but not worth another fit.
    operator = operator.moved(solution.support, step_s)
    return operator, solution, _with_left_over(operator, baseband, solution.support, unit_std_s)


def _with_left_over(
    operator: DelayOperator, baseband: Baseband, support: IndexArray, unit_stds_s: FloatArray
) -> FloatArray:
    """Standard deviations of delays, with what refinement and sampling leave."""
    jitter_s = of_pulses(operator, support, [one.delay_jitter_s for one in baseband.templates])
    left_s = np.hypot(jitter_s, LEFT_OVER * operator.delay_step_s)
    return np.hypot(unit_stds_s * baseband.echo_noise_std, left_s)


def _between_samples(
    operator: DelayOperator, baseband: Baseband, solution: Solution
) -> tuple[FloatArray, FloatArray]:
    """Steps and standard deviations of the delays where echoes have edges."""
    support = solution.support
    delays_s = 2.0 * operator.block_ranges_m(support) / operator.channel.sound_speed_m_s
    steps_s = np.zeros(len(support))
    stds_s = np.full(len(support), operator.delay_step_s / np.sqrt(12.0))
    silent_std = baseband.noise_std
    if np.iscomplexobj(baseband.signal):
        silent_std /= np.sqrt(2.0)
    # On one side of an edge there is an echo, on the other there is none.
    noise_std = float(np.hypot(silent_std, baseband.echo_noise_std) / np.sqrt(2.0))
    for number, template in enumerate(baseband.templates):
        mine = pulse_numbers(operator, support, len(baseband.templates)) == number
        if not template.is_smooth:
            steps_s[mine], stds_s[mine] = between_samples(
                delays_s[mine],
                np.abs(solution.coefficients[mine, 0]),
                noise_std,
                template.duration_s,
                baseband.sampling,
            )
    return steps_s, stds_s


def pulse_numbers(operator: DelayOperator, support: IndexArray, count: int) -> IndexArray:
    """Which pulse the blocks of `support` are echoes of."""
    starts = np.array([operator.blocks(number).start for number in range(count)])
    numbers: IndexArray = np.searchsorted(starts, support, side="right") - 1
    return numbers


def of_pulses(operator: DelayOperator, support: IndexArray, values: Sequence[float]) -> FloatArray:
    """Of one value for each pulse, that of every echo's."""
    if len(values) == 1:
        return np.full(len(support), values[0])
    return np.asarray(values)[pulse_numbers(operator, support, len(values))]


def _without_phase(baseband: Baseband, parameters: ReconstructionParameters) -> bool:
    return parameters.non_negative and not np.iscomplexobj(baseband.signal)


def _model_error(baseband: Baseband, parameters: ReconstructionParameters) -> float:
    """Share of an echo that may be due to its pulse being known imperfectly."""
    return max(parameters.model_error, *(template.misfit for template in baseband.templates))
