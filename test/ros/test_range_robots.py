"""Robots that measure ranges only, live."""

from typing import Any

import pytest
from rclpy.serialization import serialize_message

from usmap_ros.io.conversions import cone_from_cdr, odometry_to_message, range_to_message
from usmap_ros.nodes.cone_reconstructor import ConeReconstructor
from usmap_ros.nodes.plumbing.ros_types import RosMessageTypes
from usmap_ros.numerics.geometry import Pose

CONE, RANGE, ODOMETRY = (
    "usmap_msgs/msg/EchoCone",
    "sensor_msgs/msg/Range",
    "nav_msgs/msg/Odometry",
)
TYPES = RosMessageTypes()


def test_readings_become_cones_where_odometry_says(live: Any, cones: Any) -> None:
    node = live.add(ConeReconstructor, namespace="robot2", input="range")
    found = live.listen(CONE, "/robot2/cone", 50)
    reading = live.publisher(RANGE, "/robot2/range")
    odometry = live.publisher(ODOMETRY, "/robot2/odom")
    cone = next(one for _, one in cones if len(one.ranges_m))
    pose = Pose.planar(2.0, 1.0, 0.5)

    def heard() -> bool:
        odometry.publish(odometry_to_message(pose, "map", "base", cone.stamp_ns, TYPES))
        reading.publish(range_to_message(cone, TYPES))
        return bool(found)

    live.until(heard)
    back = cone_from_cdr(serialize_message(found[0]))
    assert back.ranges_m == pytest.approx(cone.ranges_m[:1])
    assert back.pose.position_m == pytest.approx(pose.position_m)
    assert back.frame_id == "map"
    assert node.health.total("published") >= 1


def test_reading_without_a_pose_is_counted(live: Any, cones: Any) -> None:
    node = live.add(ConeReconstructor, input="range")
    reading = live.publisher(RANGE, "/range")
    cone = next(one for _, one in cones if len(one.ranges_m))

    def told() -> bool:
        reading.publish(range_to_message(cone, TYPES))
        return bool(node.health.total("without pose"))

    live.until(told)
