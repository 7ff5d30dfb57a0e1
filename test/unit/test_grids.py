"""Rectangular maps: where their cells lie, and what nav2 is told of them."""

import numpy as np
import pytest
from scipy.special import logit

from usmap_ros.grids import (
    FREE_PROBABILITY,
    FREE_VALUE,
    OCCUPIED_PROBABILITY,
    GridGeometry,
    OccupancyMap,
)


def make_map(probability: list[float], observed: list[bool]) -> OccupancyMap:
    return OccupancyMap(
        GridGeometry(0.05, (0.0, 0.0), (1, len(probability))),
        logit(np.array([probability])).astype(np.float32),
        np.array([observed]),
        "map",
    )


def test_cells_count_up_from_the_lowest_corner() -> None:
    geometry = GridGeometry(0.5, (-1.0, 2.0), (3, 4))
    centers_m = geometry.cell_centers_m(np.array([0, 2]), np.array([0, 3]))
    np.testing.assert_allclose(centers_m, [[-0.75, 2.25], [0.75, 3.25]])
    assert geometry.extent_m == (-1.0, 1.0, 2.0, 3.5)


@pytest.mark.parametrize(
    ("probability", "value"),
    [(0.01, 0), (0.3499, 0), (0.3501, -1), (0.5, -1), (0.6499, -1), (0.6501, 100), (0.99, 100)],
)
def test_a_trinary_map_leaves_what_is_in_doubt_unknown(probability: float, value: int) -> None:
    assert make_map([probability], [True]).trinary().tolist() == [[value]]


def test_what_was_not_observed_is_unknown_however_probable() -> None:
    occupancy = make_map([0.01, 0.5, 0.99], [False] * 3)
    assert occupancy.trinary().tolist() == [[-1, -1, -1]]
    assert occupancy.percent().tolist() == [[-1, -1, -1]]


def test_percent_are_rounded_probabilities() -> None:
    occupancy = make_map([0.001, 0.124, 0.126, 0.999], [True] * 4)
    assert occupancy.percent().tolist() == [[0, 12, 13, 100]]
    assert occupancy.percent().dtype == np.int8


def test_log_odds_at_the_widest_clamps_are_probabilities_still() -> None:
    occupancy = make_map([0.5, 0.5], [True, True])
    occupancy.log_odds[0] = (-50.0, 50.0)
    np.testing.assert_allclose(occupancy.probability(), [[0.0, 1.0]], atol=1e-20)


def test_the_observed_rectangle_is_cut_out_of_a_map() -> None:
    observed = np.zeros((6, 8), dtype=np.bool_)
    observed[2, 3] = observed[4, 5] = True
    geometry = GridGeometry(0.5, (-1.0, 2.0), (6, 8))
    occupancy = OccupancyMap(geometry, np.zeros((6, 8), np.float32), observed, "map")
    assert occupancy.observed_geometry() == GridGeometry(0.5, (0.5, 3.0), (3, 3))


def test_cells_are_told_apart_by_probability_to_the_last_digit() -> None:
    near = [np.log(p / (1.0 - p)) for p in (OCCUPIED_PROBABILITY, FREE_PROBABILITY)]
    steps = np.arange(-3, 4)
    log_odds = np.array([[x + k * 6e-8 for k in steps] for x in near] + [0.0 * steps], np.float32)
    grid = GridGeometry(0.05, (0.0, 0.0), log_odds.shape)
    occupancy = OccupancyMap(grid, log_odds, np.ones(log_odds.shape, bool), "map")
    is_occupied = occupancy.probability() >= OCCUPIED_PROBABILITY
    is_free = occupancy.probability() <= FREE_PROBABILITY
    np.testing.assert_array_equal(occupancy.predicted(), is_occupied)
    np.testing.assert_array_equal(occupancy.trinary() == FREE_VALUE, is_free)
    assert 0 < np.count_nonzero(is_occupied[0]) < len(steps)
    assert 0 < np.count_nonzero(is_free[1]) < len(steps)


def test_a_grid_around_others_holds_each_where_it_is() -> None:
    low, high = GridGeometry(0.1, (-0.2, 0.3), (2, 3)), GridGeometry(0.1, (0.5, -0.1), (4, 1))

    both = GridGeometry.around([low, high])

    assert both.first_cell == (-2, -1)
    assert both.shape == (6, 8)
    assert low.within(both) == (slice(4, 6), slice(0, 3))
    assert high.within(both) == (slice(0, 4), slice(7, 8))
