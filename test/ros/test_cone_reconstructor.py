"""The node that recovers echoes: what it publishes, and what it does when it cannot keep up."""

import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rclpy.qos import qos_profile_sensor_data
from rclpy.serialization import serialize_message

from usmap_ros.calibration import receiver_survey
from usmap_ros.io.conversions import cone_from_cdr, points_from_message, trace_to_cdr
from usmap_ros.io.conversions.common import header_to_message
from usmap_ros.live.health import Level
from usmap_ros.nodes.cone_reconstructor import ConeReconstructor
from usmap_ros.nodes.plumbing.ros_types import RosMessageTypes
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.simulation import Scenario, simulate

ECHO, CONE = "usmap_msgs/msg/EchoTrace", "usmap_msgs/msg/EchoCone"
TYPES = RosMessageTypes()
AS_REAL = Path(__file__).parents[2] / "config/scenarios/as_real.yaml"
Traces = list[tuple[str, EchoTrace]]


def test_every_trace_becomes_the_cone_that_the_pipeline_makes(
    live: Any, traces: Traces, cones: list[tuple[str, EchoCone]]
) -> None:
    live.add(ConeReconstructor, namespace="robot1")
    found = live.listen(CONE, "/robot1/cone", 50)
    echo = live.publisher(ECHO, "/robot1/echo")
    live.until(lambda: live.peer.count_publishers("/robot1/cone"))
    for number, (_, trace) in enumerate(traces[:10]):
        echo.publish(trace_to_cdr(trace))
        live.until(lambda n=number: len(found) > n)
    for message, (_, cone) in zip(found, cones, strict=False):
        back = cone_from_cdr(serialize_message(message))
        assert back.stamp_ns == cone.stamp_ns
        np.testing.assert_array_equal(back.ranges_m, cone.ranges_m)
        np.testing.assert_array_equal(back.amplitudes, cone.amplitudes)


def test_cones_that_nobody_hears_are_a_warning(
    live: Any, trace_message: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    node = live.add(ConeReconstructor)
    monkeypatch.setattr(node.health, "clock", lambda: 0.0)
    live.publisher(ECHO, "/echo").publish(trace_message)
    live.until(lambda: node.health.total("published") == 1)
    report = node.health.report()
    assert (report.facts["unheard"], report.facts["listeners"]) == ("1", "0")
    assert (report.level, "does map_fusion run?" in report.message) == (Level.WARN, True)
    live.listen(CONE, "/cone", 50)
    live.until(lambda: node.health.report().facts["listeners"] == "1")


def ping_until_heard(live: Any, trace: EchoTrace, messages: list[Any]) -> None:
    """Publish a trace again and again until what is made of it has arrived."""
    echo = live.publisher(ECHO, "/echo")

    def heard() -> list[Any]:
        echo.publish(trace_to_cdr(trace))
        return messages

    live.until(heard)


def test_candidate_cells_lie_on_the_rings_of_the_echoes(live: Any, traces: Traces) -> None:
    live.add(ConeReconstructor)
    clouds = live.listen("sensor_msgs/msg/PointCloud2", "/cone_cells", qos_profile_sensor_data)
    trace = traces[0][1]
    ping_until_heard(live, trace, clouds)
    columns, frame_id, stamp_ns = points_from_message(clouds[0])
    assert list(columns) == ["x", "y", "z", "coefficient"]
    assert (frame_id, stamp_ns) == (trace.frame_id, trace.stamp_ns)
    assert len(columns["x"]) > 10
    x, y = trace.pose.position_m[:2]
    ranges_m = np.hypot(columns["x"] - x, columns["y"] - y)
    assert ranges_m.max() < trace.transducer.max_range_m
    assert columns["coefficient"].min() > 0.0


def test_rays_through_free_space_go_out_as_a_scan(live: Any, traces: Traces) -> None:
    live.add(ConeReconstructor)
    scans = live.listen("sensor_msgs/msg/LaserScan", "/free_scan", qos_profile_sensor_data)
    trace = traces[0][1]
    ping_until_heard(live, trace, scans)
    assert scans[0].header.frame_id == trace.child_frame_id
    assert max(scans[0].ranges) > trace.transducer.min_range_m
    assert len(scans[0].ranges) > 10


def test_several_transducers_have_topics_of_their_own(live: Any, traces: Traces) -> None:
    live.add(ConeReconstructor, namespace="robot1", transducers=["left", "right"])
    left = live.listen(CONE, "/robot1/left/cone", 50)
    right = live.listen(CONE, "/robot1/right/cone", 50)
    echo = live.publisher(ECHO, "/robot1/right/echo")
    live.until(lambda: live.peer.count_publishers("/robot1/right/cone"))
    echo.publish(trace_to_cdr(traces[0][1]))
    live.until(lambda: right)
    assert left == []


def test_the_oldest_is_dropped_and_counted_when_it_cannot_keep_up(
    live: Any, traces: Traces, monkeypatch: pytest.MonkeyPatch
) -> None:
    node = live.add(ConeReconstructor, queue_depth=3, diagnostics_period_s=0.1)
    # What went wrong shows for some seconds: here, for as long as the test takes.
    monkeypatch.setattr(node.health, "clock", lambda: 0.0)
    reconstruct = Pipeline.reconstruct_sounding
    has_begun, may_go_on = threading.Event(), threading.Event()

    def when_told(pipeline: Pipeline, sounding: list[EchoTrace]) -> Any:
        has_begun.set()
        assert may_go_on.wait(90.0)
        return reconstruct(pipeline, sounding)

    monkeypatch.setattr(Pipeline, "reconstruct_sounding", when_told)
    found = live.listen(CONE, "/cone", 50)
    diagnostics = live.listen("diagnostic_msgs/msg/DiagnosticArray", "/diagnostics", 50)
    echo = live.publisher(ECHO, "/echo")
    total = node.health.total
    for number, (_, trace) in enumerate(traces[:12]):
        echo.publish(trace_to_cdr(trace))
        live.until(lambda n=number: total("received") == n + 1)
        live.until(has_begun.is_set)
    # One is worked on, three wait.
    assert total("dropped") == 8
    may_go_on.set()
    # A cone may be here before it is counted.
    live.until(lambda: len(found) == 4 and total("published") == 4)
    assert found[-1].header.stamp == header_to_message(traces[11][1].stamp_ns, "", TYPES).stamp

    def warning() -> Any:
        levels = [s for message in diagnostics for s in message.status if s.level == b"\x01"]
        return [s for s in levels if "faster than they are worked on" in s.message]

    live.until(warning)


def test_what_it_does_is_counted_and_timed(
    live: Any, traces: Traces, monkeypatch: pytest.MonkeyPatch
) -> None:
    node = live.add(ConeReconstructor)
    monkeypatch.setattr(node.health, "clock", lambda: 0.0)
    echo = live.publisher(ECHO, "/echo")
    for number, (_, trace) in enumerate(traces[:5]):
        echo.publish(trace_to_cdr(trace))
        live.until(lambda n=number: node.health.total("published") == n + 1)
    facts = node.health.report().facts
    assert (facts["received"], facts["dropped"], facts["rate (Hz)"]) == ("5", "0", "1.0")
    assert float(facts["latency p50 (ms)"]) > 0.0


def test_an_error_in_the_worker_ends_the_node(
    live: Any, trace_message: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    live.add(ConeReconstructor)

    def broken(*_: Any) -> None:
        raise RuntimeError("the publisher broke")

    monkeypatch.setattr("usmap_ros.nodes.cone_reconstructor.cone_to_cdr", broken)
    echo = live.publisher(ECHO, "/echo")
    echo.publish(trace_message)
    with pytest.raises(RuntimeError, match="the publisher broke"):
        live.until(lambda: False)


def test_pulse_that_is_not_the_stated_one_is_a_warning(
    live: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(receiver_survey, "_KEPT", 15)
    scenario = Scenario.load(AS_REAL).model_copy(update={"duration_s": 4.0})
    node = live.add(ConeReconstructor, queue_depth=1000)
    echo = live.publisher(ECHO, "/echo")
    pinged = [trace for topic, trace in simulate(scenario) if topic == "/robot1/echo"]
    for number, trace in enumerate(pinged):
        echo.publish(trace_to_cdr(trace))
        live.until(lambda n=number: node.health.total("received") > n)
    live.until(lambda: "the stated pulse leaves" in node.health.report().message)
    assert node.health.report().level is Level.WARN
    assert "receiver: echo: its samples are some 40 dB larger" in node.health.report().message
    assert "is used instead" in node.health.report().message
    assert not node.health.total("implausible")
