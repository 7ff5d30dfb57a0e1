"""Fewer pings that stand for all: which they are, and that nothing gets lost by them."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from usmap_ros.mapping.joint import fewer_pings, powers
from usmap_ros.mapping.joint.field import field_around
from usmap_ros.mapping.joint.kept_pings import KeptPings
from usmap_ros.mapping.joint.powers import Powers
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

LOOKS = np.full(50, 8.0 * fewer_pings.ENOUGH_LOOKS, np.float32)


def test_all_robots_are_heard_although_they_take_turns() -> None:
    some, weights = fewer_pings.fewer_pings(np.ones(900, np.float32), LOOKS)
    assert len(some) == pytest.approx(900 / 8, rel=0.05)
    np.testing.assert_allclose(weights, 8.0)
    for robots in (2, 3, 4, 5):
        shares = np.bincount(some % robots, minlength=robots) / len(some)
        np.testing.assert_allclose(shares, 1.0 / robots, rtol=0.25)


def test_a_parked_robot_is_left_out_more_often_and_counts_the_same() -> None:
    weights = np.where(np.arange(900) % 3 == 0, 0.01, 1.0).astype(np.float32)
    some, counting = fewer_pings.fewer_pings(weights, LOOKS)
    is_parked = some % 3 == 0
    assert np.count_nonzero(is_parked) < 3
    assert counting.sum() == pytest.approx(weights.sum(), rel=0.1)


def test_nothing_is_left_out_where_cells_are_seldom_looked_at() -> None:
    weights = np.ones(60, np.float32)
    often = 100.0 * fewer_pings.ENOUGH_LOOKS
    looks = np.where(np.arange(100) < 30, fewer_pings.ENOUGH_LOOKS, often).astype(np.float32)
    for cells in (looks, looks[:0]):
        some, counting = fewer_pings.fewer_pings(weights, cells)
        assert some.tolist() == list(range(60))
        np.testing.assert_array_equal(counting, weights)


def test_cells_that_fewer_pings_did_not_look_at_are_taken_over(
    monkeypatch: pytest.MonkeyPatch, views: list[EchoCone], make_cone: Callable[..., EchoCone]
) -> None:
    """What one ping alone heard is there for all of them, whoever was left out before."""
    rare = make_cone((1.2, 0.5), x_m=1.0, y_m=3.0, yaw_rad=1.57)
    cones = [
        replace(cone, stamp_ns=10 * turn + number)
        for turn in range(6)
        for number, cone in enumerate([*views, rare] if turn == 3 else views)
    ]
    parameters, kept = MappingParameters(), KeptPings(MappingParameters())
    for cone in cones:
        kept.add(cone, "robot")
    pings = kept.pings()
    is_rare = np.array([pings.looks.numbers[row, 1] > 2.9 for row in pings.rows])
    assert np.count_nonzero(is_rare) == 1

    def without_it(weights: np.ndarray, looks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        some = np.flatnonzero(~is_rare)
        return some, weights[some]

    field = field_around(pings.looks, pings.rows, parameters.resolution_m)
    whole = Powers(pings.looks, pings.rows, pings.weights, field)
    whole.start()
    rows = np.arange(field.rows * field.columns) // field.columns
    north = np.repeat((field.first_row + rows) * parameters.resolution_m > 4.0, 4)
    assert whole.power[north].any()
    monkeypatch.setattr(powers, "fewer_pings", without_it)
    thinned = Powers(pings.looks, pings.rows, pings.weights, field)
    fewer = thinned.start()
    assert fewer is not thinned
    fewer.sweep(4)
    assert not fewer.power[north].any()
    thinned.take_over(fewer)
    assert thinned.power[north].any()
    assert (thinned.power[fewer.power > 0.0] > 0.0).all()
