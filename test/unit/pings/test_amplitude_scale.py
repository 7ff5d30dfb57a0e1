"""Samples in other units are noticed, and the factor is about right."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from usmap_ros.pings.amplitude_scale import AmplitudeScale, AmplitudeScales
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.runs.recorded import SURVEY_EVERY, AmplitudeSurvey
from usmap_ros.simulation import Scenario, simulate

SCENARIOS = Path(__file__).parents[3] / "config/scenarios"


def pings(name: str, factor: float = 1.0) -> list:
    """Topic and trace of some pings of a shipped scenario, amplified."""
    scenario = Scenario.load(SCENARIOS / f"{name}.yaml").model_copy(update={"duration_s": 1.0})
    return [
        (
            topic,
            replace(
                trace,
                samples=(factor * trace.samples).astype(np.float32),
                noise_std=factor * trace.noise_std,
            ),
        )
        for topic, trace in simulate(scenario)
    ]


def judged(recorded: list) -> dict[str, str]:
    scales = AmplitudeScales()
    for topic, trace in recorded:
        scales.add(topic, Pipeline().reconstruct(trace))
    return scales.problems()


@pytest.mark.parametrize("name", ["poles", "floor", "room", "nav2_map"])
def test_nothing_is_wrong_with_shipped_scenarios(name: str) -> None:
    assert judged(pings(name)) == {}


@pytest.mark.parametrize(("factor", "word"), [(2000.0, "louder"), (1e-4, "fainter")])
def test_other_units_are_named_with_the_factor(factor: float, word: str) -> None:
    recorded = [ping for ping in pings("poles", factor) if ping[0] == "/robot1/echo"]
    ((topic, problem),) = judged(recorded).items()

    assert topic == "/robot1/echo"
    assert word in problem
    scale = AmplitudeScale()
    for _, trace in recorded:
        scale.add(Pipeline().reconstruct(trace))
    assert 0.2 * factor < scale.factor < 5.0 * factor


def test_a_survey_needs_few_pings() -> None:
    recorded = [ping for ping in pings("poles", 2000.0) if ping[0] == "/robot2/echo"] * 5
    survey = AmplitudeSurvey(Pipeline())
    for topic, trace in recorded[: 5 * SURVEY_EVERY]:
        survey.add(topic, trace)
    assert list(survey.problems()) == ["/robot2/echo"]


def test_silence_says_nothing() -> None:
    assert AmplitudeScale().problem() == ""
