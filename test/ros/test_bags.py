"""Recordings onto live topics, and live topics into recordings."""

import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.qos import qos_profile_sensor_data
from rclpy.serialization import serialize_message
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rosbags.rosbag2 import Reader

from usmap_ros.errors import UsmapError
from usmap_ros.io.bag_reader import BagReader
from usmap_ros.io.bags import write_bag
from usmap_ros.io.conversions import trace_from_cdr, trace_to_cdr
from usmap_ros.live.attendance import LISTENERS
from usmap_ros.live.backlog import ROOM, WAITING
from usmap_ros.nodes.bag_recorder import BagRecorder
from usmap_ros.nodes.bag_replay import BagReplay
from usmap_ros.nodes.map_fusion import MapFusion
from usmap_ros.nodes.plumbing.ros_types import RosMessageTypes, interface_class
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.trace import EchoTrace

ECHO, CONE = "usmap_msgs/msg/EchoTrace", "usmap_msgs/msg/EchoCone"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
TYPES = RosMessageTypes()
Traces = list[tuple[str, EchoTrace]]


@pytest.fixture
def bag(traces: Traces, tmp_path: Path) -> Path:
    """Give a recording of 30 pings in a second."""
    write_bag(tmp_path / "bag", traces)
    return tmp_path / "bag"


def test_everything_is_published_in_order_with_its_clock(
    live: Any, bag: Path, traces: Traces
) -> None:
    ended: list[bool] = []
    echoes = [live.listen(ECHO, f"/robot{n}/echo") for n in (1, 2, 3)]
    clock = live.listen("rosgraph_msgs/msg/Clock", "/clock", qos_profile_sensor_data)
    live.add(lambda **options: BagReplay(on_end=lambda: ended.append(True), **options),
             bag=str(bag))  # fmt: skip
    live.until(lambda: ended)
    live.until(lambda: sum(map(len, echoes)) == 30)
    for number, messages in enumerate(echoes):
        expected = [t.stamp_ns for topic, t in traces if topic == f"/robot{number + 1}/echo"]
        assert [trace_from_cdr(serialize_message(m)).stamp_ns for m in messages] == expected
    times = [m.clock.sec + m.clock.nanosec / 1e9 for m in clock]
    assert times == sorted(times)
    first, last = traces[0][1].stamp_ns / 1e9, traces[-1][1].stamp_ns / 1e9
    assert first <= times[0] < times[-1] <= last + 1e-6


def test_a_replay_leaves_room_in_the_queue_of_who_fuses(
    live: Any, cones: list[tuple[str, EchoCone]], tmp_path: Path
) -> None:
    write_bag(tmp_path / "cones", cones)
    fusion = live.add(MapFusion, queue_depth=10, diagnostics_period_s=0.1)
    live.add(BagReplay, bag=str(tmp_path / "cones"), rate=1000.0, wait_s=300.0)
    live.until(lambda: fusion.health.total("received") == len(cones))
    live.until(lambda: fusion.health.total("fused") + fusion.health.total("dropped") == len(cones))
    assert fusion.health.total("dropped") == 0


def test_a_replay_waits_until_reconstructors_know_who_listens(
    live: Any, traces: Traces, tmp_path: Path
) -> None:
    """That it sees a fusion itself is not enough: first cones went to nobody on a busy machine."""
    write_bag(tmp_path / "bag", [("/robot1/echo", trace) for _, trace in traces[:5]])
    # The peer is a reconstructor, which knows of one listener at first, and fusion, the other.
    live.listen(ECHO, "/robot1/echo")
    live.listen(CONE, "/robot1/cone")
    live.peer.create_publisher(interface_class(CONE), "/robot1/cone", 10)
    reports = live.peer.create_publisher(interface_class(DIAGNOSTICS), "/diagnostics", 10)
    node = live.add(BagReplay, bag=str(tmp_path / "bag"), wait_s=300.0, rate=10.0)
    live.until(lambda: node.count_subscribers("/robot1/cone") == 2)
    live.until(reports.get_subscription_count)
    reports.publish(report("1"))
    live.spin(1.5)
    assert node.health.total("published") == 0
    reports.publish(report("2"))
    live.until(lambda: node.health.total("published"))


def test_a_replay_waits_until_it_knows_who_reads_its_traces(
    live: Any, traces: Traces, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A reconstructor is matched before its name or its cones are known; it was left behind."""
    write_bag(tmp_path / "bag", [("/robot1/echo", trace) for _, trace in traces[:5]])
    known: list[TopicEndpointInfo] = []
    monkeypatch.setattr(BagReplay, "get_subscriptions_info_by_topic", lambda *_: known)
    live.listen(ECHO, "/robot1/echo")
    node = live.add(BagReplay, bag=str(tmp_path / "bag"), wait_s=300.0, rate=10.0)
    live.until(lambda: node.count_subscribers("/robot1/echo"))
    for name in (None, "_NODE_NAME_UNKNOWN_", "cone_reconstructor"):
        known[:] = [TopicEndpointInfo(node_name=name)] if name else []
        live.spin(1.0)
        assert node.health.total("published") == 0, name
    known[:] = [TopicEndpointInfo(node_name="rviz")]
    live.until(lambda: node.health.total("published"))


def report(listeners: str) -> DiagnosticArray:
    facts = {LISTENERS: listeners, WAITING: "0", ROOM: "1000"}
    values = [KeyValue(key=key, value=value) for key, value in facts.items()]
    return DiagnosticArray(status=[DiagnosticStatus(name="/peer", values=values)])


def test_publishers_have_the_recorded_qos(live: Any, bag: Path) -> None:
    live.add(BagReplay, bag=str(bag), start_paused=True)
    infos = live.until(lambda: live.peer.get_publishers_info_by_topic("/robot1/echo"))
    assert infos[0].qos_profile.reliability.name == "RELIABLE"
    assert infos[0].qos_profile.durability.name == "VOLATILE"


def test_a_paused_replay_waits(live: Any, bag: Path) -> None:
    node = live.add(BagReplay, bag=str(bag), start_paused=True, wait_s=0.0, rate=10.0)
    live.spin(0.5)
    assert node.health.total("published") == 0
    assert live.call("std_srvs/srv/SetBool", "/bag_replay/pause", data=False).success
    live.until(lambda: node.health.total("published") == 30)


def test_a_looped_replay_starts_over(live: Any, bag: Path) -> None:
    node = live.add(BagReplay, bag=str(bag), loop=True, wait_s=0.0, rate=20.0)
    live.until(lambda: node.health.total("loops") >= 2)
    assert live.set_parameter("/bag_replay", "rate", 0.5).successful


@pytest.mark.parametrize("parameters", [{}, {"bag": "nowhere"}, {"topic_pattern": "/none"}])
def test_a_replay_says_why_it_cannot_start(
    live: Any, bag: Path, parameters: dict[str, str]
) -> None:
    if "topic_pattern" in parameters:
        parameters = {**parameters, "bag": str(bag)}
    with pytest.raises(UsmapError, match=r"missing|exist|could be published"):
        live.add(BagReplay, **parameters)


def test_what_is_recorded_can_be_read_by_everybody(
    live: Any, traces: Traces, tmp_path: Path
) -> None:
    echo = live.peer.create_publisher(interface_class("usmap_msgs/msg/EchoTrace"), "/r/echo", 10)
    node = live.add(BagRecorder, bag=str(tmp_path / "recorded"), topic_pattern="/r/.*")
    live.until(echo.get_subscription_count)
    for number, (_, trace) in enumerate(traces):
        echo.publish(trace_to_cdr(trace))
        live.until(lambda n=number: node.health.total("received") == n + 1)
    live.remove(node)
    with BagReader([tmp_path / "recorded"]) as bag:
        back = [(topic, trace.stamp_ns) for topic, trace in bag.traces()]
    assert back == [("/r/echo", trace.stamp_ns) for _, trace in traces]
    with Reader(tmp_path / "recorded") as reader:
        (connection,) = reader.connections
        assert (connection.topic, connection.msgtype) == ("/r/echo", ECHO)
        assert connection.msgcount == len(traces)
        assert "RIHS01" in connection.digest


def test_a_recording_is_never_written_over(live: Any, bag: Path) -> None:
    with pytest.raises(UsmapError, match="not empty"):
        live.add(BagRecorder, bag=str(bag))


def test_a_full_disk_leaves_one_line_and_what_was_written(
    live: Any, processes: Any, tmp_path: Path, traces: Traces
) -> None:
    # A file may become no larger than this, which is what a full disk looks like.
    limit = f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({2**17}, {2**17}))"
    program = f"{limit}; from usmap_ros.cli import main; main()"
    command = [sys.executable, "-c", program, "record", "-o", str(tmp_path / "full")]
    recorder = processes.run(command, "record")
    echo = live.peer.create_publisher(interface_class("usmap_msgs/msg/EchoTrace"), "/r/echo", 10)
    live.until(echo.get_subscription_count)
    large = replace(traces[0][1], samples=np.zeros(60_000, np.float32))
    for _ in range(5):
        echo.publish(trace_to_cdr(large))
        live.spin(0.3)
    recorder.send_signal(signal.SIGINT)
    assert recorder.wait(90.0) == 1
    said = recorder.log.read_text()
    assert "Traceback" not in said
    assert "usmap: error:" in said.splitlines()[-1]
    assert "cannot be completed: File too large; what was written before can be read" in said


def usmap(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "usmap_ros", *map(str, arguments)]


def size_of(folder: Path) -> int:
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())


@pytest.mark.slow
def test_a_killed_recording_keeps_what_was_written(
    live: Any, processes: Any, bag: Path, traces: Traces, tmp_path: Path
) -> None:
    recorder = processes.run(usmap("record", "-o", tmp_path / "recorded"), "record")
    player = processes.run(usmap("replay", bag, "--loop", "--rate", "4"), "replay")
    # However late the recorder begins: what counts is what it has written.
    enough = 5 * sum(trace.samples.nbytes for _, trace in traces)
    live.until(lambda: size_of(tmp_path / "recorded") > enough, timeout_s=300.0)
    recorder.send_signal(signal.SIGKILL)
    recorder.wait()
    player.send_signal(signal.SIGINT)
    assert player.wait(90.0) == 0
    with BagReader([tmp_path / "recorded"]) as kept:
        assert kept.trace_count > 100
        assert kept.skipped.total == 0
        assert len(list(kept.traces())) == kept.trace_count


@pytest.mark.slow
@pytest.mark.usefixtures("domain")
def test_replay_ends_by_itself_and_names_a_missing_bag(bag: Path) -> None:
    run = subprocess.run(
        usmap("replay", bag, "--rate", "10", "--wait", "0"),
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert run.returncode == 0
    assert "published 30 messages" in run.stderr
    run = subprocess.run(
        usmap("replay", "nowhere"), capture_output=True, text=True, timeout=300, check=False
    )
    assert run.returncode == 1
    assert run.stderr.count("\n") == 1
    assert run.stderr == "usmap: error: nowhere: does not exist\n"
