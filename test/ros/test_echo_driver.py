"""The node that simulates a robot's transducers."""

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rclpy.qos import qos_profile_sensor_data
from rclpy.serialization import serialize_message

from usmap_ros.errors import ConfigurationError
from usmap_ros.io.conversions import odometry_to_message, trace_from_cdr
from usmap_ros.nodes.echo_driver import EchoDriver
from usmap_ros.nodes.plumbing.ros_types import RosMessageTypes
from usmap_ros.nodes.plumbing.ros_types import interface_class as type_of
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.simulation import Scenario

SCENARIOS = Path(__file__).parents[2] / "config/scenarios"
POLES = str(SCENARIOS / "poles.yaml")
ECHO = "usmap_msgs/msg/EchoTrace"
TYPES = RosMessageTypes()


def test_it_pings_at_the_rate_of_the_scenario(live: Any) -> None:
    node = live.add(EchoDriver, namespace="robot2", scenario=POLES, robot="robot2")
    echoes = live.listen(ECHO, "/robot2/echo")
    live.until(lambda: len(echoes) >= 5)
    traces = [trace_from_cdr(serialize_message(message)) for message in echoes]
    assert {trace.child_frame_id for trace in traces} == {"robot2/sonar"}
    assert np.diff([trace.stamp_ns for trace in traces]).min() > 0
    assert node.health.total("published") >= 5
    assert float(node.health.report().facts["rate (Hz)"]) > 0.0
    assert 100_000_000 in [timer.timer_period_ns for timer in node.timers]


def test_it_follows_its_path(live: Any, poles: Scenario) -> None:
    start_s = round(time.time()) - 20.0
    node = live.add(EchoDriver, scenario=POLES, robot="robot1", start_time_s=start_s)
    echoes = live.listen(ECHO, "/echo")
    live.until(lambda: len(echoes) >= 3)
    robot = poles.fleet(poles.scene())[0]
    assert node.get_clock().now().nanoseconds > 0
    for message in echoes[:3]:
        trace = trace_from_cdr(serialize_message(message))
        base = robot.motion.pose(trace.stamp_ns / 1e9 - start_s)
        expected = base.compose(robot.transducers[0].mount)
        np.testing.assert_allclose(trace.pose.position_m, expected.position_m, atol=1e-5)


def test_the_first_echo_goes_out_as_a_range(live: Any) -> None:
    live.add(EchoDriver, scenario=POLES, ping_rate_hz=20.0)
    ranges = live.listen("sensor_msgs/msg/Range", "/range", qos_profile_sensor_data)
    live.until(lambda: len(ranges) >= 10)
    for message in ranges:
        assert message.header.frame_id == "robot1/sonar"
        assert message.min_range <= message.range <= message.max_range


def test_several_transducers_take_turns(live: Any) -> None:
    path = str(SCENARIOS / "two_transducers.yaml")
    scenario = Scenario.load(Path(path))
    names = [transducer.name for transducer in scenario.robots[0].transducers]
    live.add(EchoDriver, namespace="robot", scenario=path)
    heard = [live.listen(ECHO, f"/robot/{name}/echo") for name in names]
    live.until(lambda: all(len(messages) >= 5 for messages in heard))
    stamps = [{(m.header.stamp.sec, m.header.stamp.nanosec) for m in part} for part in heard]
    assert not stamps[0] & stamps[1]


def test_odometry_moves_the_robot(live: Any) -> None:
    node = live.add(EchoDriver, scenario=POLES, pose_source="odometry", ping_rate_hz=50.0)
    echoes = live.listen(ECHO, "/echo")
    odometry = live.publisher("nav_msgs/msg/Odometry", "/odom")
    live.until(lambda: node.health.total("without pose"))
    assert not echoes
    pose = Pose.planar(4.25, 6.5, 0.75)

    def is_moved() -> bool:
        now_ns = node.get_clock().now().nanoseconds
        odometry.publish(odometry_to_message(pose, "map", "base_link", now_ns, TYPES))
        return len(echoes) >= 3

    live.until(is_moved)
    for message in echoes:
        trace = trace_from_cdr(serialize_message(message))
        np.testing.assert_allclose(trace.pose.position_m[:2], [4.25, 6.5])
        assert trace.pose.yaw_rad == pytest.approx(0.75)


def test_odometry_that_is_old_or_malformed_moves_nothing(live: Any) -> None:
    node = live.add(EchoDriver, scenario=POLES, pose_source="odometry", ping_rate_hz=50.0)
    odometry = live.publisher("nav_msgs/msg/Odometry", "/odom")
    message = odometry_to_message(Pose.planar(4.0, 6.0, 0.0), "map", "base", 10**9, TYPES)
    odometry.publish(message)
    live.until(lambda: "old" in node.health.reason("without pose"))
    assert "use_sim_time" in node.health.reason("without pose")
    message.pose.pose.position.x = float("nan")
    odometry.publish(message)
    live.until(lambda: node.health.total("malformed") == 1)
    assert node.health.total("published") == 0


@pytest.mark.parametrize(
    ("parameters", "reason"),
    [
        ({}, "scenario: is missing"),
        ({"scenario": "nowhere.yaml"}, "does not exist"),
        ({"scenario": POLES, "robot": "r2d2"}, "robot1, robot2, robot3"),
        ({"scenario": POLES, "pose_source": "wishes"}, "pose_source"),
        ({"scenario": POLES, "start_time_s": 1000.0}, "start_time_s: is .* ago"),
    ],
)
def test_it_says_why_it_cannot_start(live: Any, parameters: dict[str, Any], reason: str) -> None:
    with pytest.raises(ConfigurationError, match=reason):
        live.add(EchoDriver, **parameters)


EPOCH_S = 1_700_000_000


@pytest.fixture
def clocked(live: Any) -> Any:
    """Give a driver in simulated time, and a function that lets /clock say a time."""
    node = live.add(EchoDriver, scenario=POLES, use_sim_time=True)
    echoes = live.listen(ECHO, "/echo")
    publisher = live.publisher("rosgraph_msgs/msg/Clock", "/clock")
    clock_class = type_of("rosgraph_msgs/msg/Clock")

    def tell(time_ns: int) -> None:
        message = clock_class()
        message.clock.sec, message.clock.nanosec = divmod(time_ns, 10**9)
        publisher.publish(message)
        live.until(lambda: node.get_clock().now().nanoseconds == time_ns)

    def run_from(time_s: float, pings: int = 3) -> list[EchoTrace]:
        """Let time go on from `time_s` until there are so many pings."""
        del echoes[:]
        for tick in range(1000):
            tell(round(time_s * 1e9) + tick * 50_000_000)
            live.spin(0.01)
            if len(echoes) >= pings:
                return [trace_from_cdr(serialize_message(message)) for message in echoes]
        raise AssertionError("it does not ping")

    return run_from


@pytest.mark.parametrize("first_s", [0.05, 3600.0, EPOCH_S])
def test_simulated_time_may_start_anywhere(clocked: Any, first_s: float, poles: Scenario) -> None:
    first = clocked(first_s)[0]
    assert first_s <= first.stamp_ns / 1e9 < first_s + 1.0
    # However late it is on the clock, the robot has only just set off.
    start = poles.fleet(poles.scene())[0].motion.pose(0.0)
    assert np.linalg.norm((first.pose.position_m - start.position_m)[:2]) < 2.0


def test_simulated_time_may_jump_and_the_robot_pings_on(clocked: Any) -> None:
    for time_s in (100.0, EPOCH_S, 7200.0, 7190.0, 0.5):
        assert time_s <= clocked(time_s)[0].stamp_ns / 1e9 < time_s + 1.0


def test_a_path_that_began_long_ago_is_caught_up_with_bit_by_bit(live: Any) -> None:
    node = live.add(
        EchoDriver, scenario=POLES, start_time_s=float(round(time.time()) - 120), ping_rate_hz=100.0
    )
    live.until(lambda: node.health.total("published"))
    assert node.health.total("without pose") >= 2
    assert "path is drawn up to" in node.health.reason("without pose")
