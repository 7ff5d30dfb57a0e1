"""From an echo trace to echoes at delays off any grid: the method beside the paper's."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from usmap_ros.acoustics.propagation import Channel
from usmap_ros.acoustics.sampling import Sampling
from usmap_ros.arrays import FloatArray, IndexArray
from usmap_ros.cone import EchoCone
from usmap_ros.geometry import Pose
from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.reconstruction.baseband import Baseband, Template, to_baseband
from usmap_ros.reconstruction.cones import Echoes, make_cone
from usmap_ros.reconstruction.cosamp import Solution, cosamp
from usmap_ros.reconstruction.delay_domain import DelayDomainOperator
from usmap_ros.reconstruction.detection import (
    binned_maximum,
    crowding,
    noise_thresholds,
    unreported,
)
from usmap_ros.reconstruction.joint import DelayOperator, JointOperator
from usmap_ros.reconstruction.refinement import delay_step
from usmap_ros.trace import EchoTrace

#: A round of refinement whose largest step is below this share of a grid step is the last.
SETTLED_STEP = 0.05
#: A step below this share needs no other after it, unless it let new echoes be found: Gauss-Newton
#: steps converge quadratically, and what is left is a hundredth of a grid step.
SMALL_STEP = 0.6
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
    thresholds = noise + parameters.model_error * operator.loudness(heard)
    operator, solution, delay_std_s = _search(operator, baseband, thresholds, parameters)
    echoes = _echoes(trace, baseband, operator, solution, delay_std_s, parameters)
    by_pulse = tuple(
        echoes.where((solution.support >= blocks.start) & (solution.support < blocks.stop))
        for blocks in map(operator.blocks, range(len(trace.sent)))
    )
    limits = _limits(trace, operator, solution, thresholds, parameters)
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
    return Echoes(
        ranges_m=operator.block_ranges_m(support),
        range_stds_m=0.5 * trace.channel.sound_speed_m_s * delay_std_s,
        amplitudes=amplitudes,
        amplitude_stds=np.hypot(
            baseband.noise_std / unit_norms,
            parameters.interference * crowding(operator, support, amplitudes),
        ),
    )


def _limits(
    trace: EchoTrace,
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
    own = operator.blocks(0)
    minimum_m, maximum_m = trace.transducer.min_range_m, trace.transducer.max_range_m
    return binned_maximum(
        limits[own], operator.ranges_m[own], minimum_m, parameters.limit_step_m, maximum_m
    )
