"""Recordings of robots that measure ranges only, alone and beside others."""

from types import SimpleNamespace

import numpy as np
import pytest

from usmap_ros.errors import BagError, MalformedMessageError
from usmap_ros.io.bag_reader import BagReader
from usmap_ros.io.bag_writer import new_bag
from usmap_ros.io.conversions import odometry_to_message, transform_to_message
from usmap_ros.io.conversions.common import header_to_message
from usmap_ros.io.message_types import ODOMETRY, RANGE, TRANSFORMS, BagMessageTypes, typestore
from usmap_ros.io.recorded_poses import RecordedPoses
from usmap_ros.localisation.pose_kind import robot_of
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.range_cones import RangeReading
from usmap_ros.pings.robot_paths import RobotPaths
from usmap_ros.runs.offline import map_bag
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.simulation import hear

TYPES = BagMessageTypes()
SECOND = 1_000_000_000


def range_message(stamp_ns, range_m, frame_id="robot2/sonar"):
    return TYPES.message_class(RANGE)(
        header=header_to_message(stamp_ns, frame_id, TYPES),
        radiation_type=0,
        field_of_view=0.5,
        min_range=0.2,
        max_range=4.0,
        range=range_m,
        variance=0.0,
    )


def odometry(stamp_ns, x_m, frame_id="robot2/base", yaw_rad=0.0, world="map"):
    pose = Pose.planar(x_m, 0.0, yaw_rad)
    return odometry_to_message(pose, world, frame_id, stamp_ns, TYPES)


def mounted(stamp_ns=0):
    pose = Pose.planar(0.1, 0.0, np.pi / 2.0)
    transform = transform_to_message(pose, "robot2/base", "robot2/sonar", stamp_ns, TYPES)
    return TYPES.message_class(TRANSFORMS)(transforms=[transform])


def record(folder, messages):
    """Write (topic, type, stamp, message) entries, and traces as (topic, trace)."""
    known = set()
    with new_bag(folder) as writer:
        for entry in messages:
            if len(entry) == 2:
                writer.write_trace(*entry)
            else:
                topic, message_type, stamp_ns, message = entry
                if topic not in known:
                    definition, _ = typestore().generate_msgdef(message_type, ros_version=2)
                    writer.add_topic(topic, message_type, definition, "", [])
                    known.add(topic)
                payload = bytes(typestore().serialize_cdr(message, message_type))
                writer.write_serialized(topic, message_type, stamp_ns, payload)
    return folder


def readings(count=5, **change):
    entries = []
    for number in range(count):
        stamp_ns = SECOND + number * SECOND // 10
        entries.append(("/robot2/odom", ODOMETRY, stamp_ns, odometry(stamp_ns, 0.1 * number)))
        entries.append(("/robot2/range", RANGE, stamp_ns, range_message(stamp_ns, 1.5, **change)))
    return entries


def test_readings_become_cones_where_the_robot_was(tmp_path):
    with BagReader([record(tmp_path / "bag", readings())]) as bag:
        assert bag.range_count == 5
        cones = list(bag.range_cones())

    topic, cone = cones[3]
    assert topic == "/robot2/range"
    assert cone.pose.position_m == pytest.approx([0.3, 0.0, 0.0])
    assert cone.frame_id == "map"
    assert cone.ranges_m == pytest.approx([1.5])
    limits = cone.limit_amplitudes()
    before, behind = int((1.0 - 0.2) / 0.05), int((2.0 - 0.2) / 0.05)
    assert limits[before] < 1.0
    assert limits[behind] > 20.0


def test_mount_of_a_sensor_is_taken_from_tf(tmp_path):
    entries = [("/tf_static", TRANSFORMS, SECOND, mounted()), *readings()]
    with BagReader([record(tmp_path / "bag", entries)]) as bag:
        cone = list(bag.range_cones())[3][1]

    assert cone.pose.position_m == pytest.approx([0.4, 0.0, 0.0])
    assert cone.pose.yaw_rad == pytest.approx(np.pi / 2.0)


def test_mixed_fleet_maps_together_and_nobody_counts_twice(tmp_path):
    trace = hear([(1.5, 0.0)])
    entries = [
        ("/robot1/echo", trace),
        ("/robot1/range", RANGE, 0, range_message(0, 1.5, "robot1/sonar")),
        *readings(),
    ]
    pipeline = Pipeline()
    with BagReader([record(tmp_path / "bag", entries)]) as bag:
        run = map_bag(bag, pipeline, RobotPaths())

    assert run.pings == 6
    assert run.echoes == 6


def test_reading_of_which_nobody_knows_where_it_was_is_left_out(tmp_path):
    late = 10 * SECOND
    entries = [*readings(2), ("/robot2/range", RANGE, late, range_message(late, 1.5))]
    with BagReader([record(tmp_path / "bag", entries)]) as bag:
        assert len(list(bag.range_cones())) == 2
        assert bag.skipped.by_field == {"header.stamp": 1}


def test_recording_without_poses_is_refused(tmp_path):
    only = [entry for entry in readings() if entry[1] == RANGE]
    with (
        BagReader([record(tmp_path / "bag", only)]) as bag,
        pytest.raises(BagError, match=r"header\.frame_id \(5\)"),
    ):
        map_bag(bag, Pipeline(), RobotPaths())


@pytest.mark.parametrize("range_m", [np.nan, 0.1, -np.inf])
def test_reading_that_says_nothing_is_refused(range_m):
    reading = RangeReading(0, "sonar", 0.5, 0.2, 4.0, range_m)
    with pytest.raises(MalformedMessageError, match="range"):
        reading.cone(Pose.planar(0.0, 0.0, 0.0), "map")


@pytest.mark.parametrize("range_m", [4.0, 4.5, np.inf])
def test_reading_of_nothing_frees_the_beam(range_m):
    cone = RangeReading(0, "sonar", 0.5, 0.2, 4.0, range_m).cone(Pose.planar(0, 0, 0), "map")
    assert len(cone.ranges_m) == 0
    assert cone.limit_amplitudes().max() < 10.0


def test_poses_are_found_between_those_recorded():
    poses = RecordedPoses()
    for number in range(3):
        poses.add_odometry("/robot2/odom", odometry(number * SECOND // 10, 0.1 * number))
    pose, world, _ = poses.locate("/robot2/range", "elsewhere", SECOND // 20)

    assert pose.position_m[0] == pytest.approx(0.05)
    assert world == "map"
    circle = SimpleNamespace(transforms=[mounted().transforms[0]])
    poses.add_transforms(circle, is_static=True)
    pose = poses.locate("/robot2/range", "robot2/sonar", SECOND // 10).pose
    assert pose.position_m == pytest.approx([0.2, 0.0, 0.0])


@pytest.mark.parametrize(("moved_m", "is_known"), [(0.05, True), (1.0, False)])
def test_only_what_hardly_moves_is_known_in_a_long_gap(moved_m, is_known):
    poses = RecordedPoses()
    poses.add_odometry("/odom", odometry(0, 0.0))
    poses.add_odometry("/odom", odometry(4 * SECOND, moved_m))
    if is_known:
        pose = poses.locate("/range", "elsewhere", SECOND).pose
        assert pose.position_m[0] == pytest.approx(0.25 * moved_m)
    else:
        with pytest.raises(MalformedMessageError, match="not known where"):
            poses.locate("/range", "elsewhere", SECOND)


@pytest.mark.parametrize(("frames", "warnings"), [(("left", "right"), 1), (("front",), 0)])
def test_sensors_that_nobody_says_the_place_of_are_warned_of(tmp_path, caplog, frames, warnings):
    entries = [("/odom", ODOMETRY, SECOND, odometry(SECOND, 0.0))]
    for frame in frames:
        entries.append((f"/{frame}", RANGE, SECOND, range_message(SECOND, 1.5, frame)))
    with BagReader([record(tmp_path / "bag", entries)]) as bag:
        assert len(list(bag.range_cones())) == len(frames)
    said = [entry.getMessage() for entry in caplog.records]
    assert sum("look straight ahead" in one for one in said) == warnings


@pytest.mark.parametrize("turned_rad", [-3.0, -2.8])
def test_robot_that_turns_is_found_between_the_yaws_recorded(turned_rad):
    poses = RecordedPoses()
    poses.add_odometry("/odom", odometry(0, 0.0, yaw_rad=3.0))
    poses.add_odometry("/odom", odometry(SECOND // 10, 0.0, yaw_rad=turned_rad))
    pose = poses.locate("/range", "elsewhere", SECOND // 40).pose

    a_quarter_of_the_way = 3.0 + 0.25 * (turned_rad + 2.0 * np.pi - 3.0)
    assert np.exp(1j * pose.yaw_rad) == pytest.approx(np.exp(1j * a_quarter_of_the_way), abs=1e-3)


@pytest.mark.parametrize(
    ("base", "world", "name"),
    [
        ("base_link", "odom", "base_link"),
        ("base_link", "robot1/odom", "robot1"),
        ("robot1/base_link", "map", "robot1"),
    ],
)
def test_sensors_of_one_base_are_of_one_robot_whatever_their_topics(tmp_path, base, world, name):
    entries = []
    for side, yaw_rad in (("left", 0.5), ("right", -0.5)):
        mount = transform_to_message(Pose.planar(0.1, 0.0, yaw_rad), base, f"us/{side}", 0, TYPES)
        transforms = TYPES.message_class(TRANSFORMS)(transforms=[mount])
        entries.append(("/tf_static", TRANSFORMS, 0, transforms))
        reading = range_message(SECOND, 1.5, f"us/{side}")
        entries.append((f"/ultrasonic_{side}", RANGE, SECOND, reading))
    entries.append(("/odom", ODOMETRY, SECOND, odometry(SECOND, 0.0, base, world=world)))
    with BagReader([record(tmp_path / "bag", entries)]) as bag:
        pings = list(bag.range_cones())

    assert {robot_of(*ping) for ping in pings} == {name}
    assert len({cone.child_frame_id for _, cone in pings}) == 2
