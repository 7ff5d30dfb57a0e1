"""From an echo trace to echoes at delays off any grid: the method beside the paper's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from usmap_ros.acoustics.propagation import Channel
from usmap_ros.acoustics.sampling import Sampling
from usmap_ros.arrays import FloatArray, IndexArray
from usmap_ros.cone import EchoCone
from usmap_ros.geometry import Pose
from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.reconstruction.baseband import Baseband, to_baseband
from usmap_ros.reconstruction.cones import Echoes, make_cone
from usmap_ros.reconstruction.cosamp import Solution, cosamp
from usmap_ros.reconstruction.delay_domain import DelayDomainOperator
from usmap_ros.reconstruction.detection import (
    binned_maximum,
    crowding,
    noise_thresholds,
    unreported,
)
from usmap_ros.reconstruction.envelope import unbiased
from usmap_ros.reconstruction.joint import DelayOperator, JointOperator
from usmap_ros.reconstruction.refinement import between_samples, delay_step
from usmap_ros.reconstruction.template import Template
from usmap_ros.trace import EchoTrace, Encoding

#: A round of refinement whose largest step is below this share of a grid step is the last.
SETTLED_STEP = 0.05
#: A step below this share needs no other after it, unless it let new echoes be found: Gauss-Newton
#: steps converge quadratically, and what is left is a hundredth of a grid step.
SMALL_STEP = 0.6
#: What such a step leaves, as a share of a grid step.
LEFT_OVER = 0.005
#: Error of amplitudes, relative to them, that the rounding of samples may amount to.
ROUNDING = 1e-5
#: Quaternion of a frame that is not turned.
NO_TURN = np.array([0.0, 0.0, 0.0, 1.0])


@dataclass(frozen=True)
class DelayReconstruction:
    """A trace explained by echoes, with everything that led there.

    Parameters
    ----------
    baseband : Baseband
        The signal that was explained.
    operator : DelayDomainOperator
        The sensing matrix, with the atoms of the support moved off the grid.
    solution : Solution
        Support, complex coefficients and residual.
    cone : EchoCone
        What fusion is told.
    echoes : tuple of Echoes
        Of each pulse in the air, in the order of `EchoTrace.sent`; ranges are half the lengths of
        the paths from its transducer to the one that listened.
    """

    baseband: Baseband
    operator: DelayOperator
    solution: Solution
    cone: EchoCone
    echoes: tuple[Echoes, ...]


def reconstruct_delays(
    trace: EchoTrace, parameters: ReconstructionParameters
) -> DelayReconstruction:
    """Recover the echoes in `trace`.

    CoSaMP picks delays on a grid, Gauss-Newton steps move them off it, and CoSaMP goes on from
    there: what a misplaced strong echo leaves behind would otherwise be taken for weak ones.

    Parameters
    ----------
    trace : EchoTrace
        A valid trace.
    parameters : ReconstructionParameters
        Sparsity, thresholds and grid.

    Raises
    ------
    MalformedMessageError
        If the trace cannot be brought to the baseband.
    """
    baseband = to_baseband(trace)
    operator = _operator(trace, baseband, parameters)
    signal = baseband.signal
    noise = noise_thresholds(operator, baseband, parameters.false_alarms_per_ping)
    heard = operator.scores(operator.adjoint(signal))
    misfit = max(template.misfit for template in baseband.templates)
    thresholds = noise + max(parameters.model_error, misfit) * operator.loudness(heard)
    operator, solution, delay_std_s = _search(
        operator, baseband, thresholds, trace.channel.sound_speed_m_s, parameters
    )
    echoes = _echoes(trace, baseband, operator, solution, delay_std_s, parameters)
    numbers = _pulse_numbers(operator, solution.support, len(trace.sent))
    by_pulse = tuple(echoes.where(numbers == number) for number in range(len(trace.sent)))
    limits = _limits(trace, baseband, operator, solution, thresholds, parameters)
    norm = float(np.linalg.norm(signal))
    cone = make_cone(
        replace(trace, pose=_heard_from(trace)),
        by_pulse[0],
        limits,
        parameters.limit_step_m,
        residual=solution.residual_norm / norm if norm > 0.0 else 0.0,
    )
    return DelayReconstruction(baseband, operator, solution, cone, by_pulse)


def _heard_from(trace: EchoTrace) -> Pose:
    """Pose of the cone: the transducer's, or half way to the one that sent if it only listened.

    As far as objects are farther than the two are apart, sound that goes there and back between
    them has been as far as if both were in the middle.
    """
    first = trace.sent[0]
    if trace.is_own(first):
        return trace.pose
    middle = trace.pose.compose(Pose(0.5 * first.mount.position_m, NO_TURN))
    return replace(trace.pose, position_m=middle.position_m)


def _search(
    operator: DelayOperator,
    baseband: Baseband,
    thresholds: FloatArray,
    sound_speed_m_s: float,
    parameters: ReconstructionParameters,
) -> tuple[DelayOperator, Solution, FloatArray]:
    """Search on the grid and move delays off it in turn, until they have settled.

    Returns the operator with the moved atoms, the solution, and the standard deviations of its
    delays.
    """

    def find(support: IndexArray) -> Solution:
        return cosamp(
            operator,
            baseband.signal,
            parameters.sparsity,
            thresholds=thresholds,
            non_negative=parameters.non_negative and not np.iscomplexobj(baseband.signal),
            warm_start=support,
            max_iterations=parameters.max_iterations,
        )

    solution = find(np.empty(0, dtype=np.intp))
    if not all(template.is_smooth for template in baseband.templates):
        step_s, delay_std_s = _between_samples(operator, baseband, solution, sound_speed_m_s)
        return operator.moved(solution.support, step_s), solution, delay_std_s
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
    left_s = np.hypot(
        _of_pulses(operator, solution, [one.delay_jitter_s for one in baseband.templates]),
        LEFT_OVER * operator.delay_step_s,
    )
    return operator, solution, np.hypot(unit_std_s * baseband.echo_noise_std, left_s)


def _between_samples(
    operator: DelayOperator, baseband: Baseband, solution: Solution, sound_speed_m_s: float
) -> tuple[FloatArray, FloatArray]:
    """Steps and standard deviations of the delays where echoes have edges."""
    support = solution.support
    delays_s = 2.0 * operator.block_ranges_m(support) / sound_speed_m_s
    steps_s = np.zeros(len(support))
    stds_s = np.full(len(support), operator.delay_step_s / np.sqrt(12.0))
    silent_std = baseband.noise_std
    if np.iscomplexobj(baseband.signal):
        silent_std /= np.sqrt(2.0)
    # On one side of an edge there is an echo, on the other there is none.
    noise_std = float(np.hypot(silent_std, baseband.echo_noise_std) / np.sqrt(2.0))
    for number, template in enumerate(baseband.templates):
        mine = _pulse_numbers(operator, support, len(baseband.templates)) == number
        if not template.is_smooth:
            steps_s[mine], stds_s[mine] = between_samples(
                delays_s[mine],
                np.abs(solution.coefficients[mine, 0]),
                noise_std,
                template.duration_s,
                baseband.sampling,
            )
    return steps_s, stds_s


def _pulse_numbers(operator: DelayOperator, support: IndexArray, count: int) -> IndexArray:
    """Which pulse the blocks of `support` are echoes of."""
    starts = np.array([operator.blocks(number).start for number in range(count)])
    numbers: IndexArray = np.searchsorted(starts, support, side="right") - 1
    return numbers


def _of_pulses(operator: DelayOperator, solution: Solution, values: Sequence[float]) -> FloatArray:
    """Of one value for each pulse, that of every echo's."""
    return np.asarray(values)[_pulse_numbers(operator, solution.support, len(values))]


def _operator(
    trace: EchoTrace, baseband: Baseband, parameters: ReconstructionParameters
) -> DelayOperator:
    parts = [
        _cached_operator(
            template,
            baseband.sampling,
            trace.channel,
            trace.transducer.min_range_m,
            trace.transducer.max_range_m,
            parameters.oversampling,
            parameters.exclusion * template.pulse.resolution_s,
        )
        for template in baseband.templates
    ]
    return parts[0] if len(parts) == 1 else JointOperator(parts)


@lru_cache(maxsize=64)
def _cached_operator(
    template: Template,
    sampling: Sampling,
    channel: Channel,
    min_range_m: float,
    max_range_m: float,
    oversampling: int,
    exclusion_s: float,
) -> DelayDomainOperator:
    """One operator for all pings that were sent and sampled alike."""
    return DelayDomainOperator(
        template, sampling, channel, min_range_m, max_range_m, oversampling, exclusion_s
    )


def _echoes(
    trace: EchoTrace,
    baseband: Baseband,
    operator: DelayOperator,
    solution: Solution,
    delay_std_s: FloatArray,
    parameters: ReconstructionParameters,
) -> Echoes:
    """Range and amplitude of every block of the support, in its order."""
    support = solution.support
    unit_norms = operator.unit_norms[support]
    amplitudes = operator.echo_scores(support, solution.coefficients) / unit_norms
    if trace.encoding is Encoding.ENVELOPE:
        amplitudes = unbiased(amplitudes, baseband.template, baseband.echo_noise_std)
    jitter = _of_pulses(operator, solution, [one.amplitude_jitter for one in baseband.templates])
    return Echoes(
        ranges_m=operator.block_ranges_m(support),
        range_stds_m=0.5 * trace.channel.sound_speed_m_s * delay_std_s,
        amplitudes=amplitudes,
        amplitude_stds=np.sqrt(
            (baseband.echo_noise_std / unit_norms) ** 2
            + (parameters.interference * crowding(operator, support, amplitudes)) ** 2
            + (np.hypot(jitter, ROUNDING) * amplitudes) ** 2
        ),
    )


def _limits(
    trace: EchoTrace,
    baseband: Baseband,
    operator: DelayOperator,
    solution: Solution,
    thresholds: FloatArray,
    parameters: ReconstructionParameters,
) -> FloatArray:
    """Amplitude below which an echo of the first pulse could have gone unreported, by range."""
    limits = unreported(
        operator,
        thresholds,
        operator.scores(operator.adjoint(solution.residual)),
        solution.support,
        operator.echo_scores(solution.support, solution.coefficients),
        parameters.masking,
    )
    if trace.encoding is Encoding.ENVELOPE:
        limits = unbiased(limits, baseband.template, baseband.echo_noise_std)
    own = operator.blocks(0)
    minimum_m, maximum_m = trace.transducer.min_range_m, trace.transducer.max_range_m
    return binned_maximum(
        limits[own], operator.ranges_m[own], minimum_m, parameters.limit_step_m, maximum_m
    )
