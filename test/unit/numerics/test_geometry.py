"""Poses in the plane and in space."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from usmap_ros.errors import MalformedMessageError
from usmap_ros.numerics.geometry import Pose, way_between, wrapped


@pytest.mark.parametrize("yaw", [0.0, 1.0, -3.0, np.pi, 5.0])
def test_heading_survives_the_quaternion(yaw):
    pose = Pose.planar(1.0, 2.0, yaw, 0.5)
    pose.validate()
    assert np.exp(1j * pose.yaw_rad) == pytest.approx(np.exp(1j * yaw))
    np.testing.assert_array_equal(pose.position_m, [1.0, 2.0, 0.5])


@pytest.mark.parametrize(
    "angles_rad", [(0.0, 0.0, 0.0), (-2.0, 0.0, 0.0), (0.7, 1.2, -2.5), (5.0, -1.5, 3.0)]
)
def test_turns_are_about_the_poses_own_axes_one_after_the_other(angles_rad):
    pose = Pose.turned(np.zeros(3), *angles_rad)
    pose.validate()
    turn = Rotation.from_euler("ZYX", angles_rad).as_matrix()
    np.testing.assert_allclose(pose.rotation, turn, atol=1e-12)


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


def test_poses_are_composed_as_transforms_are():
    outer = Pose.planar(1.0, 2.0, np.pi / 2, 0.5)
    inner = Pose.planar(3.0, 0.0, 0.25, planar_covariance=np.diag([0.04, 0.01, 0.001]))
    pose = outer.compose(inner)
    np.testing.assert_allclose(pose.position_m, [1.0, 5.0, 0.5], atol=1e-12)
    assert pose.yaw_rad == pytest.approx(np.pi / 2 + 0.25)
    np.testing.assert_allclose(pose.planar_covariance, np.diag([0.01, 0.04, 0.001]), atol=1e-12)


def test_a_mount_turns_with_its_robot():
    pose = Pose.planar(1.0, 2.0, np.pi / 2).compose(Pose.planar(0.2, 0.1, np.pi / 2, 0.4))
    np.testing.assert_allclose(pose.position_m, [0.9, 2.2, 0.4])
    assert abs(pose.yaw_rad) == pytest.approx(np.pi)


def tilted(yaw, pitch, roll=0.0):
    """Pose of a transducer that was turned by yaw, then pitched down, then rolled."""
    turn = Rotation.from_euler("ZYX", [yaw, pitch, roll])
    return Pose(np.array([1.0, -2.0, 0.5]), turn.as_quat())


def test_points_in_the_plane_have_range_and_bearing():
    ranges_m, bearings_rad = Pose.planar(1.0, -2.0, 2.5, 0.7).polar(
        np.array([[1.0 + 2.0 * np.cos(3.0), -2.0 + 2.0 * np.sin(3.0)], [1.0, -2.0]])
    )
    np.testing.assert_allclose(ranges_m, [2.0, 0.0])
    assert bearings_rad[0] == pytest.approx(0.5)


def test_points_behind_have_bearings_up_to_half_a_turn():
    _, bearings_rad = Pose.planar(0.0, 0.0, np.pi - 0.1).polar(np.array([[-2.0, -0.2]]))
    assert bearings_rad[0] == pytest.approx(0.1 + np.arctan(0.1))


@pytest.mark.parametrize("roll", [0.0, 1.0])
def test_a_tilted_transducer_sees_points_off_its_axis(roll):
    """Looking down by 0.3, one ahead at the same height is 0.3 off the axis, whatever the roll."""
    pose = tilted(0.8, 0.3, roll)
    ahead = pose.position_m + 2.0 * np.array([np.cos(0.8), np.sin(0.8), 0.0])
    for point in (ahead, ahead[:2]):
        range_m, bearing_rad = pose.polar(point)
        assert range_m == pytest.approx(2.0)
        assert abs(bearing_rad) == pytest.approx(0.3)
    on_axis = pose.position_m + 2.0 * pose.rotation @ [1.0, 0.0, 0.0]
    assert pose.polar(on_axis)[1] == pytest.approx(0.0, abs=1e-12)


def test_a_point_above_is_off_the_axis_by_its_elevation():
    range_m, bearing_rad = Pose.planar(0.0, 0.0, 0.0, 0.5).polar(np.array([3.0, 0.0, 3.5]))
    assert range_m == pytest.approx(3.0 * np.sqrt(2.0))
    assert bearing_rad == pytest.approx(np.pi / 4.0)


def test_a_pose_within_a_tilted_one_sees_what_stands_before_both():
    outer, inner = tilted(0.4, -0.2, 0.3), tilted(-1.0, 0.5)
    point = np.array([0.3, 1.2, -0.4])
    seen = outer.compose(inner).polar(outer.position_m + outer.rotation @ point)
    assert seen == pytest.approx(inner.polar(point))


def test_a_pose_undoes_its_inverse():
    orientation = Rotation.from_euler("ZYX", [0.7, -0.4, 0.2]).as_quat()
    pose = Pose(np.array([1.0, -2.0, 0.5]), orientation)

    for both in (pose.compose(pose.inverse()), pose.inverse().compose(pose)):
        np.testing.assert_allclose(both.position_m, 0.0, atol=1e-12)
        np.testing.assert_allclose(both.rotation, np.eye(3), atol=1e-12)


def test_turns_are_those_of_scipy():
    orientations = Rotation.random(20, random_state=np.random.default_rng(3)).as_quat()
    for first, second in pairwise(orientations):
        inner, outer = Pose(np.zeros(3), 1.001 * first), Pose(np.zeros(3), 0.999 * second)
        both = Rotation.from_quat(second) * Rotation.from_quat(first)
        np.testing.assert_allclose(inner.rotation, Rotation.from_quat(first).as_matrix())
        np.testing.assert_allclose(outer.compose(inner).rotation, both.as_matrix(), atol=1e-14)
        ahead_x, ahead_y, _ = Rotation.from_quat(first).apply([1.0, 0.0, 0.0])
        assert inner.yaw_rad == pytest.approx(np.arctan2(ahead_y, ahead_x))


def test_the_way_between_poses_turns_the_short_way_round():
    near = Pose.planar(1.0, 2.0, 3.1), Pose.planar(4.0, 6.0, -3.1, z_m=7.0)

    way_m, turn_rad = way_between(*near)

    assert way_m == pytest.approx(5.0)
    assert turn_rad == pytest.approx(2.0 * np.pi - 6.2)
    assert np.abs(wrapped(np.array([-6.2, 6.2]))) == pytest.approx(turn_rad)
