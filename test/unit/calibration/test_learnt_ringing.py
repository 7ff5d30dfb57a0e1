"""What a sensor hears of itself is learnt while mapping, from robots that move, and left out."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import usmap_ros
from usmap_ros.calibration.learnt import LearntReception
from usmap_ros.calibration.own_sound import own_sound_of
from usmap_ros.calibration.receiver_survey import ReceiverSurvey
from usmap_ros.io.bag_reader import BagReader
from usmap_ros.io.bag_writer import new_bag
from usmap_ros.parameters import ReconstructionParameters, RingingParameters
from usmap_ros.pings.trace import EchoTrace, Encoding
from usmap_ros.runs.parallel import Reconstructors
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.runs.recorded import learn_reception
from usmap_ros.simulation import Scenario, simulate
from usmap_ros.simulation.receiver import Receiver

#: Delays (s) and amplitudes of what the mount returns.
OWN = {0.0018: 0.5, 0.0026: 0.3}
STANDING = {"kind": "waypoints", "waypoints_m": [[1.0, 1.0]], "speed_m_s": 0.0}
#: A way without poles.
CORNERS_M = ((0.4, 3.2), (4.1, 3.2), (2.0, 3.65))
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


def straight(*corners_m: tuple[float, float]) -> dict[str, object]:
    return {"kind": "waypoints", "waypoints_m": [list(one) for one in corners_m], "speed_m_s": 0.5}


def as_envelope(trace: EchoTrace) -> EchoTrace:
    magnitude = np.abs(trace.signal()).astype(np.float32)
    return replace(trace, encoding=Encoding.ENVELOPE, samples=magnitude)


def with_point(trace: EchoTrace, range_m: float, reflectivity: float) -> EchoTrace:
    alone = usmap_ros.hear(
        [(range_m, 0.0)],
        reflectivity,
        transducer=trace.transducer,
        receiver=Receiver(trace.encoding, trace.sample_rate_hz, trace.start_delay_s, 0.0),
        channel=trace.channel,
    )
    samples = trace.samples.copy()
    samples += alone.samples[: len(samples)]
    return replace(trace, samples=samples)


def learnt(
    traces: list[EchoTrace], stated: ReconstructionParameters = STATED
) -> ReconstructionParameters:
    survey = ReceiverSurvey(stated)
    for trace in traces:
        survey.add(TOPIC, trace)
    return LearntReception(stated).with_those_of(survey, TOPIC).of(traces[:1])


def pipelines(traces: list[EchoTrace]) -> tuple[Pipeline, Pipeline]:
    """Two: as traces state, and with what they tell."""
    better = Pipeline()
    survey = ReceiverSurvey(ReconstructionParameters())
    for trace in traces:
        survey.add(TOPIC, trace)
    better.learn_reception(survey, TOPIC)
    return Pipeline(), better


def test_what_the_mount_returns_is_learnt_and_taken_off() -> None:
    traces = driven()
    ringing = learnt(traces).ringing
    signal = np.abs(np.array(ringing.waveform).view(np.complex128))
    at = (np.array(list(OWN)) - ringing.waveform_start_s) * ringing.waveform_rate_hz
    for begin, amplitude in zip(at, OWN.values(), strict=True):
        assert signal[round(begin) : round(begin) + 10].max() == pytest.approx(amplitude, rel=0.2)
    stated, better = pipelines(traces)
    for trace in traces[::9]:
        near, clean = stated.reconstruct(trace), better.reconstruct(trace)
        assert np.count_nonzero(near.ranges_m < 0.5) >= 2
        assert not np.any(clean.ranges_m < 0.46)
        assert len(clean.ranges_m) >= len(near.ranges_m) - 3


def test_it_is_learnt_of_traces_that_begin_earlier_and_later() -> None:
    """On grids that are a little before and behind the middle one's."""
    traces = driven()
    early_s, late_s = (part / traces[0].sample_rate_hz for part in (-0.015, 0.015))
    begun = [
        replace(trace, start_delay_s=trace.start_delay_s + early_s)
        if number % 2
        else replace(trace, start_delay_s=trace.start_delay_s + late_s).cut(45)
        for number, trace in enumerate(traces)
    ]
    begun[len(begun) // 2] = traces[len(begun) // 2]
    expected, found = own_sound_of(traces, STATED), own_sound_of(begun, STATED)
    assert expected is not None
    assert found is not None
    # Where all have begun.
    both = min(len(expected.signal), len(found.signal))
    assert both > 10
    assert found.end_s == pytest.approx(expected.end_s, abs=1e-6)
    assert found.signal[-both:] == pytest.approx(expected.signal[-both:], abs=0.01)


def test_objects_are_heard_where_the_mount_answers() -> None:
    """Though fainter than that is."""
    traces = driven()
    _, better = pipelines(traces)
    own_m = 0.5 * 343.0 * min(OWN)
    for trace in traces[::9]:
        cone = better.reconstruct(with_point(trace, own_m, 0.3))
        nearest = int(np.argmin(np.abs(cone.ranges_m - own_m)))
        assert cone.ranges_m[nearest] == pytest.approx(own_m, abs=0.01)
        assert cone.amplitudes[nearest] == pytest.approx(0.3 / own_m**2, rel=0.2)


def test_what_a_magnitude_holds_of_the_mount_is_left_out_where_it_is() -> None:
    """Without its phase it cannot be taken off."""
    traces = [as_envelope(trace) for trace in driven()]
    known = learnt(traces)
    ranges_m = [0.5 * 343.0 * at_s for at_s in OWN]
    assert known.ringing.ranges_m == pytest.approx(ranges_m, abs=0.01)
    assert known.ringing.amplitudes == pytest.approx(list(OWN.values()), rel=0.2)
    stated, better = pipelines(traces)
    for trace in traces[::9]:
        assert np.count_nonzero(stated.reconstruct(trace).ranges_m < 0.5) >= 2
        assert not np.any(better.reconstruct(trace).ranges_m < 0.46)


def test_what_is_left_out_is_in_units_of_corrected_traces() -> None:
    """Such as those of a converter that counts."""
    traces = [as_envelope(trace) for trace in driven()]
    counted = [
        replace(trace, samples=np.float32(1e4) * trace.samples, noise_std=1e4 * trace.noise_std)
        for trace in traces
    ]
    known = learnt(counted)
    assert known.correction.gain == pytest.approx(1e4)
    assert known.ringing.amplitudes == pytest.approx(list(OWN.values()), rel=0.2)


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
        learn_reception(bag, pipeline, Reconstructors(pipeline))
    assert f"{TOPIC}: it hears itself in every ping, until 3.0 ms" in caplog.text
    assert any(pipeline.reception.of(moving[:1]).ringing.waveform)


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
    assert learnt(traces).ringing == RingingParameters()


def test_a_robot_that_goes_straight_on_may_go_along_something() -> None:
    traces = recorded(OWN, straight(*CORNERS_M[:2]))
    assert learnt(traces).ringing == RingingParameters()
    turned = recorded(OWN, straight(*CORNERS_M), 16.0)
    assert any(learnt(turned).ringing.waveform)


def test_who_does_not_want_it_or_knows_better_is_obeyed() -> None:
    traces = driven()
    unwanted = ReconstructionParameters(ringing=RingingParameters(learn=False))
    assert learnt(traces, unwanted) == unwanted
    told = ReconstructionParameters(ringing=RingingParameters(ranges_m=[0.3], amplitudes=[0.1]))
    assert learnt(traces, told) == told
    of_part = learnt(traces).ringing.model_copy(update={"learn": True})
    waveform = [*of_part.waveform[: len(of_part.waveform) // 4 * 2]]
    told = ReconstructionParameters(ringing=of_part.model_copy(update={"waveform": waveform}))
    assert learnt(traces, told) == told


def test_a_pulse_alone_is_told_without_a_turn() -> None:
    survey = ReceiverSurvey(ReconstructionParameters(ringing=RingingParameters(learn=False)))
    for trace in recorded(OWN, straight(*CORNERS_M[:2])):
        survey.add(TOPIC, trace)
    assert survey.has_moved(TOPIC)
    assert survey.has_turned(TOPIC)
