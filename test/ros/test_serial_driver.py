"""The node that lets a device on a serial line ping."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from played_devices import SENSOR, PlayedDevice, counts, frame
from rclpy.qos import qos_profile_sensor_data
from rclpy.serialization import serialize_message

from usmap_ros.errors import ConfigurationError
from usmap_ros.io.conversions import odometry_to_message, trace_from_cdr
from usmap_ros.live.health import Level
from usmap_ros.nodes.plumbing.ros_types import RosMessageTypes
from usmap_ros.nodes.serial_driver import SerialDriver
from usmap_ros.numerics.geometry import Pose

TYPES = RosMessageTypes()
PAGE = (Path(__file__).parents[2] / "docs" / "own_sensor.md").read_text(encoding="utf-8")
_, DRIVER_OF_THE_PAGE = re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL)


@pytest.fixture
def given(tmp_path: Path) -> Any:
    """Give a device, and the parameters of a driver for it."""
    path = tmp_path / "my_sensor.yaml"
    path.write_text(SENSOR, encoding="utf-8")
    device = PlayedDevice(tmp_path / "ttyPlayed")
    parameters = {"device": str(device.path), "sensor": str(path), "ping_rate_hz": 50.0}
    yield device, parameters | {"answer_timeout_s": 0.2, "longest_pause_s": 0.5}
    device.end()


@pytest.fixture
def started(live: Any, given: Any) -> Any:
    """Give device and driver, and a function that goes on until something holds."""
    device, parameters = given
    node = live.add(SerialDriver, namespace="robot1", **parameters)
    odometry = live.publisher("nav_msgs/msg/Odometry", "/robot1/odom")

    def until(condition: Any) -> Any:
        def holds() -> Any:
            now_ns = node.get_clock().now().nanoseconds
            pose = Pose.planar(1.0, 2.0, 0.0)
            odometry.publish(odometry_to_message(pose, "map", "base", now_ns, TYPES))
            return condition()

        return live.until(holds)

    return device, node, until


def test_device_pings_where_the_odometry_says(live: Any, started: Any) -> None:
    _, node, until = started
    echoes = live.listen("usmap_msgs/msg/EchoTrace", "/robot1/echo")
    ranges = live.listen("sensor_msgs/msg/Range", "/robot1/range", qos_profile_sensor_data)
    until(lambda: len(echoes) >= 3 and ranges)
    for message in echoes:
        trace = trace_from_cdr(serialize_message(message))
        first = trace.samples[0] * 1000.0
        assert trace.samples == pytest.approx(counts(round(first + 250.0)) / 1000.0)
        assert trace.pose.position_m == pytest.approx([1.1, 2.0, 0.2])
    assert (
        np.diff([trace_from_cdr(serialize_message(message)).stamp_ns for message in echoes]).min()
        > 0
    )
    assert node.health.total("published") >= 3


def test_damaged_and_missing_answers_are_counted(started: Any) -> None:
    device, node, until = started
    device.answer = lambda number: (
        frame(number) if number % 3 else frame(number)[:-1] + b"?" if number % 2 else b""
    )
    until(lambda: all(node.health.total(what) for what in ("malformed", "unanswered", "published")))
    assert "checksum" in node.health.reason("malformed")
    assert node.health.total("disconnected") == 0


def test_device_that_is_pulled_out_is_found_again(started: Any) -> None:
    device, node, until = started
    until(lambda: node.health.total("published"))
    device.pull_out()
    until(lambda: node.health.total("disconnected") >= 2)
    report = node.health.report()
    assert report.level is Level.ERROR
    assert "disconnected: " in report.message
    device.plug_in()
    before = node.health.total("published")
    until(lambda: node.health.total("published") > before)


def test_device_that_hangs_is_opened_anew(started: Any) -> None:
    device, node, until = started
    until(lambda: node.health.total("published"))
    device.answer = lambda number: b""
    until(lambda: node.health.total("disconnected"))
    assert node.health.total("unanswered") == 5
    assert "came nothing" in node.health.reason("disconnected")


def test_nothing_pings_without_a_pose(live: Any, given: Any) -> None:
    node = live.add(SerialDriver, **given[1])
    live.until(lambda: node.health.total("without pose"))
    assert node.health.total("published") == 0


@pytest.mark.parametrize(
    ("changes", "text", "reason"),
    [
        ({"device": ""}, SENSOR, "device: is missing"),
        ({"sensor": ""}, SENSOR, "sensor: is missing"),
        ({"sensor": "nowhere.yaml"}, SENSOR, "does not exist"),
        ({"ping_rate_hz": 0.0}, SENSOR, "ping_rate_hz"),
        ({}, SENSOR.replace(", full_scale: 1000.0", ""), "samples.full_scale: is missing"),
        ({}, SENSOR.replace("0.0002", "0.2"), "milliseconds"),
        ({}, SENSOR + "extra: 1", "extra"),
    ],
)
def test_it_says_why_it_cannot_start(
    live: Any, given: Any, changes: dict[str, Any], text: str, reason: str
) -> None:
    Path(given[1]["sensor"]).write_text(text, encoding="utf-8")
    with pytest.raises(ConfigurationError, match=reason):
        live.add(SerialDriver, **(given[1] | changes))


def test_driver_of_the_page_drives(live: Any, given: Any) -> None:
    names: dict[str, Any] = {}
    exec(compile(DRIVER_OF_THE_PAGE, "docs/own_sensor.md", "exec"), names)
    node = live.add(names["MyDriver"], sensor=given[1]["sensor"])
    echoes = live.listen("usmap_msgs/msg/EchoTrace", "/echo")
    odometry = live.publisher("nav_msgs/msg/Odometry", "/odom")

    def heard() -> bool:
        now_ns = node.get_clock().now().nanoseconds
        odometry.publish(
            odometry_to_message(Pose.planar(0.0, 0.0, 0.0), "map", "base", now_ns, TYPES)
        )
        return bool(echoes)

    live.until(heard)
    assert trace_from_cdr(serialize_message(echoes[0])).child_frame_id == "robot1/sonar"
