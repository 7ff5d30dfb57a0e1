"""Landmarks by which poses that are off by chance are corrected."""

import numpy as np
import pytest

from usmap_ros.localisation.lines_and_points import Landmarks
from usmap_ros.localisation.noisy_poses import without_chance_lines

LINES = np.array([0.1, 0.2, 0.3])
POINTS_M = np.array([[1.0, 2.0], [3.0, 1.0], [2.0, 2.0]])


@pytest.mark.parametrize(
    ("by_lines", "by_points", "kept"),
    [
        # Points gather ten echoes at the median: a wall gathers half as many again, and more.
        ([9.0, 14.9, 15.1], [4.0, 10.0, 30.0], [0.3]),
        ([1.0, 2.0, 3.0], [], [0.1, 0.2, 0.3]),
    ],
)
def test_lines_that_gather_hardly_more_than_points_are_chance(
    by_lines: list[float], by_points: list[float], kept: list[float]
) -> None:
    landmarks = Landmarks(LINES, LINES, POINTS_M[: len(by_points)])
    left = without_chance_lines(landmarks, np.array(by_lines + by_points))
    assert left.normals_rad.tolist() == kept
    assert len(left.points_m) == len(by_points)
