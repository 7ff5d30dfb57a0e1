"""Cones of readings of a sensor that measures a range only."""

from rclpy.node import Node
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Range

from usmap_ros.io.conversions import range_from_message
from usmap_ros.live.health import Health
from usmap_ros.nodes.plumbing.frames import NoTransformError, Transforms
from usmap_ros.nodes.plumbing.pose_sources import NoPoseError, OdometryPose
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters.nodes import ConeReconstructorParameters
from usmap_ros.pings.cone import EchoCone


class RangeInput:
    """Knows where a robot's range sensors are.

    Parameters
    ----------
    node : Node
        Which receives readings.
    health : Health
        Counts what is no odometry.
    parameters : ConeReconstructorParameters
        Where poses come from.
    """

    def __init__(self, node: Node, health: Health, parameters: ConeReconstructorParameters) -> None:
        self._node, self._world = node, parameters.world_frame
        self._transforms: Transforms | None = None
        if parameters.pose_source == "tf":
            self._transforms = Transforms(node, "ranges have no poses; 'odometry' needs no TF")
        # Its topic costs nothing where TF says it all.
        self._odometry = OdometryPose(node, health, parameters.pose_timeout_s)

    def cone(self, payload: bytes) -> EchoCone:
        """Cone of a serialized ``sensor_msgs/Range``.

        Raises
        ------
        MalformedMessageError
            If it says nothing.
        NoPoseError
            If it is not known where the sensor was.
        """
        reading = range_from_message(deserialize_message(payload, Range))
        return reading.cone(self._pose(reading.frame_id, reading.stamp_ns), self._world)

    def _pose(self, frame_id: str, stamp_ns: int) -> Pose:
        if self._transforms is None:
            return self._odometry.sample(stamp_ns, 0.0)[0]
        try:
            return self._transforms.pose_of(frame_id, self._world, stamp_ns)[0]
        except NoTransformError as error:
            raise NoPoseError(f"{frame_id} in {self._world}: {error}") from error
