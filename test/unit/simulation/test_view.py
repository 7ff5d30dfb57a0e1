"""What a transducer can hear of a scene."""

import numpy as np
import pytest

from usmap_ros.numerics.geometry import Pose
from usmap_ros.simulation.scene import MovingDisc
from usmap_ros.simulation.surfaces import WallSegments
from usmap_ros.simulation.view import View, targets_in_view

AHEAD = View(Pose.planar(0.0, 0.0, 0.0), np.deg2rad(40.0), 5.0)


def test_points_in_the_cone_are_heard_where_they_are(scene, points):
    targets = targets_in_view(scene(points((3, 0), (2, 1), (2, -1))), AHEAD, 0.0)
    np.testing.assert_allclose(targets.ranges_m, [3.0, np.sqrt(5.0), np.sqrt(5.0)])
    np.testing.assert_allclose(targets.bearings_rad, [0.0, np.arctan(0.5), -np.arctan(0.5)])


def test_what_is_outside_the_cone_or_too_far_is_not_heard(scene, points):
    outside = scene(points((-2, 0), (1, 1), (5.01, 0)))
    assert len(targets_in_view(outside, AHEAD, 0.0).ranges_m) == 0


def test_bearings_wrap_around(scene, points):
    view = View(Pose.planar(0.0, 0.0, np.pi - 0.1), 0.7, 5.0)
    targets = targets_in_view(scene(points((-2, -0.2))), view, 0.0)
    assert targets.bearings_rad[0] == pytest.approx(0.1 + np.arctan(0.1))


def test_a_cylinder_answers_from_its_nearest_point(scene, points):
    targets = targets_in_view(scene(points((2, 0), radius=0.3, reflectivity=0.8)), AHEAD, 0.0)
    np.testing.assert_allclose(targets.ranges_m, [1.7])
    np.testing.assert_allclose(targets.reflectivities, [0.8])


def test_inside_a_cylinder_nothing_is_heard(scene, points):
    discs = points((0.05, 0), (2, 0), radius=0.2)
    assert len(targets_in_view(scene(discs), AHEAD, 0.0).ranges_m) == 0


def test_a_smooth_wall_answers_as_a_mirror(scene, walls):
    # An image at 4 m: amplitude 1/4, as of a point target of reflectivity 1 at 2 m.
    targets = targets_in_view(scene(walls=walls((2, -1), (2, 1))), AHEAD, 0.0)
    np.testing.assert_allclose(targets.ranges_m, [2.0])
    np.testing.assert_allclose(targets.reflectivities / targets.ranges_m**2, [0.25])


def test_a_smooth_wall_is_silent_if_struck_obliquely(scene, walls):
    assert len(targets_in_view(scene(walls=walls((2, 0.5), (4, 2))), AHEAD, 0.0).ranges_m) == 0


@pytest.mark.parametrize("heard", [True, False])
def test_one_sided_walls_are_heard_from_the_front(scene, walls, rough, heard):
    corners = ((2, 1), (2, -1)) if heard is False else ((2, -1), (2, 1))
    wall = walls(*corners, surface=rough, one_sided=True)
    targets = targets_in_view(scene(walls=wall, surface=rough), AHEAD, 0.0)
    assert (len(targets.ranges_m) > 0) == heard


def test_rough_walls_follow_lamberts_law(scene, walls, rough):
    wall = walls((3, -2), (3, 2), surface=rough)
    world = scene(walls=wall, surface=rough)
    targets = targets_in_view(world, AHEAD, 0.0)
    offsets = world.scatterers.positions_m
    expected = world.scatterers.reflectivities * offsets[:, 0] / np.hypot(*offsets.T)
    assert len(expected) == len(targets.reflectivities)
    np.testing.assert_allclose(targets.reflectivities, expected)


def test_leaving_out_walls_outside_the_cone_changes_nothing(scene, rough):
    rng = np.random.default_rng(8)
    corners = rng.uniform(-6.0, 6.0, (40, 2))
    ends = corners + rng.uniform(-0.5, 0.5, (40, 2))
    wall = WallSegments.between(corners, ends, rough, one_sided=False)
    world = scene(walls=wall, surface=rough)
    for heading in np.linspace(-3.0, 3.0, 9):
        # Beyond 90° no wall is left out.
        wide = View(Pose.planar(0.0, 0.0, heading), 1.6, 5.0)
        narrow = View(Pose.planar(0.0, 0.0, heading), 0.6, 5.0)
        everything, cone = targets_in_view(world, wide, 0.0), targets_in_view(world, narrow, 0.0)
        inside = np.abs(everything.bearings_rad) <= 0.6
        np.testing.assert_array_equal(everything.ranges_m[inside], cone.ranges_m)


def test_moving_objects_are_heard_where_they_are_now(scene):
    disc = MovingDisc(waypoints_m=[(1.0, 0.0), (3.0, 0.0)], loop=False, radius_m=0.0)
    world = scene(moving=[disc])
    for time_s, range_m in [(0.0, 1.0), (2.0, 2.0), (100.0, 3.0)]:
        np.testing.assert_allclose(targets_in_view(world, AHEAD, time_s).ranges_m, [range_m])


def test_an_empty_scene_is_silent(scene):
    targets = targets_in_view(scene(), AHEAD, 0.0)
    assert targets.ranges_m.shape == targets.bearings_rad.shape == (0,)


def test_a_transducer_that_touches_something_hears_nothing_absurd(scene, points, walls):
    touching = scene(points((0, 0), (1e-9, 0)), walls((0, -1), (0, 1)))
    assert len(targets_in_view(touching, AHEAD, 0.0).ranges_m) == 0
