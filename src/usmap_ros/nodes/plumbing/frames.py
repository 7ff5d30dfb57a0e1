"""Coordinate frames: TF where the installation has it."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from rclpy.node import Node
from rclpy.time import Time

from usmap_ros.errors import UsmapError
from usmap_ros.io.conversions import transform_from_message, transform_to_message
from usmap_ros.nodes.plumbing.parameter_server import ParameterServer
from usmap_ros.nodes.plumbing.ros_types import RosMessageTypes
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.cone import EchoCone


class NoTransformError(UsmapError):
    """A transform that is not known, or not yet."""


class Transforms:
    """What TF says, or why it says nothing.

    Parameters
    ----------
    node : Node
        Which listens to TF, if ``tf2_ros`` is installed.
    without_it : str
        What the node cannot do without it, for the log.
    """

    def __init__(self, node: Node, without_it: str) -> None:
        try:
            import tf2_ros
        except ImportError:
            node.get_logger().info(f"tf2_ros is not installed: {without_it}")
            self.is_available = False
            return
        #: Whether there is TF.
        self.is_available = True
        self._node = node
        self._types = RosMessageTypes()
        self._errors = tf2_ros.TransformException
        self._buffer = tf2_ros.Buffer(node=node)
        self._listener = tf2_ros.TransformListener(self._buffer, node)
        self._broadcaster_class = tf2_ros.TransformBroadcaster
        self._static_broadcaster_class = tf2_ros.StaticTransformBroadcaster
        self._broadcaster: Any = None
        self._static_broadcaster: Any = None

    def require(self, parameters: ParameterServer[Any]) -> None:
        """Raise `ConfigurationError` without TF, where poses are to come from there."""
        if not self.is_available:
            raise parameters.refused(
                "pose_source", "is 'tf', and tf2_ros is not installed; 'odometry' needs no TF"
            )

    def pose_of(self, frame_id: str, world: str, stamp_ns: int | None = None) -> tuple[Pose, int]:
        """Pose of a frame in another, and its stamp; the latest if none is given.

        Raises
        ------
        NoTransformError
            If it is not known, or not yet.
        """
        if not self.is_available:
            raise NoTransformError("tf2_ros is not installed")
        try:
            message = self._buffer.lookup_transform(
                world, frame_id, Time(nanoseconds=stamp_ns or 0)
            )
        except self._errors as error:
            raise NoTransformError(str(error)) from error
        return transform_from_message(message)

    def moved(self, cone: EchoCone, frame_id: str) -> EchoCone:
        """`cone` with its pose in the frame `frame_id`.

        Raises
        ------
        NoTransformError
            If the transform at its stamp is not known, or not yet.
        """
        outer, _ = self.pose_of(cone.frame_id, frame_id, cone.stamp_ns)
        return replace(cone, frame_id=frame_id, pose=outer.compose(cone.pose))

    def broadcast(self, pose: Pose, world: str, frame_id: str, stamp_ns: int) -> None:
        """Say where a frame is now; nothing without TF."""
        if not self.is_available:
            return
        if self._broadcaster is None:
            self._broadcaster = self._broadcaster_class(self._node)
        message = transform_to_message(pose, world, frame_id, stamp_ns, self._types)
        self._broadcaster.sendTransform(message)

    def broadcast_for_good(self, frame_id: str, children: Mapping[str, Pose]) -> None:
        """Say where frames are that never move in `frame_id`; nothing without TF."""
        if not self.is_available or not children:
            return
        if self._static_broadcaster is None:
            self._static_broadcaster = self._static_broadcaster_class(self._node)
        now_ns = self._node.get_clock().now().nanoseconds
        self._static_broadcaster.sendTransform(
            [
                transform_to_message(pose, frame_id, child, now_ns, self._types)
                for child, pose in children.items()
            ]
        )
