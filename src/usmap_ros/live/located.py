"""Where robots were found to be by the newest map, for those who ask."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from usmap_ros.localisation.pose_kind import is_own_frame, robot_of
from usmap_ros.mapping.far_off import Ping
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.trajectory import Trajectory
from usmap_ros.runs.corrected import Corrected, RobotPoses
from usmap_ros.runs.restarts import first_name


@dataclass(frozen=True)
class LocatedRobots:
    """Where robots were found to be."""

    corrected: Corrected
    frame_id: str
    #: x, y (m) and yaw (rad) of the frame of each robot's odometry in the map's, by its name.
    frames: dict[str, FloatArray]

    def trajectories(self) -> dict[str, Trajectory]:
        """The way of each robot, or rather of its first transducer."""
        topics: dict[str, str] = {}
        poses: dict[str, list[tuple[int, Pose]]] = {}
        for topic, cone in self.corrected.pings:
            robot = robot_of(topic, cone)
            if topics.setdefault(robot, topic) == topic:
                poses.setdefault(robot, []).append((cone.stamp_ns, cone.pose))
        return {robot: Trajectory.of_poses(stamped) for robot, stamped in poses.items()}

    def states(self) -> str:
        """Which robots share the map's frame, in one line."""
        return ", ".join(f"{r} {self._state(one)}" for r, one in self.corrected.robots.items())

    def _state(self, one: RobotPoses) -> str:
        is_here = one.frame_id == self.frame_id or one.state == "lost"
        return one.state if is_here else "alone"


def locate(told: Sequence[Ping], corrected: Corrected, frame_id: str) -> LocatedRobots:
    """Where frames of odometry are in the map by the newest ping of each that is in it."""
    frames: dict[str, FloatArray] = {}
    for (_, before), (_, after) in zip(told, corrected.pings, strict=True):
        if not is_own_frame(before.frame_id):
            continue
        if after.frame_id == frame_id != before.frame_id:
            place = after.pose.compose(before.pose.inverse())
            frames[first_name(before.frame_id)] = np.array([*place.position_m[:2], place.yaw_rad])
        else:
            # Since it began anew nobody knows where it is.
            frames.pop(first_name(before.frame_id), None)
    return LocatedRobots(corrected, frame_id, frames)


def of_latest_lives(told: Sequence[Ping], found: Sequence[Ping]) -> list[bool]:
    """Which pings are of no robot that was carried off after them.

    What such a ping says stays in the map; odometry from there would lead astray.
    """
    latest = {
        robot_of(*before): robot_of(*after) for before, after in zip(told, found, strict=True)
    }
    return [
        latest[robot_of(*before)] == robot_of(*after)
        for before, after in zip(told, found, strict=True)
    ]
