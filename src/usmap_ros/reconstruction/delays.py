"""From an echo trace to echoes at delays off any grid: the method beside the paper's."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from usmap_ros.numerics.arrays import FloatArray, Signal
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.trace import EchoTrace, Encoding
from usmap_ros.reconstruction.baseband import Baseband, to_baseband
from usmap_ros.reconstruction.cones import RecoveredEchoes, make_cone
from usmap_ros.reconstruction.delay_domain import DelayDictionary
from usmap_ros.reconstruction.delay_search import FoundEchoes, search
from usmap_ros.reconstruction.detection import binned_maximum, crowding, unreported
from usmap_ros.reconstruction.envelope import std_factors, unbiased

#: Error of amplitudes, relative to them, that the rounding of samples may amount to.
ROUNDING = 1e-5
#: Quaternion of a frame that is not turned.
NO_TURN = np.array([0.0, 0.0, 0.0, 1.0])


@dataclass(frozen=True)
class DelayReconstruction:
    """A trace explained by echoes, with everything that led there."""

    #: The signal that was explained.
    baseband: Baseband
    #: The sensing matrix, with its atoms on the grid.
    dictionary: DelayDictionary
    #: (samples,) array: what its echoes leave of the signal.
    residual: Signal
    #: What fusion is told.
    cone: EchoCone
    #: Of each pulse in the air, in the order of `EchoTrace.sent`; ranges are half the lengths of
    #: the paths from its transducer to the one that listened.
    echoes: tuple[RecoveredEchoes, ...]


def reconstruct_delays(
    trace: EchoTrace, parameters: ReconstructionParameters
) -> DelayReconstruction:
    """Recover the echoes in `trace`.

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
    dictionary = _dictionary(
        baseband.templates,
        baseband.sampling,
        trace.channel,
        trace.transducer.min_range_m,
        trace.transducer.max_range_m,
        parameters.oversampling,
        tuple(parameters.exclusion * one.pulse.resolution_s for one in baseband.templates),
    )
    found = search(dictionary, baseband, parameters)
    echoes = _echoes(trace, baseband, dictionary, found, parameters)
    numbers = dictionary.pulse_numbers(found.support)
    by_pulse = tuple(echoes.where(numbers == number) for number in range(len(trace.sent)))
    norm, left = (float(np.linalg.norm(one)) for one in (baseband.signal, found.residual))
    cone = make_cone(
        _from_the_middle(trace),
        by_pulse[0],
        _limits(trace, baseband, dictionary, found, parameters),
        parameters.limit_step_m,
        residual=left / norm if norm > 0.0 else 0.0,
    )
    return DelayReconstruction(baseband, dictionary, found.residual, cone, by_pulse)


def _from_the_middle(trace: EchoTrace) -> EchoTrace:
    """The trace, heard half way to the transducer that sent if its own only listened.

    As far as objects are farther than the two are apart, sound that goes there and back between
    them has been as far as if both were in the middle.
    """
    first = trace.sent[0]
    if trace.is_own(first):
        return trace
    middle = trace.pose.compose(Pose(0.5 * first.mount.position_m, NO_TURN))
    return replace(trace, pose=replace(trace.pose, position_m=middle.position_m))


#: One dictionary for all pings that were sent and sampled alike.
_dictionary = lru_cache(maxsize=64)(DelayDictionary)


def _echoes(
    trace: EchoTrace,
    baseband: Baseband,
    dictionary: DelayDictionary,
    found: FoundEchoes,
    parameters: ReconstructionParameters,
) -> RecoveredEchoes:
    """Range and amplitude of every block of the support, in its order."""
    support = found.support
    unit_norms = dictionary.unit_norms[support]
    amplitudes = found.strengths / unit_norms
    of_delay = of_amplitude = np.ones(len(support))
    if trace.encoding is Encoding.ENVELOPE:
        known = baseband.template, baseband.echo_noise_std
        if baseband.template.is_smooth:
            of_delay, of_amplitude = std_factors(amplitudes, *known)
        amplitudes = unbiased(amplitudes, *known)
    jitter = dictionary.of_pulses(support, [one.amplitude_jitter for one in baseband.templates])
    return RecoveredEchoes(
        ranges_m=found.ranges_m,
        range_stds_m=0.5 * trace.channel.sound_speed_m_s * of_delay * found.delay_stds_s,
        amplitudes=amplitudes,
        amplitude_stds=np.sqrt(
            (of_amplitude * baseband.echo_noise_std / unit_norms) ** 2
            + (parameters.interference * crowding(found.overlaps, amplitudes)) ** 2
            + (np.hypot(jitter, ROUNDING) * amplitudes) ** 2
        ),
    )


def _limits(
    trace: EchoTrace,
    baseband: Baseband,
    dictionary: DelayDictionary,
    found: FoundEchoes,
    parameters: ReconstructionParameters,
) -> FloatArray:
    """Amplitude below which an echo of the first pulse could have gone unreported, by range."""
    limits = unreported(
        dictionary,
        found.thresholds,
        found.residual_scores,
        found.support,
        found.strengths,
        parameters.masking,
    )
    ranges_m = dictionary.ranges_m
    minimum_m, maximum_m = trace.transducer.min_range_m, trace.transducer.max_range_m
    greatest = binned_maximum(
        limits[: len(ranges_m)], ranges_m, minimum_m, parameters.limit_step_m, maximum_m
    )
    if trace.encoding is Encoding.ENVELOPE:
        return unbiased(greatest, baseband.template, baseband.echo_noise_std)
    return greatest
