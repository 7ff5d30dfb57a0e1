"""Straight runs of believed cells: what is a wall, and what is two things side by side."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from usmap_ros.mapping.joint.forward_model.cell_evidence import CellEvidence
from usmap_ros.mapping.joint.surfaces.lines import BEGIN, END, NO_LINES, without_askew
from usmap_ros.mapping.joint.surfaces.surface_lines import (
    DIRECTIONS,
    _heaviest,
    _most_votes,
    surface_lines,
    without_arcs,
)
from usmap_ros.mapping.joint.surfaces.walls import find_walls
from usmap_ros.mapping.joint.visibility.field import Field

GAP_CELLS = 10.0


def lines_through(*columns: int) -> np.ndarray:
    believed = np.zeros((40, 60), bool)
    believed[20, list(columns)] = True
    return surface_lines(np.where(believed, 3.0, -9.0), believed, GAP_CELLS)


def heard_within(angle_rad: float, shape: tuple[int, int]) -> CellEvidence:
    """Evidence of cells that are heard twice, from either side of the direction of the columns."""
    some = np.full(shape, 2.0, np.float32).ravel()
    evidence = CellEvidence(*(np.zeros_like(some) for _ in CellEvidence._fields))
    return evidence._replace(heard=some, axis_cos=-some * np.float32(np.cos(2.0 * angle_rad)))


@pytest.mark.parametrize(
    ("last", "angle_rad", "is_wall"),
    [(11, 0.05, False), (11, 0.3, True), (29, 0.05, True), (19, 0.05, False)],
)
def test_the_arc_of_one_thing_is_no_wall(last: int, angle_rad: float, is_wall: bool) -> None:
    """Where it is across tell only ranges from other directions."""
    believed = np.zeros((40, 60), bool)
    believed[20, 5 : last + 1] = True
    lines = surface_lines(np.where(believed, 3.0, -9.0), believed, GAP_CELLS)
    found = without_arcs(lines, believed, heard_within(angle_rad, believed.shape))
    assert len(found) == is_wall


def test_a_dashed_wall_is_one_line() -> None:
    (line,) = lines_through(*range(5, 12), *range(17, 24), *range(30, 37))
    assert line[END] - line[BEGIN] == pytest.approx(31.0, abs=0.5)


def test_two_things_side_by_side_are_no_wall() -> None:
    assert len(lines_through(10, 11, 12, 20, 21, 22)) == 0


def test_a_gap_that_is_too_wide_ends_a_wall() -> None:
    assert len(lines_through(*range(5, 15), *range(30, 40))) == 2


@pytest.mark.parametrize(("has_wall", "beside"), [(False, False), (True, True)])
def test_a_point_is_shown_once_where_nothing_but_points_is(has_wall: bool, beside: bool) -> None:
    """Weaker cells beside it are its ghosts; among walls they may be what it is part of."""
    log_odds = np.full((40, 60), -9.0)
    log_odds[10, 8:11] = 3.0, 4.0, 3.9
    log_odds[10, 14] = 1.0
    log_odds[30, 5:30] = 3.0 if has_wall else -9.0
    nothing = np.zeros(log_odds.shape, bool)
    smooth: Any = SimpleNamespace(
        lines=lambda: NO_LINES,
        usual_lines=lambda: NO_LINES,
        drawn_columns=lambda: nothing,
        drawn_points=lambda: nothing,
        hide=lambda rows, _: np.zeros(len(rows), bool),
    )
    field = Field(0, 0, 40, 60, 0.05)
    evidence = heard_within(0.5, log_odds.shape)
    shown = find_walls(log_odds, evidence, field, GAP_CELLS * 0.05, smooth, nothing).shown
    assert shown[10, [8, 9, 10, 14]].tolist() == [beside, True, True, True]


def test_the_line_that_most_vote_for_is_found_without_looking_at_all_votes_again() -> None:
    rng = np.random.default_rng(5)
    votes = rng.uniform(0.0, 1.0, (DIRECTIONS, 60))
    most, at = (np.array(each) for each in zip(*map(_most_votes, votes), strict=True))
    for _ in range(200):
        best, direction, bucket = _heaviest(votes, most, at)
        totals = votes[:, :-2] + votes[:, 1:-1] + votes[:, 2:]
        assert best == totals.max()
        assert (direction, bucket - 1) == np.unravel_index(totals.argmax(), totals.shape)
        # The best ones go, and some others.
        votes[direction, bucket - 1 : bucket + 2] -= rng.uniform(0.0, 1.0)
        votes[rng.integers(DIRECTIONS), rng.integers(60)] -= 0.5


def test_a_line_across_a_wall_at_a_small_angle_is_none() -> None:
    wall = np.array([[0.0, 1.0, 50.0, -100.0, 0.0]])
    tilted = np.array([[np.sin(0.07), np.cos(0.07), 50.0 * np.cos(0.07) + 50.0 * np.sin(0.07)]])
    along = 50.0 * np.sin(0.07) - 50.0 * np.cos(0.07)
    across = np.column_stack([tilted, [[along - 35.0, along + 35.0]]])
    beside = np.array([[0.0, 1.0, 48.0, -80.0, -20.0]])
    square = np.array([[1.0, 0.0, 40.0, 20.0, 50.0]])
    kept = without_askew(np.concatenate([across, beside, square]), wall)
    assert np.array_equal(kept, np.concatenate([beside, square]))
    assert np.array_equal(without_askew(across, NO_LINES), across)
