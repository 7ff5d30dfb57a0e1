"""The node that fuses cones: its maps, its services, its life cycle, its memory."""

from collections.abc import Callable
from dataclasses import replace
from itertools import cycle
from pathlib import Path
from threading import get_ident
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from usmap_ros.grids import LAYERS, NORMAL, GridGeometry, OccupancyMap
from usmap_ros.io.conversions import cone_to_cdr, grid_from_message, points_from_message
from usmap_ros.io.conversions.common import header_to_message
from usmap_ros.io.map_files import load_map
from usmap_ros.io.nav2_map import load_nav2_map
from usmap_ros.live.health import Level
from usmap_ros.live.live_fusion import LiveFusion
from usmap_ros.mapping.merging import merge_maps
from usmap_ros.mapping.robot_check.consistency import Consistency
from usmap_ros.nodes.map_fusion import MapFusion
from usmap_ros.nodes.plumbing.map_publisher import normal_columns, placed
from usmap_ros.nodes.plumbing.ros_types import RosMessageTypes, interface_class
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.processes.threads import for_each
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.simulation import Scenario

CONE, GRID = "usmap_msgs/msg/EchoCone", "nav_msgs/msg/OccupancyGrid"
TYPES = RosMessageTypes()
Cones = list[tuple[str, EchoCone]]


def add_fusion(live: Any, namespace: str = "", **parameters: Any) -> MapFusion:
    """Add a node that takes cones as they come.

    Where nodes wait for stragglers, the last cones of some robots are fused seconds later.
    """
    node = live.add(MapFusion, namespace, order_wait_s=0.0, **parameters)
    assert isinstance(node, MapFusion)
    return node


def send(live: Any, cones: Cones) -> None:
    """Publish cones on their topics, and wait until all are fused."""
    node = live.nodes[0]
    before = node.health.total("fused")
    publishers = {topic: live.publisher(CONE, topic, 50) for topic in sorted(dict(cones))}
    for topic, cone in cones:
        publishers[topic].publish(cone_to_cdr(cone))
    live.until(lambda: node.health.total("fused") == before + len(cones))


def send_in_order(live: Any, cones: Cones) -> None:
    """Publish cones to a node that waits for stragglers, and let it wait no longer than it takes.

    However slowly they come, they are fused in the order of their stamps.
    """
    node = live.nodes[0]
    publishers = {topic: live.publisher(CONE, topic, 50) for topic in sorted(dict(cones))}
    for topic, cone in cones:
        publishers[topic].publish(cone_to_cdr(cone))
    live.until(lambda: node.health.total("received") == len(cones))
    assert live.set_parameter("/map_fusion", "order_wait_s", 0.0).successful
    live.until(lambda: node.health.total("fused") == len(cones))
    assert node.health.total("late") == 0


@pytest.fixture(scope="module")
def offline(cones: Cones) -> OccupancyMap:
    """Give the map that the pipeline makes of the same cones."""
    pipeline = Pipeline()
    for _, cone in cones:
        pipeline.fuse(cone)
    return pipeline.occupancy_map()


def test_the_map_is_that_of_the_pipeline(
    live: Any, cones: Cones, offline: OccupancyMap, nav2_qos: Any
) -> None:
    node = live.add(MapFusion, order_wait_s=60.0)
    grids = live.listen(GRID, "/map", nav2_qos)
    send_in_order(live, cones)
    occupancy = node.session.fusion.occupancy_map()
    np.testing.assert_array_equal(occupancy.log_odds, offline.log_odds)
    last = header_to_message(cones[-1][1].stamp_ns, "", TYPES).stamp
    live.until(lambda: grids and grids[-1].header.stamp == last)
    geometry, values, frame_id, _ = grid_from_message(grids[-1])
    assert frame_id == "map"
    np.testing.assert_array_equal(values, placed(offline.trinary(), offline.geometry, geometry))


def stands_still(live: Any, messages: list[Any]) -> bool:
    """Whether no message comes any more, in more than two periods of the default rate."""
    count = len(messages)
    live.spin(2.5)
    return len(messages) == count


def test_a_late_subscriber_gets_the_map_at_once(
    live: Any,
    cones: Cones,
    offline: OccupancyMap,
    nav2_qos: Any,
    assert_nav2_takes: Callable[[Any], None],
) -> None:
    node = live.add(MapFusion, order_wait_s=60.0)
    early = live.listen(GRID, "/map", nav2_qos)
    send_in_order(live, cones)
    last = header_to_message(cones[-1][1].stamp_ns, "", TYPES).stamp
    live.until(lambda: early and early[-1].header.stamp == last)
    live.until(lambda: stands_still(live, early))
    count = node.health.total("published")
    grids = live.listen(GRID, "/map", nav2_qos)
    percents = live.listen(GRID, "/map_probability", nav2_qos)
    metadata = live.listen("nav_msgs/msg/MapMetaData", "/map_metadata", nav2_qos)
    live.until(lambda: grids and percents and metadata)
    assert node.health.total("published") == count
    assert_nav2_takes(grids[0])
    assert_nav2_takes(percents[0])
    assert set(grids[0].data) <= {-1, 0, 100}
    geometry, percent, _, _ = grid_from_message(percents[0])
    np.testing.assert_array_equal(percent, placed(offline.percent(), offline.geometry, geometry))
    assert not set(percents[0].data) <= set(grids[0].data)
    assert metadata[0] == grids[0].info


@pytest.fixture
def steps(monkeypatch: pytest.MonkeyPatch) -> dict[str, Callable[[], float | None]]:
    """Give what a session's threads would do, by name, to be done here: so it is known when."""
    found: dict[str, Callable[[], float | None]] = {}

    class Stepped:
        def __init__(
            self, node: Any, step: Callable[[], float | None], *, patience: int = 0
        ) -> None:
            found["publish" if found else "fuse"] = step

        def wake(self) -> None:
            """Nobody sleeps."""

        def stop(self) -> None:
            """Nobody works."""

    for module in ("map_session", "map_bringer"):
        monkeypatch.setattr(f"usmap_ros.nodes.plumbing.{module}.Worker", Stepped)
    return found


def test_what_nobody_listens_to_waits_until_the_map_stands_still(
    live: Any, cones: Cones, nav2_qos: Any, monkeypatch: pytest.MonkeyPatch, steps: Any
) -> None:
    made: list[int] = []
    monkeypatch.setattr("usmap_ros.nodes.plumbing.map_bringer._QUIET_S", 0.0)
    count = OccupancyMap.ambiguity_percent
    monkeypatch.setattr(
        OccupancyMap, "ambiguity_percent", lambda self: made.append(self.stamp_ns) or count(self)
    )
    node = live.add(MapFusion, order_wait_s=60.0)
    percents = live.listen(GRID, "/map_probability", nav2_qos)
    # What nobody is known to listen to yet is not published.
    live.until(lambda: node.count_subscribers("/map_probability"))
    publisher = live.publisher(CONE, "/robot1/cone", 50)
    own = [cone for topic, cone in cones if topic == "/robot1/cone"]
    for number, cone in enumerate(own[:5]):
        publisher.publish(cone_to_cdr(cone))
        live.until(lambda n=number: steps["fuse"]() or node.health.total("fused") == n + 1)
        node.session.maps.publish()
        steps["publish"]()
        # A listener of depth 1 has room for one map.
        live.until(lambda n=number: len(percents) == n + 1)
    assert made == []
    node.session.maps.publish()
    steps["publish"]()
    assert made == [own[4].stamp_ns]
    assert node.health.total("published") == 5


def test_a_map_is_put_off_while_cones_wait_but_not_for_ever(
    live: Any, cones: Cones, monkeypatch: pytest.MonkeyPatch, steps: Any
) -> None:
    clock = SimpleNamespace(monotonic=lambda: clock.now_s, now_s=0.0)
    monkeypatch.setattr("usmap_ros.nodes.plumbing.map_bringer.time", clock)
    node = add_fusion(live)
    publisher = live.publisher(CONE, "/robot1/cone", 50)
    publisher.publish(cone_to_cdr(cones[0][1]))
    live.until(lambda: steps["fuse"]() or node.health.total("fused") == 1)
    monkeypatch.setattr(LiveFusion, "is_behind", True)
    period_s = 1.0 / node.parameters.value.publish_rate_hz
    for clock.now_s in (0.0, 1.9 * period_s):
        node.session.maps.publish()
        assert steps["publish"]() is not None
        assert node.health.total("published") == 0
    clock.now_s = 2.1 * period_s
    assert steps["publish"]() is None
    assert node.health.total("published") == 1


def test_layers_are_those_of_the_pipeline(
    live: Any, cones: Cones, offline: OccupancyMap, nav2_qos: Any
) -> None:
    node = live.add(MapFusion, order_wait_s=60.0)
    clouds = live.listen("sensor_msgs/msg/PointCloud2", "/map_normals", nav2_qos)
    grids = live.listen(GRID, "/map_ambiguity", nav2_qos)
    send_in_order(live, cones)
    last = header_to_message(cones[-1][1].stamp_ns, "", TYPES).stamp
    live.until(lambda: clouds and clouds[-1].header.stamp == last)
    live.until(lambda: grids and grids[-1].header.stamp == last)
    now = node.session.fusion.occupancy_map()
    assert sorted(now.layers) == sorted(LAYERS)
    for name in LAYERS:
        np.testing.assert_array_equal(now.layers[name], offline.layers[name])
    geometry, values, _, _ = grid_from_message(grids[-1])
    np.testing.assert_array_equal(
        values, placed(offline.ambiguity_percent(), offline.geometry, geometry)
    )
    columns, frame_id, _ = points_from_message(clouds[-1])
    assert frame_id == "map"
    assert list(columns) == ["x", "y", "z", "normal_x", "normal_y", "probability"]
    assert len(columns["x"]) == np.count_nonzero(np.isfinite(offline.layers[NORMAL]))


def test_a_cloud_has_every_normal_of_a_map() -> None:
    normal_rad = np.array([[np.nan, np.pi / 2.0], [np.pi, np.nan]], np.float32)
    log_odds = np.array([[-2.0, 2.0], [1.0, -2.0]], np.float32)
    geometry = GridGeometry(0.1, (1.0, -0.2), (2, 2))
    occupancy = OccupancyMap(
        geometry, log_odds, np.ones((2, 2), bool), "map", layers={NORMAL: normal_rad}
    )
    columns = normal_columns(occupancy)
    np.testing.assert_allclose(columns["x"], [1.15, 1.05], atol=1e-6)
    np.testing.assert_allclose(columns["y"], [-0.15, -0.05], atol=1e-6)
    np.testing.assert_allclose(columns["normal_x"], [0.0, -1.0], atol=1e-6)
    np.testing.assert_allclose(columns["normal_y"], [1.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(columns["probability"], [0.881, 0.731], atol=1e-3)
    assert len(normal_columns(replace(occupancy, layers={}))["x"]) == 0


def test_two_fusions_share_an_area_and_each_ping_is_in_one_map(live: Any, cones: Cones) -> None:
    middle_m = float(np.median([cone.pose.position_m[0] for _, cone in cones]))
    west = add_fusion(live, "west", area_m=[-99.0, middle_m, -99.0, 99.0])
    east = add_fusion(live, "east", area_m=[middle_m, 99.0, -99.0, 99.0])
    publishers = {topic: live.publisher(CONE, topic, 50) for topic in sorted(dict(cones))}
    live.until(lambda: all(p.get_subscription_count() == 2 for p in publishers.values()))
    for topic, cone in cones:
        publishers[topic].publish(cone_to_cdr(cone))
    live.until(lambda: all(n.health.total("received") == len(cones) for n in (west, east)))
    live.until(lambda: west.health.total("fused") + east.health.total("fused") == len(cones))
    assert west.health.total("elsewhere") == east.health.total("fused") > 0
    maps = [node.session.fusion.occupancy_map() for node in (west, east)]
    joined = merge_maps(maps, MappingParameters())
    assert joined.observed.sum() > max(one.observed.sum() for one in maps)
    result = live.set_parameter("/west/map_fusion", "area_m", [1.0, 0.0, 0.0, 1.0])
    assert "must ascend" in result.reason


def test_nothing_is_published_while_nothing_changes(live: Any, cones: Cones, nav2_qos: Any) -> None:
    node = add_fusion(live, publish_rate_hz=50.0)
    grids = live.listen(GRID, "/map", nav2_qos)
    live.spin(0.2)
    assert grids == []
    send(live, cones)
    live.until(lambda: node.health.total("fused") == len(cones))
    live.until(lambda: grids)
    live.until(lambda: stands_still(live, grids), timeout_s=60.0)


def test_growth_never_moves_a_cell(
    live: Any,
    poles: Scenario,
    far_cones: Callable[..., list[EchoCone]],
    nav2_qos: Any,
    assert_nav2_takes: Callable[[Any], None],
) -> None:
    node = add_fusion(live, publish_rate_hz=20.0, topic_pattern="/walker/*")
    grids = live.listen(GRID, "/map", nav2_qos)
    publisher = live.publisher(CONE, "/walker/cone", 50)
    places = [(0.0, 0.0), (-7.3, 4.1), (9.9, -20.2), (31.7, 15.0)]
    for cone in far_cones(poles, places):
        publisher.publish(cone_to_cdr(cone))
        count = len(grids)
        live.until(lambda c=count: len(grids) > c)
    assert node.health.total("fused") == len(places)
    sizes = []
    for message in grids:
        assert_nav2_takes(message)
        _, values, _, _ = grid_from_message(message)
        sizes.append(values.size)
    assert sizes == sorted(sizes)
    assert sizes[-1] > sizes[0]
    before, old, _, _ = grid_from_message(grids[0])
    after, new, _, _ = grid_from_message(grids[-1])
    shift = (np.array(before.origin_m) - np.array(after.origin_m)) / 0.05
    left, top = np.rint(shift).astype(int)
    np.testing.assert_allclose(shift, (left, top), atol=1e-6)
    rows, columns = np.nonzero(old == 0)
    assert np.mean(new[rows + top, columns + left] == 0) > 0.99


def test_robots_join_and_leave(live: Any, cones: Cones) -> None:
    add_fusion(live, discovery_period_s=0.1, topic_pattern="/robot[12]/cone")
    by_topic = {topic: [c for c in cones if c[0] == topic] for topic, _ in cones}
    send(live, by_topic["/robot1/cone"])
    send(live, by_topic["/robot2/cone"])
    stranger = live.peer.create_publisher(interface_class("usmap_msgs/msg/EchoCone"),
                                          "/robot3/cone", 50)  # fmt: skip
    live.spin(0.5)
    assert stranger.get_subscription_count() == 0
    assert live.peer.count_subscribers("/robot1/cone") == 1
    assert live.peer.count_subscribers("/robot2/cone") == 1
    assert live.set_parameter("/map_fusion", "topic_pattern", "*").successful
    live.until(stranger.get_subscription_count)


def test_who_left_is_let_go_of_and_taken_up_again(live: Any, cones: Cones) -> None:
    node = add_fusion(live, discovery_period_s=0.1, absence_s=0.5)
    message_class = interface_class(CONE)
    robots = [live.peer.create_publisher(message_class, f"/r{n}/cone", 50) for n in range(5)]
    live.until(lambda: all(robot.get_subscription_count() for robot in robots))
    for robot in robots[1:]:
        live.peer.destroy_publisher(robot)
    live.until(lambda: not any(live.peer.count_subscribers(f"/r{n}/cone") for n in range(1, 5)))
    assert robots[0].get_subscription_count() == 1
    back = live.publisher(CONE, "/r1/cone", 50)
    back.publish(cone_to_cdr(cones[0][1]))
    live.until(lambda: node.health.total("received") == 1)


def test_listed_topics_are_the_only_ones(live: Any, cones: Cones) -> None:
    node = add_fusion(live, cone_topics=["/robot2/cone"])
    publisher = live.publisher(CONE, "/robot2/cone", 50)
    other = live.peer.create_publisher(interface_class("usmap_msgs/msg/EchoCone"), "/other", 50)
    publisher.publish(cone_to_cdr(cones[0][1]))
    live.until(lambda: node.health.total("fused"))
    assert other.get_subscription_count() == 0


def test_get_map_and_save_map(live: Any, cones: Cones, tmp_path: Path) -> None:
    node = add_fusion(live, save_path=str(tmp_path / "saved"))
    send(live, cones)
    grid = live.call("nav_msgs/srv/GetMap", "/map_fusion/get_map").map
    assert grid.header.frame_id == "map"
    response = live.call("std_srvs/srv/Trigger", "/map_fusion/save_map")
    assert response.success
    assert Path(response.message) == tmp_path / "saved" / "map.yaml"
    nav2_map = load_nav2_map(Path(response.message))
    assert np.nansum(nav2_map.probability > 0.65) == list(grid.data).count(100)
    occupancy, _ = load_map(tmp_path / "saved")
    np.testing.assert_array_equal(occupancy.log_odds, node.session.fusion.occupancy_map().log_odds)


def test_save_map_says_why_it_cannot(live: Any, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    add_fusion(live, save_path=str(tmp_path / "file" / "map"))
    response = live.call("std_srvs/srv/Trigger", "/map_fusion/save_map")
    assert not response.success
    assert "cannot be written" in response.message


def test_pause_and_reset(
    live: Any, cones: Cones, nav2_qos: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    node = add_fusion(live, publish_rate_hz=20.0, latency_limit_s=3600.0)
    # However busy the machine, the node is neither slow nor unheard.
    monkeypatch.setattr(node.health, "clock", lambda: 0.0)
    grids = live.listen(GRID, "/map", nav2_qos)
    own = [cone for cone in cones if cone[0] == "/robot1/cone"]
    send(live, own[:2])
    live.until(lambda: grids and 0 in grids[-1].data)
    assert node.health.report().level == Level.OK, node.health.report().message
    assert live.call("std_srvs/srv/SetBool", "/map_fusion/pause", data=True).success
    assert node.health.report().message == "nothing is mapped: paused"
    publisher = live.publisher(CONE, "/robot1/cone", 50)
    publisher.publish(cone_to_cdr(own[2][1]))
    live.until(lambda: node.health.total("paused") == 1)
    live.call("std_srvs/srv/Empty", "/map_fusion/reset")
    live.until(lambda: set(grids[-1].data) == {-1})
    assert live.call("std_srvs/srv/SetBool", "/map_fusion/pause", data=False).success
    publisher.publish(cone_to_cdr(own[2][1]))
    live.until(lambda: 0 in grids[-1].data)


def test_the_life_cycle(live: Any, cones: Cones, tmp_path: Path) -> None:
    node = add_fusion(live, autostart=False, checkpoint_path=str(tmp_path / "map"))

    def state() -> str:
        response = live.call("lifecycle_msgs/srv/GetState", "/map_fusion/get_state")
        return str(response.current_state.label)

    def change(label: str) -> bool:
        from lifecycle_msgs.msg import Transition

        return bool(
            live.call(
                "lifecycle_msgs/srv/ChangeState",
                "/map_fusion/change_state",
                transition=Transition(label=label),
            ).success
        )

    assert state() == "unconfigured"
    assert node.health.report().message == "nothing is mapped: the node is not configured"
    assert not live.call("std_srvs/srv/Trigger", "/map_fusion/save_map").success
    assert change("configure")
    assert node.health.report().message == "nothing is mapped: the node is not active"
    assert change("activate")
    assert state() == "active"
    send(live, cones[:6])
    assert change("deactivate")
    assert change("cleanup")
    assert (tmp_path / "map" / "map.npz").exists()
    assert change("configure")
    assert change("activate")
    assert live.call("nav_msgs/srv/GetMap", "/map_fusion/get_map").map.header.frame_id == "map"
    assert change("shutdown")
    assert state() == "finalized"


def test_checkpoints_are_begun_early_enough_to_be_written_within_their_period(live: Any) -> None:
    node = add_fusion(live, checkpoint_period_s=8.0)
    assert max(timer.timer_period_ns for timer in node.timers) == 6_000_000_000


def test_a_map_is_kept_and_resumed(live: Any, cones: Cones, tmp_path: Path, nav2_qos: Any) -> None:
    options = {"checkpoint_path": str(tmp_path / "map"), "checkpoint_period_s": 0.1}
    node = add_fusion(live, **options)
    send(live, cones)
    expected = node.session.fusion.occupancy_map()
    live.until((tmp_path / "map" / "map.npz").exists)
    live.remove(node)
    kept, _ = load_map(tmp_path / "map")
    np.testing.assert_array_equal(kept.log_odds, expected.log_odds)
    resumed = add_fusion(live, **options)
    grids = live.listen(GRID, "/map", nav2_qos)
    live.until(lambda: grids)
    occupancy = resumed.session.fusion.occupancy_map()
    np.testing.assert_array_equal(occupancy.observed, expected.observed)
    # Single precision, once through the scale of evidence and back.
    np.testing.assert_allclose(
        occupancy.log_odds[occupancy.observed], expected.log_odds[expected.observed], atol=1e-4
    )


def test_a_damaged_checkpoint_is_set_aside_and_mapping_begins(
    live: Any, cones: Cones, tmp_path: Path
) -> None:
    path = tmp_path / "map"
    path.mkdir()
    (path / "map.npz").write_bytes(b"PK nonsense")
    node = add_fusion(live, checkpoint_path=str(path))
    assert "set aside as map.npz.damaged-1" in node.health.reason("set aside")
    assert (path / "map.npz.damaged-1").read_bytes() == b"PK nonsense"
    send(live, cones[:3])
    live.remove(node)
    load_map(path)


def test_nobody_on_the_network_chooses_where_files_are_written(live: Any, tmp_path: Path) -> None:
    node = live.add(MapFusion, autostart=False, save_path=str(tmp_path / "saved"))
    for name in ("save_path", "checkpoint_path"):
        assert not live.set_parameter("/map_fusion", name, str(tmp_path / "elsewhere")).successful
    assert node.parameters.value.save_path == str(tmp_path / "saved")


@pytest.mark.parametrize("damage", ["another resolution", "another frame"])
def test_a_checkpoint_that_does_not_fit_is_left_alone(
    live: Any, cones: Cones, tmp_path: Path, damage: str
) -> None:
    path = tmp_path / "map"
    node = add_fusion(live, checkpoint_path=str(path))
    send(live, cones[:3])
    live.remove(node)
    content = (path / "map.npz").read_bytes()
    options: dict[str, Any] = {}
    if damage == "another resolution":
        options["mapping__resolution_m"] = 0.1
    if damage == "another frame":
        options["frame_id"] = "odom"
    node = add_fusion(live, checkpoint_path=str(path), **options)
    assert node.session is None
    report = node.health.report()
    assert report.level == Level.ERROR
    assert report.message.startswith(f"nothing is mapped: {path}")
    live.spin(0.2)
    assert (path / "map.npz").read_bytes() == content


def test_a_cone_in_another_frame_is_refused_with_the_reason(live: Any, cones: Cones) -> None:
    node = add_fusion(live, frame_id="map")
    send(live, cones[:3])
    publisher = live.publisher(CONE, "/lost/cone", 50)
    publisher.publish(cone_to_cdr(replace(cones[0][1], frame_id="elsewhere")))
    live.until(lambda: node.health.total("refused") == 1)
    reason = node.health.reason("refused")
    assert "'elsewhere'" in reason
    assert "'map'" in reason
    assert "tf2_ros" in reason
    assert node.health.total("fused") == 3


def test_a_first_cone_in_another_frame_does_not_lock_out_the_others(
    live: Any, cones: Cones
) -> None:
    node = live.add(MapFusion, order_wait_s=0.0)
    lost = live.publisher(CONE, "/lost/cone", 50)
    lost.publish(cone_to_cdr(replace(cones[0][1], frame_id="x")))
    live.until(lambda: node.health.total("fused") == 1)
    send(live, [("/robot1/cone", cone) for _, cone in later(cones, 40)])
    live.until(lambda: node.health.total("fused") == 41)
    grid = live.call("nav_msgs/srv/GetMap", "/map_fusion/get_map").map
    assert grid.header.frame_id == "map"
    assert "the map begins anew" in node.health.reason("set apart")
    assert node.health.total("set apart") == 1


def later(cones: Cones, count: int) -> Cones:
    """As many cones, five a second."""
    first = cones[0][1]
    return [
        (topic, replace(cone, stamp_ns=first.stamp_ns + number * 200_000_000))
        for number, (topic, cone) in zip(range(1, count + 1), cycle(cones), strict=False)
    ]


def test_cones_that_cannot_wait_any_longer_are_dropped_and_counted(live: Any, cones: Cones) -> None:
    node = live.add(MapFusion, queue_depth=5, order_wait_s=60.0)
    live.publisher(CONE, "/silent/cone", 50)
    publisher = live.publisher(CONE, "/robot1/cone", 50)
    for _, cone in cones[:12]:
        publisher.publish(cone_to_cdr(cone))
    live.until(lambda: node.health.total("received") == 12)
    assert node.health.total("fused") == 0
    assert live.set_parameter("/map_fusion", "order_wait_s", 0.0).successful
    live.until(lambda: node.health.total("fused") == 5)
    assert node.health.total("dropped") == 7


def test_a_silent_robot_does_not_stop_the_others(live: Any, cones: Cones) -> None:
    node = live.add(MapFusion, order_wait_s=0.1)
    live.publisher(CONE, "/silent/cone", 50)
    publisher = live.publisher(CONE, "/robot1/cone", 50)
    for number, cone in enumerate((cones[0][1], cones[3][1])):
        publisher.publish(cone_to_cdr(cone))
        live.until(lambda n=number: node.health.total("fused") == n + 1)


def test_two_reconstructors_of_a_robot_count_once(live: Any, cones: Cones) -> None:
    node = add_fusion(live)
    send(live, cones[:3])
    expected = node.session.fusion.occupancy_map()
    twin = live.publisher(CONE, "/twin/cone", 50)
    for _, cone in cones[:3]:
        twin.publish(cone_to_cdr(cone))
    live.until(lambda: node.health.total("repeated") == 3)
    assert "a second reconstructor" in node.health.reason("repeated")
    assert node.health.total("fused") == 3
    np.testing.assert_array_equal(node.session.fusion.occupancy_map().log_odds, expected.log_odds)


def stuck(cone: EchoCone, pings: int) -> Cones:
    """Give pings that all say the same, though the robot moves."""
    return [
        (
            "/robot9/cone",
            replace(
                cone, stamp_ns=cone.stamp_ns + number, pose=Pose.planar(0.1 * number, 1.0, 0.0)
            ),
        )
        for number in range(pings)
    ]


def test_a_robot_that_lies_is_named_and_left_out(live: Any, cones: Cones) -> None:
    node = live.add(MapFusion, check_period_s=0.1, order_wait_s=0.0)
    lies = stuck(next(cone for _, cone in cones if len(cone.ranges_m)), 12)
    send(live, [*cones[:3], *lies])
    live.until(lambda: "/robot9/cone stuck" in node.health.report().facts["robots"])
    report = node.health.report()
    assert report.level == Level.WARN
    assert "/robot9/cone is stuck: 100% of its pings repeat" in report.message

    assert live.set_parameter("/map_fusion", "without", ["robot9"]).successful
    live.until(lambda: "/robot9" not in node.health.report().facts["robots"])
    publisher = live.publisher(CONE, "/robot9/cone", 50)
    publisher.publish(cone_to_cdr(lies[0][1]))
    live.until(lambda: node.health.total("left out") == 1)
    send(live, cones[3:5])
    assert "stuck" not in node.health.report().message


def test_a_check_of_robots_keeps_to_its_own_thread(
    live: Any, cones: Cones, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Fusion wants the other cores."""
    monkeypatch.setattr("usmap_ros.processes.threads.available_cores", lambda: 4)
    threads = list[set[int]]()

    def findings(_: Consistency) -> Any:
        threads.append({get_ident(), *for_each(lambda _: get_ident(), range(4))})
        return {}

    monkeypatch.setattr(Consistency, "findings", findings)
    add_fusion(live, check_period_s=0.1)
    send(live, cones[:3])
    live.until(lambda: threads)
    assert len(threads[0]) == 1


def test_a_check_of_robots_ends_with_its_node(live: Any, cones: Cones) -> None:
    """Though it is in the middle of a judgement that takes long."""
    node = add_fusion(live, check_period_s=0.1)
    send(live, cones[:3])
    began = []

    def endless(meanwhile: Callable[[], None]) -> Any:
        began.append(True)
        while True:
            meanwhile()

    node.session.fusion.findings = endless
    send(live, cones[3:5])
    live.until(lambda: began)
    live.remove(node)
