"""Coordinate frames: TF where the installation has it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.time import Time

from usmap_ros.arrays import FloatArray
from usmap_ros.cone import EchoCone
from usmap_ros.errors import UsmapError
from usmap_ros.geometry import Pose
from usmap_ros.io.conversions import transform_from_message, transform_to_message
from usmap_ros.nodes.plumbing.ros_types import RosMessageTypes


class NoTransformError(UsmapError):
    """A transform that is not known, or not yet."""


def compose(outer: Pose, inner: Pose) -> Pose:
    """Pose in the frame that `outer` is given in, of what is at `inner` in `outer`'s own frame.

    The covariance of `inner` is turned along; that of `outer` is not added.
    """
    rotation = _rotation(outer.orientation)
    turn = np.kron(np.eye(2), rotation)
    return Pose(
        position_m=outer.position_m + rotation @ inner.position_m,
        orientation=_product(outer.orientation, inner.orientation),
        covariance=turn @ inner.covariance @ turn.T,
    )


def _product(first: FloatArray, second: FloatArray) -> FloatArray:
    """Quaternion of turning by `second`, then by `first`; x, y, z, w."""
    (a, b), (u, v) = (first[3], first[:3]), (second[3], second[:3])
    vector = a * v + u * b + np.cross(b, v)
    product = np.append(vector, a * u - b @ v)
    unit: FloatArray = product / np.linalg.norm(product)
    return unit


def _rotation(quaternion: FloatArray) -> FloatArray:
    """Rotation matrix of a unit quaternion."""
    x, y, z, w = quaternion / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


class Transforms:
    """What TF says, or why it says nothing.

    Parameters
    ----------
    node : Node
        Which listens to TF, if ``tf2_ros`` is installed.
    without_it : str
        What the node cannot do without it, for the log.

    Attributes
    ----------
    is_available : bool
        Whether there is TF.
    """

    def __init__(self, node: Node, without_it: str) -> None:
        try:
            import tf2_ros
        except ImportError:
            node.get_logger().info(f"tf2_ros is not installed: {without_it}")
            self.is_available = False
            return
        self.is_available = True
        self._node = node
        self._types = RosMessageTypes()
        self._errors = tf2_ros.TransformException
        self._buffer = tf2_ros.Buffer(node=node)
        self._listener = tf2_ros.TransformListener(self._buffer, node)
        self._broadcaster_class = tf2_ros.TransformBroadcaster
        self._broadcaster: Any = None

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
        return replace(cone, frame_id=frame_id, pose=compose(outer, cone.pose))

    def broadcast(self, pose: Pose, world: str, frame_id: str, stamp_ns: int) -> None:
        """Say where a frame is."""
        if self._broadcaster is None:
            self._broadcaster = self._broadcaster_class(self._node)
        message = transform_to_message(pose, world, frame_id, stamp_ns, self._types)
        self._broadcaster.sendTransform(message)
