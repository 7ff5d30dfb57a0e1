"""A pulse that is not the stated one is noticed, and none is where it is."""

import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from usmap_ros.calibration.receiver_survey import ReceiverSurvey
from usmap_ros.parameters import CorrectionParameters, PulseParameters, ReconstructionParameters
from usmap_ros.simulation import Scenario, simulate

SCENARIOS = Path(__file__).parents[3] / "config/scenarios"
STATED = ReconstructionParameters()


def surveyed(name: str, parameters: ReconstructionParameters, noise: float) -> ReceiverSurvey:
    """A shipped scenario's receivers, whose noise is so many times what they state."""
    scenario = Scenario.load(SCENARIOS / f"{name}.yaml").model_copy(update={"duration_s": 4.0})
    survey = ReceiverSurvey(parameters)
    for topic, trace in simulate(scenario):
        survey.add(topic, replace(trace, noise_std=trace.noise_std / noise))
    return survey


def problems(name: str, parameters: ReconstructionParameters = STATED) -> dict[str, str]:
    return surveyed(name, parameters, noise=1.0).problems()


@pytest.mark.parametrize("name", ["poles", "floor", "room", "nav2_map"])
def test_nothing_is_wrong_with_shipped_scenarios(name: str) -> None:
    assert problems(name) == {}


@pytest.mark.parametrize("encoding", ["envelope", "iq"])
def test_a_burst_that_begins_at_once_is_what_few_samples_of_it_show(encoding: str) -> None:
    motion = {"kind": "random_walk", "speed_m_s": 0.8, "start": [1.0, 1.0, 0.5]}
    sensor = {
        "pulse": {"shape": "tone_burst", "carrier_hz": 40e3, "duration_s": 2e-4},
        "receiver": {"encoding": encoding, "sample_rate_hz": 20e3, "noise_std": 0.0005},
    }
    walls = {"corners_m": [[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0]], "closed": True}
    content = {
        "seed": 3,
        "duration_s": 8.0,
        "world": {
            "walls": [walls],
            "surface": {"specular_reflectivity": 0.8, "diffuse_reflectivity": 0.02},
        },
        "robots": [{"name": "robot1", "motion": motion, "transducers": [sensor]}],
    }
    survey = ReceiverSurvey(STATED)
    for topic, trace in simulate(Scenario.from_mapping(content, "tone bursts")):
        survey.add(topic, trace)
    assert survey.problems() == {}


@pytest.mark.parametrize(("seed", "rate_hz"), [(1, 10e3), (2, 20e3), (7, 50e3)])
def test_echoes_of_rough_walls_that_overlap_are_no_longer_pulse(seed: int, rate_hz: float) -> None:
    """Their mean explains most of their envelopes better than the pulse does."""
    rng = np.random.default_rng(seed)
    corners_m = np.array([[0.0, 0.0], [5.0, 0.0], [5.0, 4.0], [0.0, 4.0], [0.0, 0.0]])
    points = [
        {"x_m": x_m, "y_m": y_m, "reflectivity": 0.15 * math.sqrt(rng.exponential())}
        for begin_m, end_m in pairwise(corners_m)
        for share in rng.random(round(np.linalg.norm(end_m - begin_m) / 0.02))
        for x_m, y_m in [begin_m + share * (end_m - begin_m) + rng.normal(0.0, 0.002, 2)]
    ]
    receiver = {"encoding": "envelope", "sample_rate_hz": rate_hz, "noise_std": 0.002}
    motion = {"kind": "random_walk", "speed_m_s": 0.5, "start": [1.0, 1.0, 0.5]}
    content = {
        "seed": seed,
        "duration_s": 10.0,
        "world": {"points": points},
        "robots": [{"name": "robot1", "motion": motion, "transducers": [{"receiver": receiver}]}],
    }
    survey = ReceiverSurvey(STATED)
    for topic, trace in simulate(Scenario.from_mapping(content, "rough walls")):
        survey.add(topic, trace)
    assert survey.problems() == {}


def test_a_resonant_pulse_that_is_not_stated_is_named_with_the_remedy() -> None:
    found = problems("as_real")
    unlearnt = problems("as_real", ReconstructionParameters(pulse=PulseParameters(learn=False)))

    assert "/robot1/echo" in found
    assert found.keys() == unlearnt.keys()
    assert all("is used instead" in problem for problem in found.values())
    assert all("usmap calibrate" in problem for problem in unlearnt.values())
    assert all("\n" not in problem for problem in found.values())


@pytest.mark.parametrize("name", ["poles", "room"])
@pytest.mark.parametrize("noise", [1.5, 3.0])
def test_noise_that_is_louder_than_stated_is_taken_for_what_it_is(name: str, noise: float) -> None:
    """Half of it stated, poles were lost among hundreds of false alarms."""
    survey = surveyed(name, STATED, noise)
    known = survey.known("/robot1/echo")
    assert known is not None
    assert known.correction.noise_factor == pytest.approx(noise, rel=0.1)
    assert "times as loud as stated" in survey.problem("/robot1/echo")
    told = ReconstructionParameters(correction=CorrectionParameters(noise_factor=noise))
    assert surveyed(name, told, noise).problems() == {}


def test_what_is_told_is_not_judged() -> None:
    told = PulseParameters(kind="resonant", resonances_hz=[40e3], qualities=[10.0])
    counts = CorrectionParameters(gain=500.0)
    assert problems("as_real", ReconstructionParameters(pulse=told, correction=counts)) == {}
