"""Walls may be short beyond a door, and in a recess; elsewhere room tells of them."""

import math
from dataclasses import replace

import numpy as np
import pytest

from usmap_ros.mapping.joint.free_space.recesses import DEEPEST_M, may_be_short
from usmap_ros.mapping.joint.surfaces.mirrors import MirrorWall
from usmap_ros.mapping.joint.visibility.field import Field

FIELD = Field(0, 0, 80, 80, 0.05)
EVERYWHERE = np.ones(FIELD.shape, bool)
NOBODY = np.zeros(0, np.int64)
#: Ahead of robots that look up, 2 m away.
WALL = MirrorWall(0.5 * math.pi, 2.0, -2.0, 0.0, NOBODY, NOBODY, 0.0, 0.0, 0.0, 0.01, 9.0)
UP, RIGHT = 0.5 * math.pi, 0.0


def test_a_wall_goes_on_in_its_line_beyond_a_door() -> None:
    may = may_be_short(FIELD, [WALL], UP, EVERYWHERE)
    assert may[39:41].all()
    assert not may[:38].any()
    assert not may[42:].any()
    np.testing.assert_array_equal(may, may_be_short(FIELD, [WALL], UP + math.pi, EVERYWHERE))
    assert not may_be_short(FIELD, [WALL], RIGHT, EVERYWHERE).any()


@pytest.mark.parametrize("step_m", [0.8, 0.1, DEEPEST_M + 0.1])
def test_a_recess_has_sides(step_m: float) -> None:
    """Beside an alcove whose side nobody struck, 0.9 m² of what is behind it were free."""
    behind = replace(WALL, distance_m=WALL.distance_m + step_m)
    may = may_be_short(FIELD, [WALL, behind], RIGHT, EVERYWHERE)
    assert may[41:55].all() == (step_m == 0.8)
    assert may.any() == (step_m == 0.8)
    assert not may[:40].any()
    assert not may[57:].any()


def test_walls_that_face_each_other_have_no_side_between_them() -> None:
    opposite = replace(WALL, normal_rad=-UP, distance_m=2.6)
    assert not may_be_short(FIELD, [WALL, opposite], RIGHT, EVERYWHERE).any()


def test_nothing_is_said_of_cells_that_are_not_asked_for() -> None:
    asked = EVERYWHERE.copy()
    asked[:, :40] = False
    may = may_be_short(FIELD, [WALL], UP, asked)
    assert not may[:, :40].any()
    assert may[40, 40:].all()
