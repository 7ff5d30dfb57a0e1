"""Odometry as increments between knots."""

import numpy as np
import pytest
from pings_among_poles import circle

from usmap_ros.localisation.equations import add_chain, found_spread, odometry_cost
from usmap_ros.localisation.planar import between, compose, derivatives
from usmap_ros.localisation.tracks import Track
from usmap_ros.numerics.geometry import wrapped

#: All pings of one transducer.
ONE = np.zeros(1000, np.intp)
#: Beams that are narrow, rad.
NARROW = np.full(100, 0.3)


def track(count: int = 21, **others: bool) -> Track:
    told = circle(count)
    growing = np.arange(float(count))[:, np.newaxis, np.newaxis] * np.diag([1e-4, 1e-4, 1e-3])
    return Track(np.arange(count), told, growing, ONE[:count], 8, **others)


def test_poses_are_composed_and_taken_apart() -> None:
    rng = np.random.default_rng(2)
    first, second = rng.uniform(-3.0, 3.0, (2, 50, 3))
    again = compose(first, between(first, second))
    np.testing.assert_allclose(again[:, :2], second[:, :2])
    np.testing.assert_allclose(wrapped(again[:, 2] - second[:, 2]), 0.0, atol=1e-12)


def test_derivatives_are_those_of_small_changes() -> None:
    rng = np.random.default_rng(3)
    both = rng.uniform(-1.0, 1.0, 6)
    change = derivatives(both[np.newaxis, :3], both[np.newaxis, 3:])[0]
    for column in range(6):
        moved = both.copy()
        moved[column] += 1e-6
        difference = between(moved[:3], moved[3:]) - between(both[:3], both[3:])
        np.testing.assert_allclose(difference / 1e-6, change[:, column], atol=1e-5)


def test_knots_as_told_leave_all_poses_as_told() -> None:
    one = track()
    assert one.knots.tolist() == [0, 8, 16, 20]
    np.testing.assert_allclose(one.poses(one.told[one.knots])[:, :2], one.told[:, :2], atol=1e-12)
    assert odometry_cost(one, one.told[one.knots]) == pytest.approx(0.0, abs=1e-9)


def test_all_moved_together_keeps_every_increment() -> None:
    one = track()
    moved = compose(np.array([[0.5, -0.3, 0.8]]), one.told)
    np.testing.assert_allclose(one.poses(moved[one.knots])[:, :2], moved[:, :2], atol=1e-9)


def test_what_knots_are_off_is_shared_out_along_the_way() -> None:
    one = track()
    knots = one.told[one.knots].copy()
    knots[1, 0] += 0.08
    off_m = (one.poses(knots) - one.told)[:, 0]
    np.testing.assert_allclose(off_m[:9], np.linspace(0.0, 0.08, 9), atol=1e-9)


def test_a_robot_that_stands_errs_only_where_it_goes_on() -> None:
    told = np.zeros((9, 3))
    told[5:, 0] = 1.0
    one = Track(np.arange(9), told, np.zeros((9, 3, 3)), ONE[:9], 8)
    off_m = (one.poses(np.array([[0.0, 0.0, 0.0], [1.2, 0.0, 0.0]])) - told)[:, 0]
    np.testing.assert_allclose(off_m, [0.0] * 5 + [0.2] * 4, atol=1e-3)


def test_a_way_is_that_of_the_robot_and_not_from_one_transducer_to_the_other() -> None:
    # Two of them, 0.2 m from each other, in turn, on a robot that goes 0.1 m a ping.
    transducers = np.arange(9) % 2
    told = np.zeros((9, 3))
    told[:, 0] = 0.1 * np.arange(9) + 0.2 * transducers
    one = Track(np.arange(9), told, np.zeros((9, 3, 3)), transducers, 8)
    assert one.along_m[-1] == pytest.approx(0.8)
    np.testing.assert_allclose(one.looks(NARROW[:9]), 1.0)


def test_odometry_alone_is_solved_to_itself() -> None:
    one = track()
    rng = np.random.default_rng(4)
    knots = one.told[one.knots] + 0.02 * rng.standard_normal((4, 3))
    for _ in range(4):
        full, right = np.zeros((12, 12)), np.zeros(12)
        add_chain(one, knots, full, right, 0)
        knots += np.linalg.solve(full, right).reshape(4, 3)
    np.testing.assert_allclose(knots, one.told[one.knots], atol=1e-6)


def test_a_robot_that_parks_looks_once() -> None:
    told = np.zeros((10, 3))
    told[5:, 0] = np.arange(1, 6)
    parked = Track(np.arange(10), told, np.zeros((10, 3, 3)), ONE[:10], 4)
    np.testing.assert_allclose(parked.looks(NARROW[:10]), [0.2] * 5 + [1.0] * 5)


def test_beams_that_overlap_at_one_place_are_one_look_by_what_they_share() -> None:
    # Four sensors at once, a quarter of a turn from each other, and each time a fifth one that
    # looks where the first one does.
    transducers = np.tile(np.arange(5), 3)
    told = np.zeros((15, 3))
    told[:, 0] = np.repeat(0.3 * np.arange(3), 5)
    told[:, 2] = np.tile([0.1, 1.7, 3.2, -1.5, 0.1], 3)
    one = Track(np.arange(15), told, np.zeros((15, 3, 3)), transducers, 4)
    np.testing.assert_allclose(one.looks(NARROW[:15]), [0.5, 1.0, 1.0, 1.0, 0.5] * 3)
    # Beams so wide that neighbours' halves overlap share half of what they hear.
    told[:, 2] = np.tile(np.deg2rad([-60.0, -30.0, 0.0, 30.0, 60.0]), 3) + 0.01
    wide = Track(np.arange(15), told, np.zeros((15, 3, 3)), transducers, 4)
    looks = wide.looks(np.full(15, np.deg2rad(30.0)))
    np.testing.assert_allclose(looks[:5], [2 / 3, 0.5, 0.5, 0.5, 2 / 3])


def test_knots_are_as_far_apart_as_odometry_errs_over() -> None:
    # Eleven sensors that measure at once, each decimetre.
    told = np.zeros((110, 3))
    told[:, 0] = np.repeat(0.1 * np.arange(10), 11)
    transducers = np.tile(np.arange(11), 10)
    one = Track(np.arange(110), told, np.zeros((110, 3, 3)), transducers, 8)
    np.testing.assert_allclose(np.diff(one.along_m[one.knots])[:-1], 0.4)


def test_odometry_is_weighed_by_how_far_echoes_have_it_off() -> None:
    rng = np.random.default_rng(5)
    one = track(801)
    stds = 1.0 / np.sqrt(np.diagonal(one.informations, axis1=1, axis2=2))
    # Headings are a fifth as far off as stated, places as much as stated; and echoes tell all.
    knots = [one.told[0]]
    for step, std in zip(one.increments, stds, strict=True):
        knots.append(compose(knots[-1], step + std * [1.0, 1.0, 0.2] * rng.standard_normal(3)))
    known = np.zeros((len(knots) - 1, 6, 6))
    found = found_spread(one, np.array(knots), known)
    np.testing.assert_allclose(found, [1.0, 1.0, 0.25], atol=0.15)
    # Echoes that say nothing leave what is stated.
    chance = np.linalg.inv(one.informations)
    known[:, 3:, 3:] = 4.0 * chance
    np.testing.assert_allclose(found_spread(one, one.told[one.knots], known), 1.0)


def test_without_covariances_wheels_are_as_wheels_usually_are() -> None:
    exact = Track(np.arange(9), circle(9), np.zeros((9, 3, 3)), ONE[:9], 8)
    way_m = float(np.hypot(*np.diff(exact.told[:, :2], axis=0).T).sum())
    turn_std_rad = 1.0 / np.sqrt(exact.informations[0, 2, 2])
    assert turn_std_rad == pytest.approx(0.026 * np.sqrt(way_m), rel=0.3)


def test_variances_without_correlation_say_how_headings_drift_and_not_more() -> None:
    # Straight on for 30 m: what is off in heading by 0.01 rad a step takes places along, of which
    # a driver that states variances alone says nothing.
    count, turn_rad, step_m = 61, 0.01, 0.5
    told = np.column_stack([step_m * np.arange(count), np.zeros(count), np.zeros(count)])
    known = [np.zeros((3, 3))]
    carry = np.eye(3)
    carry[1, 2] = step_m
    for _ in range(count - 1):
        known.append(carry @ known[-1] @ carry.T + np.diag([1e-4, 1e-4, turn_rad**2]))
    whole = np.array(known)
    alone = whole * np.eye(3)
    alone[:, 0, 0] = alone[:, 1, 1] = 0.5 * (whole[:, 0, 0] + whole[:, 1, 1])
    for covariances in (whole, alone):
        one = Track(np.arange(count), told, covariances, np.zeros(count, np.intp), 1)
        stds = np.sqrt(np.diagonal(np.linalg.inv(one.informations), axis1=1, axis2=2))
        assert stds[:, 2].max() < 1.2 * turn_rad
        assert stds[:, :2].max() < 0.02
