"""Which of several smooth walls counts, and how they face."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from usmap_ros.mapping.joint.surfaces.mirrors import (
    NEAR_MEDIAN_RAD,
    UNSURE_M,
    MirrorWall,
    facing_usually,
    squared,
    turns_to,
    usual_direction,
    without_doubles,
)
from usmap_ros.mapping.joint.visibility.echoes import Echoes
from usmap_ros.numerics.arrays import FloatArray

HITS = 12


def wall(
    normal_rad: float, distance_m: float = 2.0, hits: int = HITS, before: float = 0.0
) -> MirrorWall:
    """A smooth wall of a metre."""
    own = np.arange(hits)
    return MirrorWall(normal_rad, distance_m, 0.0, 1.0, own, own, 0.5, before, -0.5, 0.05, 9.0)


def heard(normal_rad: float, stretch_m: float) -> tuple[MirrorWall, FloatArray, Echoes]:
    """A wall 2 m from robots that struck it along a stretch, with where they were, and echoes."""
    along_m = np.linspace(0.0, stretch_m, HITS)
    places_m = along_m[:, np.newaxis] * [-math.sin(normal_rad), math.cos(normal_rad)]
    echoes = Echoes(np.arange(HITS + 1), np.full(HITS, 2.0), np.full(HITS, 0.1))
    own = np.arange(HITS)
    struck = MirrorWall(normal_rad, 2.0, 0.0, stretch_m, own, own, 0.5, 0.0, -0.5, 0.05, 9.0)
    return struck, places_m, echoes


def test_of_two_lines_beside_each_other_the_one_that_is_heard_first_is_the_wall() -> None:
    """A burst rings on, and the floor returns some: what came behind was heard a little oftener."""
    first, behind = wall(0.0, 2.0, hits=39), wall(0.0, 2.08, hits=42, before=1.1)
    assert without_doubles([behind, first]) == [first]


def test_what_is_heard_far_oftener_is_the_wall_though_more_comes_before_it() -> None:
    few, many = wall(0.0, 2.0, hits=6), wall(0.0, 2.08, hits=42, before=1.1)
    assert without_doubles([few, many]) == [many]


@given(turn_rad=st.floats(-3.0, 3.0), askew_rad=st.floats(0.03, 0.048))
def test_what_is_a_little_askew_turns_no_others(turn_rad: float, askew_rad: float) -> None:
    normals_rad = turn_rad + np.array([0.0, 0.5 * math.pi, math.pi, askew_rad])
    usual_rad = usual_direction(normals_rad, np.ones(4), np.ones(4))
    assert turns_to(usual_rad, normals_rad[:1]) == pytest.approx(0.0, abs=1e-9)


def test_a_long_wall_tells_more_of_the_usual_direction_than_a_short_one() -> None:
    """As much as both together do, had they one direction and a distance each."""
    usual_rad = usual_direction(np.array([0.0, 0.02]), np.array([3.0, 1.0]), np.ones(2))
    assert usual_rad == pytest.approx(0.02 / 10.0)


def test_walls_that_are_parallel_or_square_to_most_face_usually() -> None:
    walls = [wall(0.0), wall(0.5 * math.pi), wall(2.0 * NEAR_MEDIAN_RAD), wall(1.0)]
    assert facing_usually(walls) == walls[:2]
    assert facing_usually([]) == []


@pytest.mark.parametrize(("stretch_m", "is_turned"), [(0.5, True), (3.0, False)])
def test_a_wall_faces_as_most_do_if_its_feet_are_too_close_together_to_tell(
    stretch_m: float, *, is_turned: bool
) -> None:
    """One of half a metre was 2.3 degrees off, and 5 m long where it went on: two cells outside."""
    off_rad = 0.04
    struck, places_m, echoes = heard(off_rad, stretch_m)
    moved_m = off_rad * float(struck.feet_m(places_m).std())
    assert (moved_m < UNSURE_M) is is_turned
    many = np.zeros(60, np.int64)
    firm = MirrorWall(0.0, 5.0, 0.0, 8.0, many, many, 0.5, 0.0, -0.5, 0.05, 9.0)
    *_, now = squared([firm, struck], places_m, echoes)
    assert now.normal_rad == pytest.approx(0.0 if is_turned else off_rad, abs=1e-9)
