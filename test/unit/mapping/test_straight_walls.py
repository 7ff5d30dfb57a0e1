"""Straight walls among occupied cells."""

import itertools

import numpy as np
import pytest

from usmap_ros.mapping.straight_walls import straight_walls

CELL_M = 0.05


def cells_along(start, end):
    """Centres of the cells that a line passes through."""
    points = np.linspace(start, end, 400)
    return (np.unique(np.floor(points / CELL_M), axis=0) + 0.5) * CELL_M


@pytest.mark.parametrize(
    ("start", "end"), [((0.0, 0.0), (3.0, 0.0)), ((1.0, -2.0), (3.0, 1.0)), ((0.0, 2.0), (0.0, -2))]
)
def test_a_wall_is_found_to_half_a_cell(start, end):
    starts, ends = straight_walls(cells_along(start, end), CELL_M, 1.0)

    (found,) = [sorted([tuple(a), tuple(b)]) for a, b in zip(starts, ends, strict=True)]
    np.testing.assert_allclose(found, sorted([start, end]), atol=1.5 * CELL_M)
    direction = (np.array(end) - start) / np.linalg.norm(np.array(end) - start)
    normal = np.array([-direction[1], direction[0]])
    np.testing.assert_allclose((np.array(found) - start) @ normal, 0.0, atol=0.8 * CELL_M)


def test_walls_of_a_room_are_found_and_poles_are_not():
    corners = [(0.0, 0.0), (4.0, 0.0), (4.0, 3.0), (0.0, 3.0), (0.0, 0.0)]
    sides = [cells_along(a, b) for a, b in itertools.pairwise(corners)]
    poles = np.random.default_rng(1).uniform(0.3, 2.7, (15, 2))
    starts, ends = straight_walls(np.concatenate([*sides, poles]), CELL_M, 1.0)

    lengths = np.linalg.norm(ends - starts, axis=1)
    np.testing.assert_allclose(lengths, [4.0, 4.0, 3.0, 3.0], atol=0.15)


def test_a_gap_parts_a_wall():
    both = np.concatenate([cells_along((0, 0), (2, 0)), cells_along((3, 0), (4.5, 0))])
    starts, ends = straight_walls(both, CELL_M, 1.0)

    np.testing.assert_allclose(np.linalg.norm(ends - starts, axis=1), [2.0, 1.5], atol=0.1)


@pytest.mark.parametrize("count", [0, 1, 5])
def test_few_cells_make_no_wall(count):
    starts, ends = straight_walls(np.random.default_rng(2).uniform(0, 5, (count, 2)), CELL_M, 1.0)
    assert len(starts) == len(ends) == 0
