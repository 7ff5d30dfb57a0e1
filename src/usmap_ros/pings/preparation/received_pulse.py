"""Traces told what their transducers make of the burst that drives them."""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from usmap_ros.acoustics.profile import Profile, resonant_profile
from usmap_ros.acoustics.pulse import Pulse
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.errors import MalformedMessageError
from usmap_ros.parameters import PulseParameters
from usmap_ros.pings.trace import EchoTrace


def with_profile(trace: EchoTrace, parameters: PulseParameters) -> EchoTrace:
    """Give the pulses of `trace` the envelope with which their echoes are received.

    Parameters
    ----------
    trace : EchoTrace
        As recorded; it stays as it is.
    parameters : PulseParameters
        What transducers do.

    Raises
    ------
    MalformedMessageError
        If its pulses have no carrier, or several are in the air and only one was measured.
    """
    if parameters.kind == "stated":
        return trace
    if not trace.transducer.pulse.has_carrier:
        raise MalformedMessageError(
            "transducer.pulse_shape", "has no carrier, which reconstruction.pulse needs"
        )
    if len(trace.sent) > 1 and parameters.kind == "measured":
        raise MalformedMessageError(
            "transducer.pulse_shape",
            "is one of several in the air, of which reconstruction.pulse holds only one",
        )

    def received(transducer: Transducer) -> Transducer:
        profile = _profile(transducer.pulse, parameters)
        return replace(transducer, pulse=replace(transducer.pulse, profile=profile))

    array = trace.array
    if array is not None:
        elements = (replace(one, transducer=received(one.transducer)) for one in array.elements)
        array = replace(array, elements=tuple(elements))
    return replace(trace, transducer=received(trace.transducer), array=array)


def _profile(pulse: Pulse, parameters: PulseParameters) -> Profile:
    if parameters.kind == "measured":
        return _measured(
            parameters.template_rate_hz, tuple(parameters.template_i), tuple(parameters.template_q)
        )
    resonances = zip(parameters.resonances_hz, parameters.qualities, strict=True)
    return driven_resonators(pulse.driven, tuple(resonances))


@lru_cache(maxsize=16)
def driven_resonators(pulse: Pulse, resonances: tuple[tuple[float, float], ...]) -> Profile:
    """What resonators, of which frequency (Hz) and quality are given, make of a pulse."""
    return resonant_profile(pulse.envelope, pulse.duration_s, pulse.carrier_hz, resonances)


@lru_cache(maxsize=16)
def _measured(
    rate_hz: float, in_phase: tuple[float, ...], quadrature: tuple[float, ...]
) -> Profile:
    return Profile.of(np.asarray(in_phase) + 1j * np.asarray(quadrature), rate_hz)
