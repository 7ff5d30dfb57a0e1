"""The pulse as it is received, and how far it can be relied on."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.calibration import calibrate
from usmap_ros.calibration.aligned_echoes import FINER, align
from usmap_ros.calibration.pulse import measure_pulse
from usmap_ros.calibration.receiver_survey import ReceiverSurvey
from usmap_ros.numerics.arrays import Signal
from usmap_ros.parameters import PulseParameters, ReconstructionParameters
from usmap_ros.pings.preparation.received_pulse import driven_resonators
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.simulation import Scenario, simulate
from usmap_ros.simulation.points import RECEIVER, TRANSDUCER, hear

SCENARIOS = Path(__file__).parents[3] / "config/scenarios"
AS_REAL = SCENARIOS / "as_real.yaml"
#: Level at which samples of that scenario rest, and samples from an echo to another beside it.
RESTING, LATER = 2048.0, 80


def test_what_stands_beside_most_echoes_is_model_error() -> None:
    scenario = Scenario.load(AS_REAL).model_copy(update={"duration_s": 6.0})
    traces = [trace for topic, trace in simulate(scenario) if topic == "/robot1/echo"]
    rng = np.random.default_rng(4)

    def beside(trace, loudness):
        """Add a copy of all that is heard, now of this sign, now of the other."""
        heard = trace.samples.astype(float) - RESTING
        copy = np.concatenate([np.zeros(LATER), heard[:-LATER]])
        samples = trace.samples + loudness * rng.choice([-1.0, 1.0]) * copy
        return replace(trace, samples=samples.astype(np.float32))

    parameters = ReconstructionParameters()
    clean = measure_pulse(traces, parameters)
    crowded = measure_pulse([beside(trace, 0.12) for trace in traces], parameters)

    assert clean.is_known
    assert crowded.is_known
    assert clean.model_error < 0.07
    # As loud as the copy, or twice that where the mean pulse has taken up one of its signs.
    assert 0.08 < crowded.model_error < 0.3


def test_where_the_stated_pulse_explains_echoes_no_other_is_looked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """That takes five times as long, before anything is mapped."""
    scenario = Scenario.load(SCENARIOS / "poles.yaml").model_copy(update={"duration_s": 4.0})
    traces = [trace for topic, trace in simulate(scenario) if topic == "/robot1/echo"]
    monkeypatch.delattr("usmap_ros.calibration.pulse.align")
    measured = measure_pulse(traces, ReconstructionParameters())
    assert not measured.is_known
    assert measured.residual == measured.stated_residual < 0.1


@pytest.mark.parametrize("rounded_s", [0.0, 1.2e-4])
def test_a_burst_whose_edges_are_rounded_is_learnt_though_little_is_left_of_it(
    rounded_s: float,
) -> None:
    stated = replace(TRANSDUCER, pulse=Pulse(PulseShape.TONE_BURST, 10_000.0, 1.2e-3))
    receiver = replace(RECEIVER, sample_rate_hz=5_000.0, noise_std=3e-4)
    traces = []
    for number in range(30):
        where = [(1.2 + 0.05 * number, 0.1)]
        trace = hear(where, transducer=stated, receiver=receiver, seed=number)
        iq = trace.samples.reshape(-1, 2)
        iq = gaussian_filter1d(iq, 5_000.0 * rounded_s, axis=0) if rounded_s else iq
        traces.append(replace(trace, samples=iq.ravel().astype(np.float32)))

    measured = measure_pulse(traces, ReconstructionParameters())

    assert measured is not None
    assert measured.is_known == (rounded_s > 0.0)
    if measured.is_known:
        assert measured.residual < 0.5 * measured.stated_residual < 0.06


def test_the_loneliest_echoes_tell_the_pulse():
    """Of walls most echoes have others nearer than the pulse is long, each at another distance."""
    rng = np.random.default_rng(3)
    pulse = np.concatenate([np.zeros(20), np.arange(8) / 8.0, np.exp(-np.arange(32) / 8.0)])
    pulse = np.concatenate([pulse, np.zeros(20)]).astype(complex)

    def snippet(others):
        heard = pulse.copy()
        for later in rng.uniform(2, 12, size=others).astype(int):
            turned = 0.4 * np.exp(2j * np.pi * rng.uniform())
            heard += turned * np.concatenate([np.zeros(later), pulse[:-later]])
        noise = rng.normal(size=(2, len(pulse))) * 0.002
        return heard + noise[0] + 1j * noise[1]

    crowded = np.array([snippet(3 if number % 8 else 0) for number in range(40)])
    template = align(crowded, 6).template[::FINER]
    scale = np.vdot(pulse, template) / np.vdot(pulse, pulse)
    assert np.linalg.norm(template / scale - pulse) < 0.05 * np.linalg.norm(pulse)


def driven(pulse: Pulse, qualities: dict[float, float], rate_hz: float, count: int) -> Signal:
    """Values of a burst through resonators, with silence before it."""
    received = driven_resonators(pulse, tuple(qualities.items()))
    return received((np.arange(count) - 200) / rate_hz)


def by_survey(topic: str, traces: Sequence[EchoTrace]) -> PulseParameters:
    survey = ReceiverSurvey(ReconstructionParameters())
    for trace in traces:
        survey.add(topic, trace)
    known = survey.known(topic)
    assert known is not None
    return known.pulse


def by_calibration(topic: str, traces: Sequence[EchoTrace]) -> PulseParameters:
    found = calibrate(traces).pulse
    assert found is not None
    return found.parameters


@pytest.mark.parametrize("learn", [by_survey, by_calibration])
def test_two_answers_of_the_mount_that_overlap_are_no_long_pulse(
    learn: Callable[[str, Sequence[EchoTrace]], PulseParameters],
) -> None:
    """They are as far apart in every ping."""
    resonances = {40e3: 30.0, 40.5e3: 30.0}
    own = [{"delay_s": 0.0021, "amplitude": 0.5}, {"delay_s": 0.0033, "amplitude": 0.3}]
    transducer = {
        "pulse": {
            "shape": "tone_burst",
            "carrier_hz": 40e3,
            "duration_s": 3e-4,
            "resonances": [
                {"frequency_hz": frequency_hz, "quality": quality}
                for frequency_hz, quality in resonances.items()
            ],
        },
        "receiver": {
            "encoding": "raw",
            "sample_rate_hz": 200e3,
            "noise_std": 0.003,
            "own_echoes": own,
        },
    }
    content = {
        "seed": 5,
        "duration_s": 8.0,
        "world": {"area_m": [0.0, 5.0, 0.0, 5.0], "random_poles": {"count": 8}},
        "robots": [
            {
                "name": "robot1",
                "motion": {"kind": "random_walk", "speed_m_s": 0.8},
                "transducers": [transducer],
            }
        ],
    }
    traces = [trace for _, trace in simulate(Scenario.from_mapping(content, "own echoes"))]
    known = learn("/robot1/echo", traces)
    learnt = np.array(known.template_i) + 1j * np.array(known.template_q)
    rate_hz = known.template_rate_hz
    true = driven(traces[0].transducer.pulse.driven, resonances, rate_hz, len(learnt) + 400)
    alike = np.abs(np.correlate(true, learnt, "valid")).max()
    assert alike > 0.995 * np.linalg.norm(true) * np.linalg.norm(learnt)
