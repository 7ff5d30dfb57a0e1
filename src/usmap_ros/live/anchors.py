"""Where robots were found to be, from which their odometry goes on."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from usmap_ros.localisation.pose_kind import robot_of
from usmap_ros.mapping.far_off import Ping
from usmap_ros.numerics.geometry import Pose, on_base


@dataclass(frozen=True)
class Anchor:
    """Where a robot was found to be at a ping, from which its odometry goes on."""

    #: As it was told, and as it was corrected.
    told: Pose
    found: Pose
    #: The frame that it was found in.
    frame_id: str

    def moved(self, ping: Ping) -> Ping:
        """A later ping of the robot, as uncertain as the anchor and the way since then."""
        topic, cone = ping
        way = self.told.inverse().compose(Pose(cone.pose.position_m, cone.pose.orientation))
        pose = on_base(self.found, way)
        # What the way from the anchor cost, in the frame it was found in; not less than nothing
        # where covariances are told without how places and headings correlate.
        until_then = on_base(self.told, way).covariance
        turn = self.found.compose(self.told.inverse())
        values, vectors = np.linalg.eigh(cone.pose.covariance - until_then)
        cost = replace(way, covariance=(vectors * np.maximum(values, 0.0)) @ vectors.T)
        covariance = pose.covariance + turn.compose(cost).covariance
        moved = Pose(pose.position_m, pose.orientation, covariance)
        return topic, replace(cone, frame_id=self.frame_id, pose=moved)


def anchored(ping: Ping, anchors: Mapping[str, Anchor]) -> Ping:
    """A ping from where its robot was found to be, if it was found."""
    anchor = anchors.get(robot_of(*ping))
    return anchor.moved(ping) if anchor else ping
