"""Poses as other programs send them: ``nav_msgs/Odometry`` and TF."""

from typing import Any

import numpy as np

from usmap_ros.io.conversions.common import (
    MessageTypes,
    header_to_message,
    pose_from_message,
    pose_to_message,
    stamp_from_header,
)
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.trajectory import Trajectory


def odometry_from_message(message: Any) -> tuple[Pose, int]:
    """Pose and stamp of a ``nav_msgs/Odometry``.

    Raises
    ------
    MalformedMessageError
        If the pose cannot be one.
    """
    pose = pose_from_message(message.pose)
    pose.validate()
    return pose, stamp_from_header(message.header)


def odometry_to_message(
    pose: Pose, frame_id: str, child_frame_id: str, stamp_ns: int, types: MessageTypes
) -> Any:
    """``nav_msgs/Odometry`` of a robot at rest."""
    return types.message_class("nav_msgs/msg/Odometry")(
        header=header_to_message(stamp_ns, frame_id, types),
        child_frame_id=child_frame_id,
        pose=pose_to_message(pose, types),
        twist=types.message_class("geometry_msgs/msg/TwistWithCovariance")(
            twist=types.message_class("geometry_msgs/msg/Twist")(
                linear=_vector(types, 0.0, 0.0, 0.0), angular=_vector(types, 0.0, 0.0, 0.0)
            ),
            covariance=np.zeros(36),
        ),
    )


def transform_from_message(message: Any) -> tuple[Pose, int]:
    """Pose of the child frame, and stamp, of a ``geometry_msgs/TransformStamped``.

    Raises
    ------
    MalformedMessageError
        If the transform cannot be one.
    """
    shift, turn = message.transform.translation, message.transform.rotation
    pose = Pose(
        position_m=np.array([shift.x, shift.y, shift.z], dtype=np.float64),
        orientation=np.array([turn.x, turn.y, turn.z, turn.w], dtype=np.float64),
    )
    pose.validate()
    return pose, stamp_from_header(message.header)


def transform_to_message(
    pose: Pose, frame_id: str, child_frame_id: str, stamp_ns: int, types: MessageTypes
) -> Any:
    """``geometry_msgs/TransformStamped`` from `frame_id` to a child frame at `pose`."""
    x, y, z = (float(value) for value in pose.position_m)
    qx, qy, qz, qw = (float(value) for value in pose.orientation)
    return types.message_class("geometry_msgs/msg/TransformStamped")(
        header=header_to_message(stamp_ns, frame_id, types),
        child_frame_id=child_frame_id,
        transform=types.message_class("geometry_msgs/msg/Transform")(
            translation=_vector(types, x, y, z),
            rotation=types.message_class("geometry_msgs/msg/Quaternion")(x=qx, y=qy, z=qz, w=qw),
        ),
    )


def path_to_message(path: Trajectory, frame_id: str, types: MessageTypes) -> Any:
    """``nav_msgs/Path`` of a trajectory."""
    stamped_class = types.message_class("geometry_msgs/msg/PoseStamped")
    poses = [
        stamped_class(
            header=header_to_message(stamp_ns, frame_id, types),
            pose=pose_to_message(Pose(position_m, orientation), types).pose,
        )
        for stamp_ns, position_m, orientation in zip(
            path.stamps_ns.tolist(), path.positions_m, path.orientations, strict=True
        )
    ]
    newest_ns = int(path.stamps_ns[-1]) if len(path) else 0
    return types.message_class("nav_msgs/msg/Path")(
        header=header_to_message(newest_ns, frame_id, types), poses=poses
    )


def _vector(types: MessageTypes, x: float, y: float, z: float) -> Any:
    return types.message_class("geometry_msgs/msg/Vector3")(x=x, y=y, z=z)
