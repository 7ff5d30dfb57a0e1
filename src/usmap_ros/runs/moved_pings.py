"""Pings of a frame, and pings moved to another one than they were told in."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from usmap_ros.localisation.linked_frames import Link
from usmap_ros.mapping.far_off import Ping
from usmap_ros.numerics.geometry import Pose, on_base
from usmap_ros.runs.submaps import Way

#: How far a match may be off: x, y (m) and yaw (rad), standard deviations.
_OFF = np.array([0.1, 0.1, 0.03])


class PingsOfFrame(NamedTuple):
    """What was heard in one frame."""

    #: List of (topic, EchoCone): with poses as they were told, and as they were refined.
    told: list[Ping]
    refined: list[Ping]
    #: What pieces of ways show, by `refined`.
    ways: list[Way]

    def moved_by(self, link: Link) -> PingsOfFrame:
        """In the target of a link whose source this frame is."""
        return PingsOfFrame(
            [moved_by(ping, link) for ping in self.told],
            [moved_by(ping, link) for ping in self.refined],
            self.ways,
        )


def moved_by(ping: Ping, link: Link) -> Ping:
    """A ping of a link's source in its target."""
    x_m, y_m, yaw_rad = map(float, link.change)
    change = Pose.planar(x_m, y_m, yaw_rad, planar_covariance=np.diag(_OFF**2))
    return moved(ping, change, link.about_m, link.target)


def moved(ping: Ping, change: Pose, about_m: np.ndarray, frame_id: str) -> Ping:
    """A ping in another frame.

    Parameters
    ----------
    ping : (topic, EchoCone)
        What was heard.
    change : Pose
        Of its frame in the other one; its covariance is that at `about_m`.
    about_m : (2,) array
        In the ping's frame.
    frame_id : str
        The other frame.
    """
    topic, cone = ping
    centre = Pose.planar(float(about_m[0]), float(about_m[1]), 0.0)
    base = replace(change.compose(centre), covariance=change.covariance)
    pose = change.compose(cone.pose)
    lever = on_base(base, centre.inverse().compose(cone.pose)).covariance
    pose = Pose(pose.position_m, pose.orientation, pose.covariance + lever)
    return topic, replace(cone, frame_id=frame_id, pose=pose)
