"""Where frames were in a recording, as its odometry and TF say."""

from bisect import bisect_left
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from usmap_ros.errors import MalformedMessageError
from usmap_ros.io.conversions import odometry_from_message, transform_from_message
from usmap_ros.numerics.geometry import Pose, way_between

#: A pose is not known longer than this before or behind the nearest one that was recorded, unless
#: the frame hardly moves until the next one, as what a localisation corrects odometry by: m, rad.
_LONGEST_GAP_NS = 500_000_000
_STILL_M, _STILL_RAD = 0.1, 0.05
#: Frames from a sensor up to the world, at most: more are a circle.
_MOST_FRAMES = 32


class LocatedFrame(NamedTuple):
    """Where a frame was."""

    #: Of the frame, in `world`.
    pose: Pose
    #: The frame that no other recorded one stands above.
    world: str
    #: Of which robot it is: sensors that ride on the same moving frame share its odometry, so that
    #: what their topics and frames are called does not tell them apart.
    robot: str


@dataclass
class _Track:
    """Poses of a frame in its parent, in the order of their stamps."""

    parent: str
    is_static: bool
    stamps_ns: list[int] = field(default_factory=list)
    poses: list[Pose] = field(default_factory=list)

    def at(self, stamp_ns: int) -> Pose | None:
        """Pose at a stamp, between two that are known; None if none is near."""
        if self.is_static:
            return self.poses[-1]
        after = bisect_left(self.stamps_ns, stamp_ns)
        near = [n for n in (after - 1, after) if 0 <= n < len(self.stamps_ns)]
        if len(near) < 2 or not self._is_still(*near):
            near = [n for n in near if abs(self.stamps_ns[n] - stamp_ns) <= _LONGEST_GAP_NS]
        if not near:
            return None
        nearest = min(near, key=lambda n: abs(self.stamps_ns[n] - stamp_ns))
        pose = self.poses[nearest]
        if len(near) < 2:
            return pose
        first, last = near
        share = (stamp_ns - self.stamps_ns[first]) / (self.stamps_ns[last] - self.stamps_ns[first])
        one, other = self.poses[first], self.poses[last]
        between_m = one.position_m + share * (other.position_m - one.position_m)
        # A quaternion and its negative are the same turn.
        sign = np.copysign(1.0, one.orientation @ other.orientation)
        turned = (1.0 - share) * one.orientation + share * sign * other.orientation
        return Pose(between_m, turned / np.linalg.norm(turned), pose.covariance)

    def _is_still(self, first: int, last: int) -> bool:
        way_m, turn_rad = way_between(self.poses[first], self.poses[last])
        return way_m <= _STILL_M and turn_rad <= _STILL_RAD


class RecordedPoses:
    """Frames of a recording, each in its parent; what TF says of one goes before odometry."""

    def __init__(self) -> None:
        self._transforms: dict[str, _Track] = {}
        self._odometry: dict[str, _Track] = {}
        self._base_of: dict[str, str] = {}
        #: By robot, the frames of sensors that no transform says the place of.
        self.unplaced: dict[str, set[str]] = {}

    def add_odometry(self, topic: str, message: Any) -> None:
        """Take up a ``nav_msgs/Odometry``; messages come in the order of their stamps."""
        pose, stamp_ns = odometry_from_message(message)
        base = str(message.child_frame_id) or f"{topic}/base"
        track = self._odometry.setdefault(base, _Track(str(message.header.frame_id), False))
        _append(track, stamp_ns, pose)
        self._base_of[_namespace(topic)] = base

    def add_transforms(self, message: Any, *, is_static: bool) -> None:
        """Take up a ``tf2_msgs/TFMessage``."""
        for transform in message.transforms:
            pose, stamp_ns = transform_from_message(transform)
            parent = str(transform.header.frame_id)
            track = self._transforms.setdefault(
                str(transform.child_frame_id), _Track(parent, is_static)
            )
            _append(track, stamp_ns, pose)

    def locate(self, topic: str, frame_id: str, stamp_ns: int) -> LocatedFrame:
        """Where the frame of a message on `topic` was, and of which robot it is.

        A sensor of which no transform is known sits where its robot's odometry is.

        Raises
        ------
        MalformedMessageError
            If it is not known.
        """
        frame, found, moving = frame_id, None, ""
        is_placed = frame in self._transforms or frame in self._odometry
        if not is_placed:
            frame = self._base_above(topic)
        for _ in range(_MOST_FRAMES):
            track = self._transforms.get(frame) or self._odometry.get(frame)
            if track is None:
                break
            inner = track.at(stamp_ns)
            if inner is None:
                raise MalformedMessageError(
                    "header.stamp", f"is of a time at which it is not known where {frame!r} was"
                )
            found = inner if found is None else inner.compose(found)
            if not track.is_static:
                moving = moving or frame
            frame = track.parent
        if found is None:
            raise MalformedMessageError(
                "header.frame_id", f"is {frame_id!r}, of which neither TF nor odometry is recorded"
            )
        robot = self._robot(moving or frame, frame)
        if not is_placed:
            self.unplaced.setdefault(robot, set()).add(frame_id)
        return LocatedFrame(found, frame, robot)

    def _robot(self, base: str, world: str) -> str:
        """Name of the robot whose base moves: its frames' prefix, its topics', or the base's."""
        of_topics = (name for name, odometry_of in self._base_of.items() if odometry_of == base)
        names = (_namespace(base), _namespace(world), *of_topics, base)
        return next(name.strip("/") for name in names if name.strip("/"))

    def _base_above(self, topic: str) -> str:
        """Base frame of the robot in whose namespace a topic is; empty if there is none."""
        namespace = _namespace(topic)
        while True:
            if namespace in self._base_of:
                return self._base_of[namespace]
            if not namespace:
                return ""
            namespace = _namespace(namespace)


def _namespace(name: str) -> str:
    return name.rpartition("/")[0]


def _append(track: _Track, stamp_ns: int, pose: Pose) -> None:
    if not track.stamps_ns or stamp_ns > track.stamps_ns[-1]:
        track.stamps_ns.append(stamp_ns)
        track.poses.append(pose)
