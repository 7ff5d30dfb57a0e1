"""The direction that most walls of a place keep to."""

import numpy as np
import pytest

from usmap_ros.localisation.square_walls import squareness

#: Normals of a room's walls, a little off, and of one that is aslant.
ROOM_RAD = 0.3 + np.array([0.0, 0.5, 1.0, -0.5, 0.25]) * np.pi
OFF_RAD = np.array([0.004, -0.006, 0.005, -0.003, 0.0])


def test_walls_that_keep_to_a_direction_are_told_from_one_that_does_not() -> None:
    found = squareness(ROOM_RAD + OFF_RAD, 0.03)
    assert found.gain > 0.0
    assert found.shares[:4] == pytest.approx(np.ones(4), abs=0.05)
    assert found.shares[4] < 1e-6
    # From the direction that they keep to, which nobody has stated.
    assert found.off_rad[:4] == pytest.approx(OFF_RAD[:4], abs=1e-4)


def test_a_place_that_is_turned_as_a_whole_is_as_square() -> None:
    found, turned = (squareness(ROOM_RAD + OFF_RAD + turn, 0.03) for turn in (0.0, 1.1))
    assert turned.gain == pytest.approx(found.gain)
    push = found.information() @ np.ones(5)
    assert push == pytest.approx(np.zeros(5), abs=1e-6)


def test_lines_that_face_anywhere_keep_to_none() -> None:
    """Among poles chance lines up echoes."""
    for seed in range(20):
        normals_rad = np.random.default_rng(seed).uniform(-np.pi, np.pi, 12)
        assert squareness(normals_rad, 0.03).gain == 0.0


def test_one_wall_says_nothing() -> None:
    assert not squareness(np.array([0.4]), 0.03).information().any()
