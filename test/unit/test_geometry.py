"""Poses in the plane and in space."""

from dataclasses import replace

import numpy as np
import pytest

from usmap_ros.errors import MalformedMessageError
from usmap_ros.geometry import Pose


@pytest.mark.parametrize("yaw", [0.0, 1.0, -3.0, np.pi, 5.0])
def test_heading_survives_the_quaternion(yaw):
    pose = Pose.planar(1.0, 2.0, yaw, 0.5)
    pose.validate()
    assert np.exp(1j * pose.yaw_rad) == pytest.approx(np.exp(1j * yaw))
    np.testing.assert_array_equal(pose.position_m, [1.0, 2.0, 0.5])


def test_heading_is_that_of_the_x_axis_when_tilted():
    # Yaw of 0.7, then a pitch of 0.3 about the new y axis.
    yaw, pitch = 0.7, 0.3
    orientation = np.array(
        [
            -np.sin(yaw / 2) * np.sin(pitch / 2),
            np.cos(yaw / 2) * np.sin(pitch / 2),
            np.sin(yaw / 2) * np.cos(pitch / 2),
            np.cos(yaw / 2) * np.cos(pitch / 2),
        ]
    )
    assert Pose(np.zeros(3), orientation).yaw_rad == pytest.approx(yaw)


def test_planar_covariance_is_that_of_x_y_and_yaw():
    planar = np.array([[4.0, 1.0, 0.1], [1.0, 3.0, 0.2], [0.1, 0.2, 2.0]])
    pose = Pose.planar(0.0, 0.0, 0.0, planar_covariance=planar)
    np.testing.assert_array_equal(pose.planar_covariance, planar)
    assert pose.covariance[5, 5] == 2.0
    assert pose.covariance[0, 5] == 0.1
    assert not pose.covariance[2:5].any()


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"position_m": np.array([0.0, np.inf, 0.0])}, "position"),
        ({"orientation": np.array([0.0, 0.0, 0.0, np.nan])}, "orientation"),
        ({"orientation": np.zeros(4)}, "norm 0 instead of 1"),
        ({"orientation": np.array([0.0, 0.0, 0.0, 1.1])}, "orientation"),
        ({"covariance": np.full((6, 6), np.nan)}, "covariance"),
        ({"covariance": -np.eye(6)}, "negative variance"),
    ],
)
def test_impossible_poses_are_named(change, field):
    with pytest.raises(MalformedMessageError, match=field):
        replace(Pose.planar(0.0, 0.0, 0.0), **change).validate()
