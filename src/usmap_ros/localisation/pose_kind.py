"""What reported poses are worth: absolute, or odometry, which drifts."""

from collections.abc import Sequence
from enum import Enum

import numpy as np

from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.pings.cone import EchoCone

#: Odometry's variances end at least so many times as large as they begin, and at least so large.
_GROWTH, _LEAST_M, _LEAST_RAD = 4.0, 0.005, 0.002
#: Absolute places that are off by so much, m, standard deviation, are corrected, each by what it
#: hears: what is less, ranges are off, too, and what is more leaves open which echo is of what.
_NOISY_M = (0.01, 0.1)
#: Share of pings over which a variance that grows may fall, from rounding or from a turn.
_MAY_FALL = 0.1


class PoseKind(Enum):
    """What reported poses are."""

    #: Of motion capture or a localisation: each is as good as its covariance says.
    ABSOLUTE = "absolute"
    #: The same, each off by chance and by so much that echoes tell where it was.
    NOISY = "absolute, off by chance"
    #: Of wheels from a start that is known: the place drifts, changes are good.
    ODOMETRY = "odometry"
    #: The same from a start that nobody has stated.
    ODOMETRY_FROM_ANYWHERE = "odometry from anywhere"
    #: Steady covariances, of which a user knows better that poses drift.
    INSISTED = "odometry, as insisted on"

    @property
    def must_correct(self) -> bool:
        """Whether poses are not right as told: they drift, or are off by chance."""
        return self is not PoseKind.ABSOLUTE

    @property
    def drifts(self) -> bool:
        """Whether changes are known better than places."""
        return self.must_correct and self is not PoseKind.NOISY


def robot_of(topic: str, cone: EchoCone) -> str:
    """Which robot a ping is of: transducers of one robot share its odometry."""
    return cone.child_frame_id.rpartition("/")[0] or topic.rpartition("/")[0] or topic


def is_own_frame(frame_id: str) -> bool:
    """Whether a frame is a robot's own odometry frame (REP 105): ``ROBOT/odom``."""
    return frame_id.rpartition("/")[2].startswith("odom")


def pose_kind(cones: Sequence[EchoCone]) -> PoseKind:
    """What the poses of a robot's pings are.

    Parameters
    ----------
    cones : sequence of EchoCone
        Of one robot, in the order of their stamps.

    Returns
    -------
    PoseKind
        By the frame, by whether the covariance grows along the way, and by how large it is.
    """
    if cones and is_own_frame(cones[0].frame_id):
        return PoseKind.ODOMETRY_FROM_ANYWHERE
    covariances = np.array([one.pose.planar_covariance for one in cones]).reshape(-1, 3, 3)
    places_m2 = covariances[:, 0, 0] + covariances[:, 1, 1]
    if _grows(places_m2, _LEAST_M**2) or _grows(covariances[:, 2, 2], _LEAST_RAD**2):
        return PoseKind.ODOMETRY
    least_m, most_m = _NOISY_M
    is_noisy = len(cones) and least_m <= float(np.sqrt(0.5 * places_m2.mean())) <= most_m
    return PoseKind.NOISY if is_noisy else PoseKind.ABSOLUTE


def _grows(variances: FloatArray, least: float) -> bool:
    """Whether variances grow from ping to ping, and not only differ."""
    if len(variances) < 2:
        return False
    steps = np.diff(variances)
    falls = float(-steps[steps < 0.0].sum())
    gained = float(variances[-1] - variances[0])
    is_larger = variances[-1] > _GROWTH * variances[0] + least
    return bool(is_larger and falls <= _MAY_FALL * gained)
