"""Robots in frames of their own: what map_fusion tells of where they were found to be."""

import sys
from dataclasses import replace
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pings_among_poles import Ping, circle, cone, heard, poles

from usmap_ros.io.conversions import cone_to_cdr
from usmap_ros.localisation.planar import between
from usmap_ros.nodes.map_fusion import MapFusion
from usmap_ros.nodes.plumbing.status import report_of
from usmap_ros.numerics.geometry import Pose

#: Where the frames of their odometry are in the map.
STARTS = {"robot1": np.array([1.0, 2.0, 0.5]), "robot2": np.array([-2.0, 1.0, 2.0])}


def pings(robot: str) -> list[Ping]:
    made = []
    for number, real in enumerate(circle(40)):
        x_m, y_m, yaw_rad = map(float, between(STARTS[robot], real))
        one = cone(Pose.planar(x_m, y_m, yaw_rad), heard(Pose.planar(*real), poles()))
        names = {"frame_id": f"{robot}/odom", "child_frame_id": f"{robot}/sonar"}
        stamp_ns = 10**8 * (number + 1) + list(STARTS).index(robot)
        made.append((f"/{robot}/cone", replace(one, stamp_ns=stamp_ns, **names)))
    return made


@pytest.fixture
def sent(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Give what goes out on TF; nobody else says anything there."""
    messages: list[Any] = []
    module: Any = ModuleType("tf2_ros")
    module.TransformException = type("TransformException", (Exception,), {})

    def look_up(*_: Any) -> None:
        raise module.TransformException("frames are not connected")

    module.Buffer = lambda node: SimpleNamespace(lookup_transform=look_up)
    module.TransformListener = lambda buffer, node: None
    module.TransformBroadcaster = lambda node: SimpleNamespace(sendTransform=messages.append)
    module.StaticTransformBroadcaster = None
    monkeypatch.setitem(sys.modules, "tf2_ros", module)
    return messages


def test_frames_and_ways_of_joined_robots_are_told(
    live: Any, nav2_qos: Any, sent: list[Any]
) -> None:
    starts = [f"{robot} {' '.join(map(str, start))}" for robot, start in STARTS.items()]
    ways = {
        robot: live.listen("nav_msgs/msg/Path", f"/map_fusion/trajectories/{robot}", nav2_qos)
        for robot in STARTS
    }
    told = live.listen("diagnostic_msgs/msg/DiagnosticArray", "/diagnostics", 100)
    node = live.add(MapFusion, poses__initial_poses=starts, publish_rate_hz=5.0)
    senders = {
        robot: live.publisher("usmap_msgs/msg/EchoCone", f"/{robot}/cone", 50) for robot in STARTS
    }
    for robot, sender in senders.items():
        for _, one in pings(robot):
            sender.publish(cone_to_cdr(one))
    live.until(lambda: node.health.total("fused") == 80)
    live.until(lambda: all(way and len(way[-1].poses) == 40 for way in ways.values()))
    newest = {message.child_frame_id: message for message in sent}
    for robot, start in STARTS.items():
        message = newest[f"{robot}/odom"]
        assert message.header.frame_id == "map"
        shift = message.transform.translation
        # Robots are some metres from where their frames begin: headings count.
        np.testing.assert_allclose([shift.x, shift.y], start[:2], atol=0.2)
    assert ways["robot2"][-1].header.frame_id == "map"
    first = ways["robot2"][-1].poses[0].pose.position
    np.testing.assert_allclose([first.x, first.y], circle(40)[0, :2], atol=0.1)
    grid = live.call("nav_msgs/srv/GetMap", "/map_fusion/get_map").map
    assert grid.header.frame_id == "map"

    def are_said_to_be_joined() -> bool:
        facts = [report_of(status).facts for one in told for status in one.status]
        return "robot1 joined, robot2 joined" in [fact.get("poses") for fact in facts]

    live.until(are_said_to_be_joined)
    assert node.health.total("jumped") == 0
