"""Walls as mirrors."""

import numpy as np
import pytest

from usmap_ros.acoustics.images import Mirrors, mirrored_legs


def wall(start, end, reflectivity=0.5):
    return Mirrors(np.array([start], float), np.array([end], float), np.array([reflectivity]))


def length_m(place, legs):
    return np.hypot(*(legs.images_m[0, 0] - place))


def test_a_leg_by_a_wall_is_as_long_as_its_two_stretches():
    place, point = np.array([0.0, 0.0]), np.array([[2.0, 0.5]])
    legs = mirrored_legs(place, point, wall((-1.0, 1.0), (5.0, 1.0)))

    touch = legs.touches_m[0, 0]
    assert legs.exists[0, 0]
    assert touch[1] == pytest.approx(1.0)
    there, on = np.hypot(*(touch - place)), np.hypot(*(point[0] - touch))
    assert length_m(place, legs) == pytest.approx(there + on)


def test_it_leaves_the_wall_as_steeply_as_it_came():
    place, point = np.array([0.3, -0.2]), np.array([[1.1, 0.4]])
    mirrors = wall((-3.0, -2.0), (5.0, 4.5))
    legs = mirrored_legs(place, point, mirrors)

    touch, normal = legs.touches_m[0, 0], mirrors.normals[0]
    coming, going = touch - place, point[0] - touch
    ratio = coming @ normal / np.hypot(*coming) + going @ normal / np.hypot(*going)
    assert legs.exists[0, 0]
    assert ratio == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    ("start", "end"),
    [((3.0, 1.0), (5.0, 1.0)), ((-1.0, 0.25), (5.0, 0.25)), ((-1.0, 0.5), (5.0, 0.5))],
    ids=["too short", "between the two", "through the point"],
)
def test_no_leg_where_no_mirror_image_is_seen(start, end):
    legs = mirrored_legs(np.zeros(2), np.array([[2.0, 0.5]]), wall(start, end))
    assert not legs.exists[0, 0]


def test_either_side_of_a_wall_reflects():
    for sign in (1.0, -1.0):
        place, point = np.array([0.0, sign]), np.array([[2.0, sign]])
        assert mirrored_legs(place, point, wall((-5.0, 0.0), (5.0, 0.0))).exists[0, 0]


def test_without_walls_there_are_no_legs():
    legs = mirrored_legs(np.zeros(2), np.ones((3, 2)), Mirrors.none())
    assert legs.exists.shape == (3, 0)


def test_a_wall_hides_what_is_behind_it():
    mirrors = wall((-1.0, 1.0), (1.0, 1.0))
    points = np.array([[0.0, 0.5], [0.0, 1.05], [0.0, 2.0], [3.0, 2.0], [0.0, -2.0]])

    hidden = mirrors.hide(np.zeros(2), points, 0.1)

    assert hidden.tolist() == [False, False, True, False, False]
