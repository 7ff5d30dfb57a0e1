"""What reported poses are worth."""

from dataclasses import replace

import numpy as np
import pytest
from pings_among_poles import cone

from usmap_ros.localisation.pose_kind import PoseKind, is_own_frame, pose_kind, robot_of
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.cone import EchoCone


def pings(variances: list[float], yaw_variances: list[float]) -> list[EchoCone]:
    return [
        cone(Pose.planar(0.1 * n, 0.0, 0.0, planar_covariance=np.diag([v, v, y])), stamp_ns=n)
        for n, (v, y) in enumerate(zip(variances, yaw_variances, strict=True))
    ]


@pytest.mark.parametrize(
    ("variances", "yaw_variances", "kind"),
    [
        ([0.0] * 5, [0.0] * 5, PoseKind.ABSOLUTE),
        ([9e-4] * 5, [1e-4] * 5, PoseKind.NOISY),
        ([4e-5] * 5, [1e-4] * 5, PoseKind.ABSOLUTE),
        # Nobody knows where such a robot is; echoes would be taken for those of anything.
        ([0.25] * 5, [1e-4] * 5, PoseKind.ABSOLUTE),
        ([0.0, 1e-4, 2e-4, 4e-4], [0.0] * 4, PoseKind.ODOMETRY),
        ([0.0] * 4, [0.0, 1e-4, 2e-4, 3e-4], PoseKind.ODOMETRY),
        # A filter that is surer now and then.
        ([1e-3, 9e-3, 1e-3, 8e-3, 5e-3], [1e-4] * 5, PoseKind.NOISY),
        # Odometry that turns back towards its start loses a little.
        ([0.0, 4e-4, 9e-4, 8.6e-4, 2e-3], [0.0, 1e-4, 2e-4, 3e-4, 4e-4], PoseKind.ODOMETRY),
        ([], [], PoseKind.ABSOLUTE),
    ],
)
def test_covariances_tell(
    variances: list[float], yaw_variances: list[float], kind: PoseKind
) -> None:
    assert pose_kind(pings(variances, yaw_variances)) is kind


def test_a_robots_own_frame_has_no_start() -> None:
    own = [replace(one, frame_id="robot1/odom") for one in pings([0.0] * 3, [0.0] * 3)]
    assert pose_kind(own) is PoseKind.ODOMETRY_FROM_ANYWHERE


@pytest.mark.parametrize(
    ("frame", "is_own"), [("odom", True), ("a/odom", True), ("odometry/map", False), ("map", False)]
)
def test_names_of_own_frames(frame: str, is_own: bool) -> None:
    assert is_own_frame(frame) is is_own


@pytest.mark.parametrize(
    ("topic", "frame", "robot"),
    [("/a/left/echo", "a/left", "a"), ("/a/echo", "sonar", "/a"), ("/echo", "", "/echo")],
)
def test_transducers_of_a_robot_belong_together(topic: str, frame: str, robot: str) -> None:
    one = replace(cone(Pose.planar(0.0, 0.0, 0.0)), child_frame_id=frame)
    assert robot_of(topic, one) == robot
