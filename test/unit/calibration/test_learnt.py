"""A pulse that nobody stated is learnt from a recording's own echoes, and used."""

import multiprocessing
from concurrent.futures import Executor, ProcessPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from usmap_ros.calibration.learnt import LearntReception
from usmap_ros.calibration.receiver_survey import ReceiverSurvey
from usmap_ros.io.bag_reader import BagReader
from usmap_ros.io.bags import write_bag
from usmap_ros.parameters import PipelineParameters, PulseParameters, ReconstructionParameters
from usmap_ros.pings.robot_paths import RobotPaths
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.runs.offline import map_bag
from usmap_ros.runs.parallel import Reconstructors
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.runs.recorded import learn_reception
from usmap_ros.simulation import Scenario, simulate

#: A bought transducer: its resonances ring for a millisecond behind a burst of 0.3 ms, it is heard
#: while it sends, and its converter has 8 bits.
SENSOR = """
      - pulse:
          shape: tone_burst
          carrier_hz: 40000.0
          duration_s: 0.0003
          resonances:
            - {frequency_hz: 40000.0, quality: 15.0}
            - {frequency_hz: 40500.0, quality: 15.0}
        receiver:
          encoding: raw
          sample_rate_hz: 200000.0
          noise_std: 0.004
          converter: {bits: 8, full_scale: 0.5}
          ring_down: {amplitude: 5.0, decay_s: 0.0002}
"""
SCENARIO = f"""
seed: 4
duration_s: 9.0
world:
  area_m: [0.0, 6.0, 0.0, 6.0]
  random_poles: {{count: 12, separation_m: 0.8, median_reflectivity: 1.5}}
robots:
  - name: robot1
    motion: {{kind: random_walk, speed_m_s: 1.0}}
    transducers: {SENSOR}
"""
Traces = list[tuple[str, EchoTrace]]


@pytest.fixture(scope="module")
def traces(tmp_path_factory: pytest.TempPathFactory) -> Traces:
    """Give what the sensor hears; its traces state the burst alone."""
    path = tmp_path_factory.mktemp("scenario") / "bought.yaml"
    path.write_text(SCENARIO)
    return list(simulate(Scenario.load(path)))


@pytest.fixture
def bag(traces: Traces, tmp_path: Path) -> Path:
    write_bag(tmp_path / "bag", traces)
    return tmp_path / "bag"


def mapped(bag: Path, learn: bool, executor: Executor | None = None) -> tuple[float, Pipeline]:
    """Echoes a ping, and the pipeline that mapped them."""
    pulse = PulseParameters(learn=learn)
    pipeline = Pipeline(PipelineParameters(reconstruction=ReconstructionParameters(pulse=pulse)))
    with BagReader([bag]) as reader:
        workers = Reconstructors(pipeline, executor, 2)
        learn_reception(reader, pipeline, workers)
        run = map_bag(reader, pipeline, RobotPaths(), workers=workers)
    return run.echoes / run.pings, pipeline


def test_one_object_is_one_echo_again(bag: Path, caplog: pytest.LogCaptureFixture) -> None:
    as_stated, _ = mapped(bag, learn=False)
    assert "usmap calibrate measures the pulse" in caplog.text
    caplog.clear()
    learnt, pipeline = mapped(bag, learn=True)
    assert "/robot1/echo: the stated pulse leaves" in caplog.text
    assert "is used instead" in caplog.text
    assert list(pipeline.reception.learnt) == ["robot1/sonar"]
    assert as_stated > 2.0 * learnt
    assert learnt < 5.0


def test_processes_know_what_was_learnt(bag: Path) -> None:
    alone, pipeline = mapped(bag, learn=True)
    # None that is forked: this process has threads from now on.
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as executor:
        together, other = mapped(bag, learn=True, executor=executor)
    assert together == alone
    np.testing.assert_array_equal(other.occupancy_map().log_odds, pipeline.occupancy_map().log_odds)


def learnt(traces: Traces, stated: ReconstructionParameters) -> LearntReception:
    survey = ReceiverSurvey(stated)
    for topic, trace in traces:
        survey.add(topic, trace)
    return LearntReception(stated).with_those_of(survey, "/robot1/echo")


def test_what_is_set_by_hand_stays(traces: Traces) -> None:
    chosen = ReconstructionParameters(exclusion=0.35, model_error=0.3)
    known = learnt(traces, chosen).of([traces[0][1]])
    assert (known.exclusion, known.model_error) == (0.35, 0.3)
    assert known.pulse.kind == "measured"
    usual = learnt(traces, ReconstructionParameters())
    assert usual.of([traces[0][1]]).exclusion < 0.35
    # Of several pulses in the air, which it would be is not known.
    assert usual.of([traces[0][1]] * 2) == usual.stated
    insisting = ReconstructionParameters(pulse=PulseParameters(learn=False))
    assert learnt(traces, insisting).of([traces[0][1]]).pulse == insisting.pulse


def test_two_objects_before_a_robot_that_stands_are_no_pulse() -> None:
    content = {
        "seed": 4,
        "duration_s": 9.0,
        "world": {
            "points": [
                {"x_m": 1.5, "y_m": 0.0, "reflectivity": 1.0},
                {"x_m": 1.65, "y_m": 0.0, "reflectivity": 0.9},
            ]
        },
        "robots": [
            {
                "name": "robot1",
                "motion": {"kind": "waypoints", "waypoints_m": [[0.0, 0.0]], "speed_m_s": 0.0},
                "transducers": [{}],
            }
        ],
    }
    heard = list(simulate(Scenario.from_mapping(content, "standing")))
    assert learnt(heard, ReconstructionParameters()).learnt == {}


@pytest.mark.parametrize("name", ["poles", "floor", "room"])
def test_a_pulse_that_is_as_stated_is_not_replaced(
    name: str, request: pytest.FixtureRequest
) -> None:
    path = request.config.rootpath / f"config/scenarios/{name}.yaml"
    scenario = Scenario.load(path).model_copy(update={"duration_s": 4.0})
    survey, pipeline = ReceiverSurvey(ReconstructionParameters()), Pipeline()
    for topic, trace in simulate(scenario):
        survey.add(topic, trace)
    for topic in {robot.name: f"/{robot.name}/echo" for robot in scenario.robots}.values():
        pipeline.learn_reception(survey, topic)
    assert pipeline.reception.learnt == {}


def test_live_it_is_learnt_after_some_pings(traces: Traces) -> None:
    pipeline, survey = Pipeline(), ReceiverSurvey(ReconstructionParameters())

    def echoes() -> int:
        return sum(len(pipeline.reconstruct(trace).ranges_m) for _, trace in traces[:10])

    before = echoes()
    for topic, trace in traces:
        survey.add(topic, trace)
        if survey.is_full(topic):
            break
    pipeline.learn_reception(survey, "/robot1/echo")
    assert echoes() < 0.5 * before
