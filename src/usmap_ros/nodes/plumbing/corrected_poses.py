"""What map_fusion tells of corrected poses: frames of odometry on TF, and trajectories."""

import threading
from typing import Any

from usmap_ros.io.conversions import path_to_message
from usmap_ros.live.health import Health
from usmap_ros.live.interfaces import TRAJECTORIES
from usmap_ros.live.located import LocatedRobots
from usmap_ros.live.shown_frames import ShownFrames
from usmap_ros.nodes.plumbing.endpoints import advertise, every
from usmap_ros.nodes.plumbing.frames import Transforms
from usmap_ros.nodes.plumbing.ros_types import RosMessageTypes
from usmap_ros.numerics.geometry import Pose
from usmap_ros.runs.restarts import MARK

#: How often frames are told, s.
_PERIOD_S = 0.1


class CorrectedPoses:
    """Publishes where robots were found to be.

    Parameters
    ----------
    node : Node
        Whose topics they are.
    transforms : Transforms
        TF, if there is any.
    health : Health
        Is told of frames that jump.
    """

    def __init__(self, node: Any, transforms: Transforms, health: Health) -> None:
        self._node, self._transforms, self._health = node, transforms, health
        self._types = RosMessageTypes()
        self._frames, self._lock = ShownFrames(), threading.Lock()
        self._world = ""
        self._news: LocatedRobots | None = None
        self._paths: dict[str, Any] = {}
        self._timer = every(node, _PERIOD_S, self._tell)

    def update(self, located: LocatedRobots) -> None:
        """Take over what the newest map was made with; in any thread."""
        with self._lock:
            self._news, self._world = located, located.frame_id
            jumped = self._frames.aim(located.frames)
        for name in jumped:
            cause = f"{name}: the map was put together anew, and its frame has jumped"
            self._health.problem("jumped", cause)

    def destroy(self) -> None:
        """Take the topics back."""
        self._node.destroy_timer(self._timer)
        for publisher in self._paths.values():
            self._node.destroy_publisher(publisher)

    def _tell(self) -> None:
        with self._lock:
            self._frames.step(_PERIOD_S)
            shown = {name: at.copy() for name, at in self._frames.shown.items()}
            world, news, self._news = self._world, self._news, None
        now_ns = self._node.get_clock().now().nanoseconds
        for name, at in shown.items():
            x_m, y_m, yaw_rad = map(float, at)
            self._transforms.broadcast(Pose.planar(x_m, y_m, yaw_rad), world, name, now_ns)
        if news is not None:
            self._tell_ways(news)

    def _tell_ways(self, news: LocatedRobots) -> None:
        for robot, way in news.trajectories().items():
            if robot not in self._paths:
                # A restart is a way of its own; names of topics have no other signs.
                topic = f"{TRAJECTORIES.name}/{robot.strip('/').replace(MARK, '_')}"
                self._paths[robot] = advertise(self._node, TRAJECTORIES, topic)
            frame_id = news.corrected.robots[robot].frame_id
            self._paths[robot].publish(path_to_message(way, frame_id, self._types))
