"""From an echo trace to echoes at delays off any grid: the method beside the paper's."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from usmap_ros.acoustics.propagation import Channel
from usmap_ros.arrays import FloatArray, IndexArray
from usmap_ros.cone import EchoCone
from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.reconstruction.baseband import Baseband, Template, to_baseband
from usmap_ros.reconstruction.cones import Echoes, make_cone
from usmap_ros.reconstruction.cosamp import Solution, cosamp
from usmap_ros.reconstruction.delay_domain import DelayDomainOperator, Sampling
from usmap_ros.reconstruction.detection import (
    binned_maximum,
    crowding,
    loudness,
    noise_thresholds,
    unreported,
)
from usmap_ros.reconstruction.refinement import delay_step
from usmap_ros.trace import EchoTrace

#: A round of refinement whose largest step is below this share of a grid step is the last.
SETTLED_STEP = 0.05
#: A step below this share needs no other after it, unless it let new echoes be found: Gauss-Newton
#: steps converge quadratically, and what is left is a hundredth of a grid step.
SMALL_STEP = 0.6


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
    """

    baseband: Baseband
    operator: DelayDomainOperator
    solution: Solution
    cone: EchoCone


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
    thresholds = noise + parameters.model_error * loudness(operator, heard)
    operator, solution, delay_std_s = _search(operator, baseband, thresholds, parameters)
    cone = _cone(trace, baseband, operator, solution, thresholds, delay_std_s, parameters)
    return DelayReconstruction(baseband, operator, solution, cone)


def _search(
    operator: DelayDomainOperator,
    baseband: Baseband,
    thresholds: FloatArray,
    parameters: ReconstructionParameters,
) -> tuple[DelayDomainOperator, Solution, FloatArray]:
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
    if not baseband.template.is_smooth:
        # Anywhere between two samples the echo would look the same.
        grid_std_s = operator.delay_step_s / np.sqrt(12.0)
        return operator, solution, np.full(len(solution.support), grid_std_s)
    step_s, unit_std_s = delay_step(operator, solution)
    for _ in range(parameters.refinements):
        largest = np.abs(step_s).max(initial=0.0) / operator.delay_step_s
        if largest < SETTLED_STEP:
            break
        operator = operator.moved(solution.support, step_s)
        before, solution = solution, find(solution.support)
        if largest < SMALL_STEP and np.array_equal(solution.support, before.support):
            break
        step_s, unit_std_s = delay_step(operator, solution)
    return operator, solution, unit_std_s * baseband.noise_std


def _operator(
    trace: EchoTrace, baseband: Baseband, parameters: ReconstructionParameters
) -> DelayDomainOperator:
    sampling = Sampling(baseband.sample_rate_hz, baseband.start_delay_s, len(baseband.signal))
    return _cached_operator(
        baseband.template,
        sampling,
        trace.channel,
        trace.transducer.min_range_m,
        trace.transducer.max_range_m,
        parameters.oversampling,
        parameters.exclusion * baseband.template.pulse.resolution_s,
    )


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


def _cone(
    trace: EchoTrace,
    baseband: Baseband,
    operator: DelayDomainOperator,
    solution: Solution,
    thresholds: FloatArray,
    delay_std_s: FloatArray,
    parameters: ReconstructionParameters,
) -> EchoCone:
    support = solution.support
    unit_norms = operator.unit_norms[support]
    echo_scores = operator.echo_scores(support, solution.coefficients)
    limits = unreported(
        operator,
        thresholds,
        operator.scores(operator.adjoint(solution.residual)),
        support,
        echo_scores,
        parameters.masking,
    )
    minimum_m, maximum_m = trace.transducer.min_range_m, trace.transducer.max_range_m
    binned = binned_maximum(
        limits, operator.ranges_m, minimum_m, parameters.limit_step_m, maximum_m
    )
    ranges_m = operator.block_ranges_m(support)
    amplitudes = echo_scores / unit_norms
    amplitude_stds = np.hypot(
        baseband.noise_std / unit_norms,
        parameters.interference * crowding(operator, support, amplitudes),
    )
    signal_norm = float(np.linalg.norm(baseband.signal))
    return make_cone(
        trace,
        Echoes(
            ranges_m=ranges_m,
            range_stds_m=0.5 * trace.channel.sound_speed_m_s * delay_std_s,
            amplitudes=amplitudes,
            amplitude_stds=amplitude_stds,
        ),
        binned,
        parameters.limit_step_m,
        residual=solution.residual_norm / signal_norm if signal_norm > 0.0 else 0.0,
    )
