"""Units of samples, from what a ping holds."""

from dataclasses import replace

import numpy as np
import pytest

from usmap_ros.calibration.receiver_survey import ReceiverSurvey
from usmap_ros.parameters import CorrectionParameters, ReconstructionParameters
from usmap_ros.pings.preparation.units import unit_of
from usmap_ros.pings.trace import EchoTrace, Encoding
from usmap_ros.simulation import hear
from usmap_ros.simulation.receiver import Receiver

RATES = {Encoding.RAW: 250e3, Encoding.IQ: 25e3, Encoding.ENVELOPE: 25e3}


def times(factor: float, trace: EchoTrace) -> EchoTrace:
    return replace(trace, samples=trace.samples * np.float32(factor), noise_std=0.0)


@pytest.fixture(params=Encoding)
def trace(request: pytest.FixtureRequest) -> EchoTrace:
    receiver = Receiver(request.param, RATES[request.param], 0.0, 0.01)
    return hear(((1.5, 0.0),), receiver=receiver, seed=0)


@pytest.mark.parametrize("factor", [0.05, 1.0, 20.0])
def test_what_objects_differ_by_is_no_other_unit(trace: EchoTrace, factor: float) -> None:
    assert unit_of(times(factor, trace)) == 1.0


@pytest.mark.parametrize("factor", [1e-6, 1e-3, 2048.0, 1e6])
def test_other_units_are_told_to_a_power_of_ten(trace: EchoTrace, factor: float) -> None:
    unit = unit_of(times(factor, trace))
    assert abs(np.log10(unit / factor)) <= 1.0
    assert np.log10(unit) == pytest.approx(round(np.log10(unit)))


def test_what_samples_rest_at_is_no_echo(trace: EchoTrace) -> None:
    assert unit_of(replace(trace, samples=trace.samples + np.float32(2048.0))) == 1.0


def test_nothing_tells_nothing(trace: EchoTrace) -> None:
    assert unit_of(times(0.0, trace)) == 0.0


def test_a_gain_that_is_stated_is_obeyed(trace: EchoTrace) -> None:
    counts = times(2048.0, trace)
    for gain, is_other in ((1.0, True), (2048.0, False), (3.0, False)):
        stated = ReconstructionParameters(correction=CorrectionParameters(gain=gain))
        survey = ReceiverSurvey(stated)
        survey.add("topic", counts)
        assert survey.is_in_other_units("topic") is is_other
        known = survey.known("topic")
        assert (known is None) is not is_other
        if known is not None:
            assert known.correction.gain == 1000.0


def test_the_first_ping_that_holds_anything_tells(trace: EchoTrace) -> None:
    survey = ReceiverSurvey(ReconstructionParameters())
    for factor in (0.0, 2048.0, 1.0):
        survey.add("topic", times(factor, trace))
    assert survey.is_in_other_units("topic")
    assert "60 dB larger" in survey.problem("topic")
