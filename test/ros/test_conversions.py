"""What becomes a message of rclpy and comes back is the same."""

from array import array
from typing import Any

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message

from usmap_ros.errors import MalformedMessageError
from usmap_ros.grids import GridGeometry
from usmap_ros.io import conversions
from usmap_ros.nodes.plumbing.ros_types import RosMessageTypes, interface_class
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.trace import EchoTrace

TYPES = RosMessageTypes()
TRACE, CONE = map(interface_class, ("usmap_msgs/msg/EchoTrace", "usmap_msgs/msg/EchoCone"))
STAMP_NS = 1_700_000_000_123_456_789


def over_the_wire(message: Any) -> Any:
    return deserialize_message(serialize_message(message), type(message))


def assert_equal(one: Any, other: Any) -> None:
    assert type(one) is type(other)
    for name, value in vars(one).items():
        if hasattr(value, "__dataclass_fields__"):
            assert_equal(value, getattr(other, name))
        else:
            np.testing.assert_array_equal(value, getattr(other, name))


def test_traces_come_back(traces: list[tuple[str, EchoTrace]]) -> None:
    for _, trace in traces:
        message = deserialize_message(conversions.trace_to_cdr(trace), TRACE)
        assert_equal(conversions.trace_from_cdr(serialize_message(message)), trace)


def test_cones_come_back(cones: list[tuple[str, EchoCone]]) -> None:
    for _, cone in cones:
        message = deserialize_message(conversions.cone_to_cdr(cone), CONE)
        back = conversions.cone_from_cdr(serialize_message(message))
        np.testing.assert_allclose(back.residual, cone.residual, rtol=1e-6)
        np.testing.assert_allclose(back.limit_step_m, cone.limit_step_m, rtol=1e-6)
        assert_equal(back.transducer, cone.transducer)
        np.testing.assert_array_equal(back.ranges_m, cone.ranges_m)
        np.testing.assert_array_equal(back.detection_limits, cone.detection_limits)


def test_a_cone_is_small(cones: list[tuple[str, EchoCone]]) -> None:
    sizes = [len(conversions.cone_to_cdr(c)) for _, c in cones]
    assert max(sizes) < 2000


def test_grids_come_back() -> None:
    geometry = GridGeometry(0.05, (-3.2, 6.4), (3, 5))
    values = np.arange(-1, 14, dtype=np.int8).reshape(3, 5)
    message = over_the_wire(conversions.grid_to_message(geometry, values, "map", STAMP_NS, TYPES))
    back_geometry, back, frame_id, stamp_ns = conversions.grid_from_message(message)
    assert (back_geometry, frame_id, stamp_ns) == (geometry, "map", STAMP_NS)
    np.testing.assert_array_equal(back, values)
    metadata = conversions.metadata_to_message(geometry, STAMP_NS, TYPES)
    assert over_the_wire(metadata) == message.info


def test_a_grid_that_nav2_would_refuse_is_not_made() -> None:
    values = np.zeros((1, 1), dtype=np.int8)
    with pytest.raises(MalformedMessageError, match="frame_id"):
        conversions.grid_to_message(GridGeometry(0.05, (0, 0), (1, 1)), values, "", 0, TYPES)
    with pytest.raises(MalformedMessageError, match="32768"):
        conversions.metadata_to_message(GridGeometry(0.05, (0, 0), (1, 32768)), 0, TYPES)


def test_a_grid_with_cells_missing_is_refused() -> None:
    geometry = GridGeometry(0.05, (0.0, 0.0), (2, 2))
    values = np.zeros((2, 2), dtype=np.int8)
    message = conversions.grid_to_message(geometry, values, "map", 0, TYPES)
    message.data = array("b", [0, 0, 0])
    with pytest.raises(MalformedMessageError, match="data"):
        conversions.grid_from_message(message)


def test_a_large_grid_is_filled_in_bulk() -> None:
    side = 4000
    geometry = GridGeometry(0.05, (0.0, 0.0), (side, side))
    values = np.zeros((side, side), dtype=np.int8)
    made: list[Any] = []

    class Recorded(RosMessageTypes):
        def sequence(self, values: Any) -> Any:
            made.append(super().sequence(values))
            return made[-1]

    message = conversions.grid_to_message(geometry, values, "map", 0, Recorded())
    # An array.array is copied as a whole; anything else is looked at element by element.
    assert isinstance(made[0], array)
    assert len(message.data) == side * side


def test_poses_come_back_from_odometry_and_transforms() -> None:
    pose = Pose.planar(1.0, -2.0, 2.5, 0.3)
    message = over_the_wire(
        conversions.odometry_to_message(pose, "map", "base_link", STAMP_NS, TYPES)
    )
    back, stamp_ns = conversions.odometry_from_message(message)
    assert stamp_ns == STAMP_NS
    assert_equal(back, pose)
    message = over_the_wire(
        conversions.transform_to_message(pose, "map", "base_link", STAMP_NS, TYPES)
    )
    back, stamp_ns = conversions.transform_from_message(message)
    assert stamp_ns == STAMP_NS
    assert_equal(back, pose)


def test_points_come_back() -> None:
    columns = {name: np.arange(4, dtype=np.float32) + k for k, name in enumerate("xyzc")}
    message = over_the_wire(conversions.points_to_message(columns, "map", STAMP_NS, TYPES))
    back, frame_id, stamp_ns = conversions.points_from_message(message)
    assert (frame_id, stamp_ns) == ("map", STAMP_NS)
    for name, column in columns.items():
        np.testing.assert_array_equal(back[name], column)


def test_the_range_is_that_of_the_first_echo(cones: list[tuple[str, EchoCone]]) -> None:
    cone = next(c for _, c in cones if len(c.ranges_m) > 1)
    message = over_the_wire(conversions.range_to_message(cone, TYPES))
    assert message.range == cone.ranges_m[0]
    assert message.radiation_type == message.ULTRASOUND
    assert message.header.frame_id == cone.child_frame_id


def test_the_range_without_an_echo_is_exactly_the_greatest(
    cones: list[tuple[str, EchoCone]],
) -> None:
    from dataclasses import replace

    nothing = np.zeros(0, dtype=np.float32)
    cone = replace(cones[0][1], ranges_m=nothing, range_stds_m=nothing)
    message = over_the_wire(conversions.range_to_message(cone, TYPES))
    assert message.range == message.max_range


@pytest.mark.parametrize("name", ["no_such_package/msg/Thing", "std_msgs/msg/NoSuchThing"])
def test_a_type_that_is_not_there_is_named(name: str) -> None:
    with pytest.raises(ImportError, match=r"no_such_package|NoSuchThing"):
        interface_class(name)
