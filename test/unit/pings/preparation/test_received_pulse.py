"""Echoes of transducers that do not follow their burst, reconstructed with what they make of it."""

from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.profile import Profile
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.errors import MalformedMessageError
from usmap_ros.parameters import PulseParameters, ReconstructionParameters
from usmap_ros.pings.preparation.received_pulse import driven_resonators, with_profile
from usmap_ros.pings.trace import Encoding
from usmap_ros.reconstruction.reconstructor import reconstruct
from usmap_ros.simulation import hear
from usmap_ros.simulation.receiver import Receiver

TONE = Pulse(PulseShape.TONE_BURST, 40e3, 0.4e-3)
RESONANCES = ((40e3, 20.0), (40.5e3, 25.0))
RESONANT = PulseParameters(kind="resonant", resonances_hz=[40e3, 40.5e3], qualities=[20.0, 25.0])
RECEIVERS = {
    "raw": (Encoding.RAW, 200e3),
    "iq": (Encoding.IQ, 25e3),
    "env": (Encoding.ENVELOPE, 25e3),
}


def measured():
    """Parameters with the profile drawn as samples, in units of their own."""
    profile = driven_resonators(TONE, RESONANCES)
    time_s = np.arange(0.0, profile.duration_s, 5e-6)
    drawn = 37.0 * profile(time_s)
    return PulseParameters(
        kind="measured",
        template_rate_hz=200e3,
        template_i=drawn.real.tolist(),
        template_q=drawn.imag.tolist(),
    )


def trace_of(range_m, reception="iq", seed=0):
    encoding, rate_hz = RECEIVERS[reception]
    pulse = replace(TONE, profile=driven_resonators(TONE, RESONANCES))
    transducer = Transducer(pulse, BeamPattern.linear(), 0.2, 3.0)
    receiver = Receiver(encoding, rate_hz, 0.0, 0.003)
    return hear([(range_m, 0.0)], transducer=transducer, receiver=receiver, seed=seed)


@pytest.mark.parametrize("reception", RECEIVERS)
@pytest.mark.parametrize("pulse", [RESONANT, measured()], ids=["resonant", "measured"])
def test_one_object_gives_one_echo(reception, pulse):
    parameters = ReconstructionParameters(pulse=pulse)
    for number in range(5):
        range_m = 1.0 + 0.113 * number
        cone = reconstruct(trace_of(range_m, reception, number), parameters).cone
        assert len(cone.ranges_m) == 1
        assert cone.ranges_m[0] == pytest.approx(range_m, abs=0.001)
        assert cone.amplitudes[0] == pytest.approx(range_m**-2, rel=0.02)
        assert cone.residual < 0.1


def test_without_it_one_object_gives_many():
    assert len(reconstruct(trace_of(1.0), ReconstructionParameters()).cone.ranges_m) > 3


def test_cones_and_traces_carry_the_burst_alone():
    trace = trace_of(1.0)
    cone = reconstruct(trace, ReconstructionParameters(pulse=RESONANT)).cone

    assert trace.transducer.pulse == TONE
    assert cone.transducer.pulse == TONE


def test_cells_are_explained_with_it_too():
    parameters = ReconstructionParameters(dictionary="cells", pulse=RESONANT, cell_size_m=0.1)
    cone = reconstruct(trace_of(1.05), parameters).cone

    assert cone.ranges_m[np.argmax(cone.amplitudes)] == pytest.approx(1.05, abs=0.06)


def test_pulse_without_carrier_cannot_have_it():
    square = replace(TONE, shape=PulseShape.SQUARE, carrier_hz=0.0)
    trace = replace(trace_of(1.0), transducer=Transducer(square, BeamPattern.linear(), 0.2, 3.0))
    with pytest.raises(MalformedMessageError, match="has no carrier"):
        with_profile(trace, RESONANT)


@pytest.mark.parametrize(
    ("content", "field"),
    [
        ({"kind": "resonant"}, "resonances_hz"),
        ({"kind": "resonant", "resonances_hz": [4e4, 4e4], "qualities": [9.0]}, "qualities"),
        ({"kind": "measured", "template_rate_hz": 1e5}, "template_i"),
        (
            {"kind": "measured", "template_i": [1.0] * 5, "template_q": [0.0] * 5},
            "template_rate_hz",
        ),
        (
            {"kind": "measured", "template_i": [0.0] * 5, "template_q": [0.0] * 5},
            "nothing but zeros",
        ),
    ],
)
def test_incomplete_parameters_are_refused(content, field):
    with pytest.raises(ValidationError, match=field):
        PulseParameters(**content)


def test_profiles_of_one_content_are_one():
    first, again = measured(), measured()
    traces = [with_profile(trace_of(1.0), one) for one in (first, again)]

    assert traces[0].transducer.pulse == traces[1].transducer.pulse
    assert isinstance(traces[0].transducer.pulse.profile, Profile)
