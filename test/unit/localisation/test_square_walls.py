"""The direction that most walls of a place keep to."""

import numpy as np
import pytest

from usmap_ros.localisation.square_walls import Squareness, squareness

#: Normals of a room's walls, a little off, and of one that is aslant.
ROOM_RAD = 0.3 + np.array([0.0, 0.5, 1.0, -0.5, 0.25]) * np.pi
OFF_RAD = np.array([0.004, -0.006, 0.005, -0.003, 0.0])


def found_in(
    normals_rad: np.ndarray, echoes: float = 60.0, stds_rad: np.ndarray | float = 0.003
) -> Squareness:
    """Of lines that have so many echoes each."""
    ones = np.ones(len(normals_rad))
    return squareness(normals_rad, echoes * ones, stds_rad * ones, 0.03)


def test_walls_that_keep_to_a_direction_are_told_from_one_that_does_not() -> None:
    found = found_in(ROOM_RAD + OFF_RAD)
    assert found.gain > 0.0
    assert found.shares[:4] == pytest.approx(np.ones(4), abs=0.05)
    assert found.shares[4] < 1e-6
    # From the direction that they keep to, which nobody has stated.
    assert found.off_rad[:4] == pytest.approx(OFF_RAD[:4], abs=1e-4)


def test_a_place_that_is_turned_as_a_whole_is_as_square() -> None:
    found, turned = (found_in(ROOM_RAD + OFF_RAD + turn) for turn in (0.0, 1.1))
    assert turned.gain == pytest.approx(found.gain)
    push = found.information() @ np.ones(5)
    assert push == pytest.approx(np.zeros(5), abs=1e-6)


def test_lines_that_face_anywhere_keep_to_none() -> None:
    """Among poles chance lines up echoes."""
    for seed in range(20):
        normals_rad = np.random.default_rng(seed).uniform(-np.pi, np.pi, 12)
        assert found_in(normals_rad).gain == 0.0


def test_one_wall_says_nothing_and_neither_do_lines_that_nobody_hears() -> None:
    assert not found_in(np.array([0.4])).information().any()
    assert not found_in(ROOM_RAD, echoes=0.0).information().any()


def test_lines_of_few_echoes_say_little() -> None:
    few, many = (found_in(ROOM_RAD + OFF_RAD, echoes) for echoes in (1.0, 60.0))
    assert few.gain < 0.2 * many.gain


def test_a_wall_that_echoes_tell_badly_may_keep_to_the_direction_though_it_seems_not_to() -> None:
    off_rad = OFF_RAD.copy()
    off_rad[3] = 0.06
    stds_rad = np.full(5, 0.003)
    sure = found_in(ROOM_RAD + off_rad, stds_rad=stds_rad)
    stds_rad[3] = 0.04
    unsure = found_in(ROOM_RAD + off_rad, stds_rad=stds_rad)
    assert sure.shares[3] < 0.05
    assert unsure.shares[3] > 0.5
    # What tells the direction is those that tell it well.
    assert unsure.off_rad[:3] == pytest.approx(sure.off_rad[:3], abs=2e-3)
