"""What a sensor hears of itself is learnt while mapping, from robots that move, and left out."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from usmap_ros.calibration.learnt import LearntReception
from usmap_ros.calibration.receiver_survey import ReceiverSurvey
from usmap_ros.io.bag_reader import BagReader
from usmap_ros.io.bag_writer import new_bag
from usmap_ros.parameters import ReconstructionParameters, RingingParameters
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.runs.recorded import learn_reception
from usmap_ros.simulation import Scenario, simulate

#: Delays (s) and amplitudes of what the mount returns.
OWN = {0.0018: 0.5, 0.0026: 0.3}
STANDING = {"kind": "waypoints", "waypoints_m": [[1.0, 1.0]], "speed_m_s": 0.0}
TOPIC, STATED = "/robot1/echo", ReconstructionParameters()


def recorded(
    own: dict[float, float], motion: dict[str, object], duration_s: float = 8.0
) -> list[EchoTrace]:
    receiver = {
        "noise_std": 0.005,
        "own_echoes": [{"delay_s": at_s, "amplitude": loud} for at_s, loud in own.items()],
    }
    content = {
        "seed": 5,
        "duration_s": duration_s,
        "world": {
            "area_m": [0.0, 5.0, 0.0, 5.0],
            "random_poles": {"count": 8, "separation_m": 0.8},
        },
        "robots": [{"name": "robot1", "motion": motion, "transducers": [{"receiver": receiver}]}],
    }
    return [trace for _, trace in simulate(Scenario.from_mapping(content, "own echoes"))]


def driven(own: dict[float, float] = OWN, duration_s: float = 8.0) -> list[EchoTrace]:
    motion = {"kind": "random_walk", "speed_m_s": 0.8}
    return recorded(own, motion, duration_s)


def learnt(
    traces: list[EchoTrace], stated: ReconstructionParameters = STATED
) -> ReconstructionParameters:
    survey = ReceiverSurvey(stated)
    for trace in traces:
        survey.add(TOPIC, trace)
    return LearntReception(stated).with_those_of(survey, TOPIC).of(traces[:1])


def test_what_the_mount_returns_is_learnt_and_left_out() -> None:
    traces = driven()
    known = learnt(traces)
    ranges_m = [0.5 * 343.0 * at_s for at_s in OWN]
    assert known.ringing.ranges_m == pytest.approx(ranges_m, abs=0.01)
    assert known.ringing.amplitudes == pytest.approx(list(OWN.values()), rel=0.2)
    stated, better = Pipeline(), Pipeline()
    survey = ReceiverSurvey(ReconstructionParameters())
    for trace in traces:
        survey.add(TOPIC, trace)
    better.learn_reception(survey, TOPIC)
    for trace in traces[::9]:
        near, clean = stated.reconstruct(trace), better.reconstruct(trace)
        assert np.count_nonzero(near.ranges_m < 0.5) >= 2
        assert not np.any(clean.ranges_m < 0.46)
        assert len(clean.ranges_m) >= len(near.ranges_m) - 3


def test_a_recording_says_what_was_learnt(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Though its robot stood for longer than pulses are judged by."""
    standing = recorded(OWN, STANDING, 12.0)
    moving = driven()
    with new_bag(tmp_path / "bag") as writer:
        for trace in standing:
            writer.write_trace(TOPIC, trace)
        for trace in moving:
            late_ns = trace.stamp_ns + standing[-1].stamp_ns - moving[0].stamp_ns + 50_000_000
            writer.write_trace(TOPIC, replace(trace, stamp_ns=late_ns))
    pipeline = Pipeline()
    with BagReader([tmp_path / "bag"]) as bag:
        learn_reception(bag, pipeline)
    assert f"{TOPIC}: it hears itself in every ping, 0.31, 0.45 m away" in caplog.text
    assert len(pipeline.reception.of(moving[:1]).ringing.ranges_m) == 2


@pytest.mark.parametrize("name", ["poles", "floor", "room", "nav2_map"])
def test_nothing_is_learnt_of_a_sensor_that_does_not_hear_itself(
    name: str, request: pytest.FixtureRequest
) -> None:
    scenario = Scenario.load(request.config.rootpath / f"config/scenarios/{name}.yaml")
    survey = ReceiverSurvey(ReconstructionParameters())
    topics = set()
    for topic, trace in simulate(scenario.model_copy(update={"duration_s": 8.0})):
        survey.add(topic, trace)
        topics.add(topic)
    for topic in topics:
        known = survey.known(topic)
        assert known is None or known.ringing == RingingParameters()


def test_a_robot_that_stands_may_look_at_something() -> None:
    traces = recorded(OWN, STANDING)
    assert not any(learnt(traces).ringing.amplitudes)


def test_who_does_not_want_it_or_knows_better_is_obeyed() -> None:
    traces = driven()
    unwanted = ReconstructionParameters(ringing=RingingParameters(learn=False))
    assert learnt(traces, unwanted) == unwanted
    told = ReconstructionParameters(ringing=RingingParameters(ranges_m=[0.3], amplitudes=[0.1]))
    assert learnt(traces, told) == told
