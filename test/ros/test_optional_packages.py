"""TF and map updates are used where they are installed, and done without where they are not.

The wheels of ROS 2 have neither tf2_ros nor map_msgs. Where they are missing, stand-ins of the
same interface take their place.
"""

import sys
from collections.abc import Iterator
from dataclasses import replace
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from usmap_ros.io.conversions import cone_to_cdr, trace_to_cdr, transform_to_message
from usmap_ros.nodes.cone_reconstructor import ConeReconstructor
from usmap_ros.nodes.echo_driver import EchoDriver
from usmap_ros.nodes.map_fusion import MapFusion
from usmap_ros.nodes.plumbing import ros_types
from usmap_ros.nodes.plumbing.map_publisher import MapPublisher
from usmap_ros.nodes.plumbing.ros_types import RosMessageTypes
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import MappingParameters, PipelineParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.runs.pipeline import Pipeline

CONE = "usmap_msgs/msg/EchoCone"
TYPES = RosMessageTypes()
Cones = list[tuple[str, EchoCone]]
BASE = {("map", "robot1/base_link")}
SONARS = {("robot1/base_link", "robot1/left"), ("robot1/base_link", "robot1/front")}


def edges(messages: list[Any]) -> set[tuple[str, str]]:
    """Parent and child of every transform."""
    return {(message.header.frame_id, message.child_frame_id) for message in messages}


class FakeTf:
    """What the nodes use of tf2_ros."""

    def __init__(self) -> None:
        self.known: dict[tuple[str, str], Pose] = {}
        self.sent: list[Any] = []
        self.static: list[Any] = []
        self.stamp_ns: int | None = None
        module: Any = ModuleType("tf2_ros")
        module.TransformException = type("TransformException", (Exception,), {})
        module.Buffer = lambda node=None: SimpleNamespace(lookup_transform=self._look_up)
        module.TransformListener = lambda buffer, node: None
        module.TransformBroadcaster = lambda node: SimpleNamespace(sendTransform=self.sent.append)
        module.StaticTransformBroadcaster = lambda node: SimpleNamespace(
            sendTransform=self.static.extend
        )
        self.module = module

    def _look_up(self, target: str, source: str, time: Any) -> Any:
        if (target, source) not in self.known:
            raise self.module.TransformException(f"{source} is not connected to {target}")
        stamp_ns = time.nanoseconds if self.stamp_ns is None else self.stamp_ns
        return transform_to_message(self.known[target, source], target, source, stamp_ns, TYPES)


@pytest.fixture
def tf(monkeypatch: pytest.MonkeyPatch) -> Iterator[FakeTf]:
    """Give a stand-in for TF."""
    fake = FakeTf()
    monkeypatch.setitem(sys.modules, "tf2_ros", fake.module)
    return fake


def test_a_cone_in_another_frame_is_moved(live: Any, tf: FakeTf, cones: Cones) -> None:
    shift = Pose.planar(2.0, -1.0, 0.5)
    tf.known["map", "odom"] = shift
    node = live.add(MapFusion, frame_id="map")
    publisher = live.publisher(CONE, "/robot1/cone", 50)
    for number, (_, cone) in enumerate(cones[:5]):
        publisher.publish(cone_to_cdr(replace(cone, frame_id="odom")))
        live.until(lambda n=number: node.health.total("fused") == n + 1)
    expected = Pipeline()
    for _, cone in cones[:5]:
        expected.fuse(replace(cone, pose=shift.compose(cone.pose)))
    # A ray along the border of two cells may go to either: poses differ in their last bit.
    moved, expected_map = node.session.fusion.occupancy_map(), expected.occupancy_map()
    assert np.isclose(moved.log_odds, expected_map.log_odds, atol=1e-4).mean() > 0.999


def test_a_cone_waits_for_its_transform_but_not_forever(
    live: Any, tf: FakeTf, cones: Cones
) -> None:
    node = live.add(MapFusion, frame_id="map", transform_wait_s=10.0)
    publisher = live.publisher(CONE, "/robot1/cone", 50)
    publisher.publish(cone_to_cdr(replace(cones[0][1], frame_id="odom")))
    live.until(lambda: node.health.total("received") == 1)
    assert node.health.total("refused") == 0
    tf.known["map", "odom"] = Pose.planar(0.0, 0.0, 0.0)
    live.until(lambda: node.health.total("fused") == 1)
    assert live.set_parameter("/map_fusion", "transform_wait_s", 0.0).successful
    publisher.publish(cone_to_cdr(replace(cones[1][1], frame_id="moon")))
    live.until(lambda: node.health.total("refused") == 1)
    assert "moon is not connected to map" in node.health.reason("refused")


def test_tf_moves_a_simulated_robot(live: Any, tf: FakeTf, request: Any) -> None:
    scenario = str(request.config.rootpath / "config/scenarios/poles.yaml")
    node = live.add(
        EchoDriver,
        scenario=scenario,
        pose_source="tf",
        publish_tf=True,
        ping_rate_hz=50.0,
        # The machine may be busy.
        pose_timeout_s=1e6,
    )
    echoes = live.listen("usmap_msgs/msg/EchoTrace", "/echo")
    live.until(lambda: node.health.total("without pose"))
    tf.known["map", "robot1/base_link"] = Pose.planar(4.25, 6.5, 0.75)
    tf.stamp_ns = node.get_clock().now().nanoseconds
    live.until(lambda: echoes)
    assert echoes[0].pose.pose.position.x == pytest.approx(4.25)
    # Who moves the robot broadcasts its base; a second parent would tear the tree apart.
    assert edges(tf.static) == {("robot1/base_link", "robot1/sonar")}
    assert tf.sent == []


@pytest.mark.parametrize(
    ("options", "moving", "fixed"),
    [
        ({}, BASE, SONARS),
        ({"publish_base_tf": False}, set(), SONARS),
        ({"publish_transducer_tf": False}, BASE, set()),
        ({"base_frame": "bat/base"}, {("map", "bat/base")},
         {("bat/base", "robot1/left"), ("bat/base", "robot1/front")}),
    ],
)  # fmt: skip
def test_a_simulated_robot_is_a_tree_of_frames(
    live: Any, tf: FakeTf, request: Any, options: Any, moving: Any, fixed: Any
) -> None:
    scenario = request.config.rootpath / "config/scenarios/two_transducers.yaml"
    node = live.add(
        EchoDriver, scenario=str(scenario), publish_tf=True, ping_rate_hz=50.0, **options
    )
    live.until(lambda: node.health.total("published") > 5)
    assert (edges(tf.sent), edges(tf.static)) == (moving, fixed)


def test_a_driver_without_a_pose_in_the_world_leaves_it_to_tf(
    live: Any, tf: FakeTf, traces: list[tuple[str, EchoTrace]]
) -> None:
    node = live.add(MapFusion, frame_id="map")
    live.add(ConeReconstructor)
    echo = live.publisher("usmap_msgs/msg/EchoTrace", "/echo")
    live.until(lambda: live.peer.count_subscribers("/cone"))
    trace = traces[0][1]
    tf.known["map", trace.child_frame_id] = trace.pose
    nowhere = replace(trace, frame_id=trace.child_frame_id, pose=Pose.planar(0.0, 0.0, 0.0))
    live.until(lambda: live.nodes[1].health.report().facts["listeners"] == "1")
    echo.publish(trace_to_cdr(nowhere))
    live.until(lambda: node.health.total("fused") == 1)
    expected = Pipeline()
    expected.process(replace(trace, pose=Pose(trace.pose.position_m, trace.pose.orientation)))
    np.testing.assert_allclose(
        node.session.fusion.occupancy_map().log_odds, expected.occupancy_map().log_odds, atol=1e-4
    )


def test_a_driver_that_needs_tf_says_so(live: Any, request: Any) -> None:
    pytest.importorskip("rclpy")
    if "tf2_ros" in sys.modules:
        pytest.skip("tf2_ros is installed")
    scenario = str(request.config.rootpath / "config/scenarios/poles.yaml")
    with pytest.raises(Exception, match="tf2_ros is not installed"):
        live.add(EchoDriver, scenario=scenario, pose_source="tf")


class Listened:
    """A publisher that somebody listens to."""

    def __init__(self, messages: list[Any]) -> None:
        self.publish = messages.append

    def get_subscription_count(self) -> int:
        return 1


@pytest.fixture
def published(monkeypatch: pytest.MonkeyPatch) -> dict[str, list[Any]]:
    """Give what a publisher of maps says by topic, with map_msgs installed."""
    published: dict[str, list[Any]] = {}

    def advertise(node: Any, topic: Any, name: str | None = None) -> Any:
        return Listened(published.setdefault(topic.name, []))

    monkeypatch.setattr("usmap_ros.nodes.plumbing.map_publisher.advertise", advertise)
    monkeypatch.setattr("usmap_ros.nodes.plumbing.map_publisher.advertise_managed", advertise)
    real = ros_types.interface_class
    fake = {"map_msgs/msg/OccupancyGridUpdate": SimpleNamespace}
    monkeypatch.setattr(ros_types, "interface_class", lambda name: fake.get(name) or real(name))
    return published


def test_whole_maps_are_rare_where_updates_are_enough(
    published: dict[str, list[Any]], cones: Cones
) -> None:
    times_s = iter(range(100))
    publisher = MapPublisher(None, True, whole_period_s=5.0, clock=lambda: next(times_s))
    # Each new ping changes what it sees, and not the extent of the map.
    by_ping = PipelineParameters(mapping=MappingParameters(method="additive"))
    pipeline = Pipeline(by_ping)
    for _, cone in cones[:12]:
        pipeline.fuse(cone)
    # From now on the extent is the same.
    for _, cone in [*cones[:12], *cones[:12]]:
        pipeline.fuse(cone)
        publisher.publish(pipeline.occupancy_map())
    assert len(published["map"]) == len(published["map_probability"]) == 5
    assert published["map_updates"]


def test_updates_are_the_part_of_the_map_that_changed(
    published: dict[str, list[Any]], cones: Cones
) -> None:
    publisher, pipeline = MapPublisher(None, with_updates=True), Pipeline()
    for _, cone in cones[:12]:
        pipeline.fuse(cone)
        publisher.publish(pipeline.occupancy_map())
    assert published["map_updates"]
    maps = {(m.header.stamp.sec, m.header.stamp.nanosec): m for m in published["map"]}
    for update in published["map_updates"]:
        grid = maps[update.header.stamp.sec, update.header.stamp.nanosec]
        values = np.array(grid.data, dtype=np.int8).reshape(grid.info.height, grid.info.width)
        part = values[update.y : update.y + update.height, update.x : update.x + update.width]
        np.testing.assert_array_equal(np.array(update.data).reshape(part.shape), part)


def test_without_map_msgs_the_map_is_published_all_the_same(live: Any, cones: Cones) -> None:
    node = live.add(MapFusion, publish_updates=True)
    publisher = live.publisher(CONE, "/robot1/cone", 50)
    publisher.publish(cone_to_cdr(cones[0][1]))
    live.until(lambda: node.health.total("published"))
