"""What became of cells by their probability, on maps small enough to count."""

import numpy as np
import pytest
from scipy.special import logit

from usmap_ros.evaluation.reliability import BINS, Reliability, reliability
from usmap_ros.grids import GridGeometry, OccupancyMap, TruthMap

GEOMETRY = GridGeometry(0.1, (0.0, 0.0), (6, 20))


def counted(probability: np.ndarray, occupied: np.ndarray) -> Reliability:
    observed = np.ones(GEOMETRY.shape, dtype=bool)
    observed[5] = False
    log_odds = logit(probability).astype(np.float32)
    return reliability(
        OccupancyMap(GEOMETRY, log_odds, observed, "map"), TruthMap(GEOMETRY, occupied)
    )


@pytest.fixture
def mixed() -> Reliability:
    """A line of ten cells given 0.82, five of which hold a surface, the rest given 0.02."""
    probability = np.full(GEOMETRY.shape, 0.02)
    probability[2, 2:12] = 0.82
    occupied = np.zeros(GEOMETRY.shape, dtype=bool)
    occupied[2, 2:7] = True
    return counted(probability, occupied)


def test_cells_are_counted_by_probability_and_only_if_observed(mixed: Reliability) -> None:
    assert mixed.cells[[0, 16]].tolist() == [90, 10]
    assert mixed.cells.sum() == 100
    assert mixed.mean_probability[[0, 16]] == pytest.approx([0.02, 0.82])
    assert np.isnan(mixed.mean_probability[8])


def test_a_cell_may_hold_or_touch_a_surface(mixed: Reliability) -> None:
    assert mixed.share_holding[16] == 0.5
    assert mixed.share_touching[16] == 0.6
    # Two rows of seven and one end, beside the line.
    assert mixed.holding[0] == 0
    assert mixed.touching[0] == 15


def test_the_worst_bin_is_the_one_farthest_from_the_diagonal(mixed: Reliability) -> None:
    assert mixed.worst(touching=False) == pytest.approx(0.32)
    assert mixed.worst() == pytest.approx(0.22)


def test_a_bin_of_few_cells_and_the_surely_free_do_not_count() -> None:
    cells = np.zeros(BINS, dtype=np.int64)
    cells[[0, 10, 12]] = 100_000, 1000, 10
    means = np.where(cells > 0, (np.arange(BINS) + 0.5) / BINS, 0.0)
    right = np.rint(cells * means).astype(np.int64)
    right[[0, 12]] = 0
    good = Reliability(cells, cells * means, right, right)
    assert good.worst() == pytest.approx(0.0, abs=1e-3)
    with_more = good + Reliability(
        *[np.where(np.arange(BINS) == 12, n, 0) for n in (cells, cells * means, right, right)]
    )
    assert with_more.worst() == pytest.approx(0.625)


def test_a_map_that_believes_in_nothing_has_no_worst_bin() -> None:
    nothing = np.zeros(GEOMETRY.shape, dtype=bool)
    assert np.isnan(counted(np.full(GEOMETRY.shape, 0.01), nothing).worst())
