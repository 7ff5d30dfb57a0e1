"""Lines of sight and clearances."""

import numpy as np
import pytest

from usmap_ros.simulation.occlusion import (
    NO_OWNER,
    hidden_by_discs,
    hidden_by_walls,
    path_wall_distances,
    point_segment_distances,
)

ORIGIN = np.zeros(2)
NOBODY = np.array([NO_OWNER])


def behind_wall(target, start, end, owner=NO_OWNER):
    ends = np.array([[start], [end]], dtype=float)
    hidden = hidden_by_walls(ORIGIN, np.array([target], dtype=float), *ends, np.array([owner]))
    return bool(hidden[0])


def test_a_wall_hides_what_is_behind_it_only():
    wall = (1, -1), (1, 1)
    assert behind_wall((2, 0), *wall)
    assert behind_wall((2, 1.9), *wall)
    assert not behind_wall((0.9, 0), *wall)
    assert not behind_wall((2, 2.1), *wall)
    assert not behind_wall((-2, 0), *wall)


def test_a_wall_does_not_hide_what_lies_on_it():
    assert not behind_wall((1.0, 0.0), (1, -1), (1, 1), owner=0)
    assert not behind_wall((1.001, 0.0), (1, -1), (1, 1), owner=0)


def test_a_wall_seen_edge_on_hides_nothing():
    assert not behind_wall((3, 0), (1, 0), (2, 0))


def test_no_line_of_sight_slips_through_where_two_walls_meet():
    starts, ends = np.array([[1.0, -1.0], [1.0, 0.0]]), np.array([[1.0, 0.0], [1.0, 1.0]])
    assert hidden_by_walls(ORIGIN, np.array([[2.0, 0.0]]), starts, ends, NOBODY)[0]


@pytest.mark.parametrize(
    ("target", "hidden"),
    [((4, 0), True), ((4, 0.9), True), ((4, 1.2), False), ((1, 0), False), ((-4, 0), False)],
)
def test_a_disc_hides_the_angles_that_it_covers(target, hidden):
    # At 2 m, with a radius of 0.5 m, it covers 14.5° either way: 1.03 m at 4 m.
    target = np.array([target], dtype=float)
    found = hidden_by_discs(ORIGIN, target, np.array([[2.0, 0.0]]), np.array([0.5]), NOBODY)
    assert found[0] == hidden


def test_a_point_hides_nothing_and_a_disc_not_its_own_front():
    center = np.array([[2.0, 0.0]])
    beyond, front = np.array([[3.0, 0.0]]), np.array([[1.5, 0.0]])
    assert not hidden_by_discs(ORIGIN, beyond, center, np.array([0.0]), NOBODY)[0]
    assert not hidden_by_discs(ORIGIN, front, center, np.array([0.5]), np.array([0]))[0]


def test_nothing_hides_nothing():
    none, targets = np.zeros((0, 2)), np.ones((3, 2))
    owners = np.full(3, NO_OWNER)
    assert not hidden_by_walls(ORIGIN, targets, none, none, owners).any()
    assert not hidden_by_discs(ORIGIN, targets, none, np.zeros(0), owners).any()
    assert hidden_by_walls(ORIGIN, none, targets, targets, np.zeros(0, dtype=int)).shape == (0,)


def test_distance_to_a_segment_is_to_its_nearest_point():
    start, end = np.array([0.0, 0.0]), np.array([2.0, 0.0])
    points = np.array([[1.0, 1.0], [-3.0, 4.0], [2.0, -2.0]])
    np.testing.assert_allclose(point_segment_distances(points, start, end), [1.0, 5.0, 2.0])
    np.testing.assert_allclose(
        point_segment_distances(points, end, end), np.hypot(*(points - end).T)
    )


def test_distance_of_a_path_from_walls():
    start, end = np.array([0.0, 0.0]), np.array([4.0, 0.0])
    starts = np.array([[1.0, -1.0], [1.0, 0.5], [5.0, 1.0], [-1.0, -1.0]])
    ends = np.array([[1.0, 1.0], [3.0, 2.0], [5.0, -1.0], [-1.0, 3.0]])
    distances = path_wall_distances(start, end, starts, ends)
    np.testing.assert_allclose(distances, [0.0, 0.5, 1.0, 1.0])
