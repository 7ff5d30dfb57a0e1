"""Whether the pulses of a trace are known, and its samples can hold them."""

from usmap_ros.errors import MalformedMessageError
from usmap_ros.pings.trace import EchoTrace, Encoding


def check_pulses(trace: EchoTrace) -> None:
    """Raise `MalformedMessageError` unless every pulse in the air can be looked for."""
    pulses = [emission.transducer.pulse for emission in trace.sent]
    if len(pulses) > 1 and len(set(pulses)) < len(pulses):
        raise MalformedMessageError(
            "transducer.pulse_shape",
            "and the pulse's other numbers are those of two transducers that ping at once: nothing"
            " tells their echoes apart",
        )
    if len({pulse.has_carrier for pulse in pulses}) > 1:
        raise MalformedMessageError(
            "transducer.carrier_frequency", "is 0 for some of the pulses in the air, but not all"
        )
    if trace.encoding is Encoding.ENVELOPE:
        return
    if any(pulse.lacks_sweep for pulse in pulses):
        raise MalformedMessageError(
            "transducer.pulse_shape",
            "is a chirp of which no TransducerArray message says how far it sweeps;"
            " reconstruction.chirp_sweep_hz can",
        )
    if trace.encoding is Encoding.IQ:
        _check_band(trace)
    elif pulses[0].has_carrier:
        highest_hz = max(pulse.carrier_hz + 0.5 * abs(pulse.sweep_hz) for pulse in pulses)
        if trace.sample_rate_hz <= 2.0 * highest_hz:
            raise MalformedMessageError(
                "sample_rate",
                f"of {trace.sample_rate_hz:g} Hz is too low for a raw carrier of {highest_hz:g} Hz",
            )


def _check_band(trace: EchoTrace) -> None:
    """Raise `MalformedMessageError` unless I/Q about the own carrier holds every pulse's band."""
    carrier_hz = trace.transducer.pulse.carrier_hz
    for emission in trace.sent:
        pulse = emission.transducer.pulse
        width_hz = 2.0 * abs(pulse.carrier_hz - carrier_hz) + abs(pulse.sweep_hz)
        if trace.sample_rate_hz < width_hz:
            raise MalformedMessageError(
                "sample_rate",
                f"of {trace.sample_rate_hz:g} Hz is too low for a pulse at {pulse.carrier_hz:g} Hz"
                f" that sweeps {pulse.sweep_hz:g} Hz",
            )
