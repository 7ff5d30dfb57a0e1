"""Echoes as resonant transducers make them."""

from dataclasses import replace

import numpy as np
import pytest

from usmap_ros.acoustics.profile import Profile, resonant_profile
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.errors import MalformedMessageError
from usmap_ros.pings.preparation.received_pulse import driven_resonators

TONE = Pulse(PulseShape.TONE_BURST, 40e3, 0.4e-3)
HANN = Pulse(PulseShape.HANN_BURST, 40e3, 0.4e-3)


def test_one_resonator_rises_and_rings_exponentially():
    decay_s = 20.0 / (np.pi * 40e3)
    profile = driven_resonators(TONE, ((40e3, 20.0),))
    time_s = np.array([0.1e-3, 0.2e-3, 0.4e-3])
    rise = 1.0 - np.exp(-time_s / decay_s)

    assert np.abs(profile(time_s)) == pytest.approx(rise / rise[-1], abs=0.02)
    assert abs(profile(np.array(0.4e-3 + decay_s))) == pytest.approx(np.exp(-1.0), abs=0.01)
    assert profile.peak_s == pytest.approx(0.4e-3, rel=0.02)
    assert np.abs(profile.values).max() == pytest.approx(1.0)


def test_resonance_off_the_carrier_turns_the_ring():
    profile = driven_resonators(TONE, ((41e3, 40.0),))
    ring = profile(np.array([0.5e-3, 0.6e-3]))

    assert np.angle(ring[1] / ring[0]) == pytest.approx(2.0 * np.pi * 1e3 * 0.1e-3, abs=0.01)


def test_widths_of_a_hann_burst_are_those_of_the_shape():
    time_s = np.arange(401) * 1e-6
    drawn = replace(HANN, profile=Profile.of(HANN.envelope(time_s) + 0j, 1e6))

    assert drawn.bandwidth_hz == pytest.approx(HANN.bandwidth_hz, rel=0.1)
    assert drawn.resolution_s == pytest.approx(HANN.resolution_s, rel=0.1)
    assert drawn.waveform(time_s) == pytest.approx(HANN.waveform(time_s), abs=1e-9)
    assert drawn.length_s == pytest.approx(HANN.length_s)


def test_messages_state_the_burst_and_not_what_comes_of_it():
    pulse = replace(TONE, profile=driven_resonators(TONE, ((40e3, 20.0),)))

    assert pulse.length_s > 2.0 * TONE.length_s
    assert pulse.driven == TONE


@pytest.mark.parametrize("values", [[0.0] * 8, [1.0, np.nan, 1.0, 0.0], [1.0]])
def test_profile_that_is_none_is_refused(values):
    with pytest.raises(MalformedMessageError, match=r"pulse\.template"):
        Profile(1e5, np.array(values, dtype=complex).tobytes()).validate()


def test_resonators_need_no_burst_of_a_certain_shape():
    profile = resonant_profile(HANN.envelope, HANN.duration_s, 40e3, [(40e3, 5.0), (40e3, 5.0)])

    assert 0.2e-3 < profile.peak_s < 0.5e-3
    profile.validate()
