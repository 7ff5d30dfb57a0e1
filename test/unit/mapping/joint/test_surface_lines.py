"""Straight runs of believed cells: what is a wall, and what is two things side by side."""

import numpy as np
import pytest

from usmap_ros.mapping.joint.surfaces.lines import BEGIN, END
from usmap_ros.mapping.joint.surfaces.surface_lines import surface_lines

GAP_CELLS = 10.0


def lines_through(*columns: int) -> np.ndarray:
    believed = np.zeros((40, 60), bool)
    believed[20, list(columns)] = True
    return surface_lines(np.where(believed, 3.0, -9.0), believed, GAP_CELLS)


def test_a_dashed_wall_is_one_line() -> None:
    (line,) = lines_through(*range(5, 12), *range(17, 24), *range(30, 37))
    assert line[END] - line[BEGIN] == pytest.approx(31.0, abs=0.5)


def test_two_things_side_by_side_are_no_wall() -> None:
    assert len(lines_through(10, 11, 12, 20, 21, 22)) == 0


def test_a_gap_that_is_too_wide_ends_a_wall() -> None:
    assert len(lines_through(*range(5, 15), *range(30, 40))) == 2
