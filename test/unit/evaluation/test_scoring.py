"""Every figure of the score, on maps small enough to work out by hand."""

from dataclasses import asdict

import numpy as np
import pytest
from scipy.special import logit

from usmap_ros.errors import MapSizeError
from usmap_ros.evaluation.alignment import align
from usmap_ros.evaluation.scoring import score
from usmap_ros.evaluation.sight import is_lone_poles
from usmap_ros.grids import GridGeometry, OccupancyMap, TruthMap
from usmap_ros.pings.fields_of_view import PingViews

RESOLUTION_M = 0.5


def make_map(
    probability: np.ndarray, observed: np.ndarray | None = None, origin_m=(0.0, 0.0)
) -> OccupancyMap:
    probability = np.asarray(probability, dtype=float)
    return OccupancyMap(
        GridGeometry(RESOLUTION_M, origin_m, probability.shape),
        logit(probability).astype(np.float32),
        np.ones(probability.shape, dtype=bool) if observed is None else observed,
        "map",
    )


def make_truth(
    shape: tuple[int, int], *cells: tuple[int, int], origin_m=(0.0, 0.0), resolution_m=RESOLUTION_M
) -> TruthMap:
    occupied = np.zeros(shape, dtype=bool)
    for cell in cells:
        occupied[cell] = True
    return TruthMap(GridGeometry(resolution_m, origin_m, shape), occupied)


def with_peaks(shape: tuple[int, int], *cells: tuple[int, int], peak: float = 0.9) -> np.ndarray:
    probability = np.full(shape, 0.1)
    for cell in cells:
        probability[cell] = peak
    return probability


def looking_around(*places: tuple[float, float]) -> PingViews:
    """Pings from (column, row) that look all around as far as anything here."""
    positions_m = (np.array(places, dtype=float) + 0.5) * RESOLUTION_M
    return PingViews(positions_m, np.tile([0.0, np.pi, 50.0], (len(places), 1)))


def everywhere(shape: tuple[int, int]) -> PingViews:
    """Two pings from every cell."""
    rows, columns = np.indices(shape).reshape(2, -1)
    return looking_around(*zip(columns, rows, strict=True), *zip(columns, rows, strict=True))


def test_precision_recall_and_distance_of_a_mixed_map() -> None:
    # Predicted: one cell beside a truth cell, one far off.  Truth: two, one of them found.
    probability = with_peaks((6, 9), (1, 2), (1, 7))
    result = score(make_map(probability), make_truth((6, 9), (2, 3), (5, 0)))
    assert result.precision == 0.5
    assert result.recall == 0.5
    assert result.f1 == 0.5
    near, far = np.hypot(1, 1), np.hypot(1, 4)
    assert result.mean_distance_m == pytest.approx(RESOLUTION_M * (near + far) / 2)
    # Nine cells within one of either truth cell, but for those beyond the rim, are not asked.
    assert (result.known, result.open_cells) == (pytest.approx(40 / 41), 41)
    losses = [np.log(0.9)] * 50 + [np.log(0.1)] * 4
    assert result.log_loss == pytest.approx(-np.mean(losses))
    assert result.brier == pytest.approx((50 * 0.01 + 4 * 0.81) / 54)


@pytest.mark.parametrize(("distance", "right"), [(0, 1.0), (1, 1.0), (2, 0.0)])
def test_a_predicted_cell_is_right_up_to_one_cell_away_even_diagonally(
    distance: int, right: float
) -> None:
    result = score(
        make_map(with_peaks((7, 7), (3, 3))), make_truth((7, 7), (3 + distance, 3 - distance))
    )
    assert (result.precision, result.recall) == (right, right)


@pytest.mark.parametrize(("peak", "count"), [(0.6499, 0), (0.6501, 1)])
def test_a_cell_is_predicted_from_065_on(peak: float, count: int) -> None:
    probability = with_peaks((4, 4), (2, 2), peak=peak)
    assert score(make_map(probability), make_truth((4, 4), (2, 2))).predicted_cells == count


@pytest.mark.parametrize(("probability", "share"), [(0.34, 1.0), (0.36, 0.0)])
def test_a_cell_is_called_free_up_to_035(probability: float, share: float) -> None:
    result = score(make_map(np.full((4, 4), probability)), make_truth((4, 4)))
    assert result.known == share


def test_an_unobserved_cell_is_neither_found_nor_known() -> None:
    observed = np.ones((6, 6), dtype=bool)
    observed[0, 0] = observed[5, 5] = observed[0, 5] = False
    # A wrong prediction, a missed truth cell and a free one, none of them observed.
    occupancy = make_map(with_peaks((6, 6), (2, 2), (0, 0)), observed)
    result = score(occupancy, make_truth((6, 6), (2, 2), (5, 5)), everywhere((6, 6)))
    assert (result.precision, result.recall) == (1.0, 0.5)
    assert (result.predicted_cells, result.surface_cells) == (1, 2)
    assert result.known == pytest.approx(21 / 23)


def test_unknown_cells_count_with_their_probability_but_at_most_one_half() -> None:
    probability = np.array([[0.6, 0.45, 0.9, 0.9]])
    occupancy = make_map(probability, np.array([[True, True, False, True]]))
    # On a grid of one row everything is in sight and nothing is open.
    result = score(occupancy, make_truth((1, 4), (0, 2)), everywhere((1, 4)))
    assert result.log_loss == pytest.approx(-np.mean(np.log([0.5, 0.55, 0.5, 0.1])))
    assert result.brier == pytest.approx(np.mean(np.square([0.5, 0.45, 0.5, 0.9])))


def test_what_lies_beyond_a_map_is_unknown() -> None:
    whole, observed = np.full((4, 8), 0.5), np.zeros((4, 8), dtype=bool)
    whole[:, :4], observed[:, :4] = 0.1, True
    truth = make_truth((4, 8), (2, 6))
    kept = score(make_map(whole, observed), truth, everywhere((4, 8)))
    cut = score(make_map(whole[:, :4]), truth, everywhere((4, 8)))
    np.testing.assert_equal(asdict(kept), asdict(cut))
    assert cut.known == pytest.approx(16 / 23)


def test_what_lies_beyond_the_truth_is_not_asked_but_may_be_wrong() -> None:
    larger = np.full((4, 8), 0.1)
    larger[2, 7] = 0.9
    result = score(make_map(larger), make_truth((4, 4), (2, 0)), everywhere((4, 8)))
    assert (result.precision, result.known, result.open_cells) == (0.0, 1.0, 10)


def test_without_paths_sight_is_what_is_observed_and_the_score_says_so() -> None:
    observed = np.zeros((6, 9), dtype=bool)
    observed[:, :3] = True
    occupancy = make_map(with_peaks((6, 9), (1, 1)), observed)
    truth = make_truth((6, 9), (1, 1), (4, 3), (1, 6))
    result = score(occupancy, truth)
    assert not result.sight_known
    # One cell beside what is observed is asked for, but no cell that is farther.
    assert (result.recall, result.surface_cells) == (0.5, 2)
    assert score(occupancy, truth, everywhere((6, 9))).sight_known
    assert score(occupancy, truth, everywhere((6, 9))).recall == pytest.approx(1 / 3)


def test_what_pings_cannot_see_is_not_asked() -> None:
    truth = np.zeros((9, 9), dtype=bool)
    truth[:, 4] = True
    truth[3:6, 8] = True
    nothing = make_map(np.full((9, 9), 0.5), np.zeros((9, 9), dtype=bool))
    standing = TruthMap(GridGeometry(RESOLUTION_M, (0.0, 0.0), truth.shape), truth)
    result = score(nothing, standing, looking_around((2, 4), (2, 5)))
    # The wall's near side, and the open cells farther than one cell from it.
    assert (result.surface_cells, result.open_cells) == (9, 27)
    once = score(nothing, standing, looking_around((2, 4)))
    assert (once.surface_cells, once.open_cells) == (0, 0)


def test_only_the_surface_of_what_is_solid_is_asked() -> None:
    solid = [(row, column) for row in range(3, 8) for column in range(3, 8)]
    perfect = make_map(with_peaks((11, 11), *solid))
    result = score(perfect, make_truth((11, 11), *solid))
    assert (result.recall, result.surface_cells) == (1.0, 16)


def test_nothing_stops_sight_among_lone_poles() -> None:
    row = make_map(np.full((1, 9), 0.1))
    pole = score(row, make_truth((1, 9), (0, 3)), looking_around((0, 0), (0, 0)))
    assert (pole.surface_cells, pole.open_cells) == (1, 6)
    crate = make_truth((1, 9), (0, 3), (0, 4), (0, 5))
    hidden = score(row, crate, looking_around((0, 0), (0, 0)))
    assert (hidden.surface_cells, hidden.open_cells) == (1, 2)


def test_what_is_too_faint_to_be_heard_is_not_asked_but_no_mistake() -> None:
    occupancy = make_map(with_peaks((9, 9), (1, 1), (7, 7)))
    truth, audible = make_truth((9, 9), (1, 1), (4, 4), (7, 7)), make_truth((9, 9), (1, 1))
    asked = score(occupancy, truth, everywhere((9, 9)), audible)
    assert (asked.precision, asked.recall, asked.surface_cells) == (1.0, 1.0, 1)
    assert score(occupancy, truth, everywhere((9, 9))).recall == pytest.approx(2 / 3)


@pytest.mark.parametrize(
    ("resolution_m", "cells", "are_poles"),
    [
        (0.05, [], True),
        (0.05, [(2, 2), (2, 4), (4, 2)], True),
        # A post as thick as five cells, and one that is thicker.
        (0.05, [(2, column) for column in range(2, 7)], True),
        (0.05, [(2, column) for column in range(2, 8)], False),
        # Cells that touch at a corner are one thing.
        (0.05, [(i, i) for i in range(1, 8)], False),
        (0.05, [(2, 2), *((8, column) for column in range(10))], False),
        # A pole on the border between two cells takes both, however large they are.
        (0.5, [(2, 2), (2, 3), (3, 2), (3, 3)], True),
        (0.5, [(2, 2), (2, 3), (2, 4)], False),
    ],
)
def test_lone_poles_are_told_by_the_largest_thing(
    resolution_m: float, cells: list[tuple[int, int]], are_poles: bool
) -> None:
    assert is_lone_poles(make_truth((10, 10), *cells, resolution_m=resolution_m)) is are_poles


@pytest.mark.parametrize("shift", [(0, 0), (3, 1), (-2, 4), (-3, -5)])
def test_maps_are_laid_over_each_other_by_their_origins(shift: tuple[int, int]) -> None:
    rows, columns = shift
    occupancy = make_map(
        with_peaks((8, 8), (4, 4)), origin_m=(-columns * RESOLUTION_M, -rows * RESOLUTION_M)
    )
    # In the truth's own indices the same place.
    truth = make_truth((12, 12), (4 - rows, 4 - columns))
    result = score(occupancy, truth)
    assert (result.f1, result.mean_distance_m, result.surface_cells) == (1.0, 0.0, 1)


def test_being_certain_and_wrong_costs_much_but_not_everything() -> None:
    occupancy = make_map(np.array([[0.5]]))
    occupancy.log_odds[0, 0] = -50.0
    result = score(occupancy, make_truth((1, 1), (0, 0)))
    assert result.log_loss == pytest.approx(-np.log(1e-6))


@pytest.mark.parametrize(
    ("resolution_m", "shape", "standing"),
    [
        (0.25, (8, 8), [(2, 4), (3, 5)]),  # Finer: both lie in the same cell.
        (1.0, (2, 2), [(0, 1)]),  # Coarser: fills four cells.
        (0.3, (7, 7), [(3, 3)]),  # Neither way round: some of the cells that it touches.
    ],
)
def test_a_truth_of_other_cells_is_brought_to_those_of_the_map(
    resolution_m: float, shape: tuple[int, int], standing: list[tuple[int, int]]
) -> None:
    maps = align(
        make_map(np.full((4, 4), 0.1)), make_truth(shape, *standing, resolution_m=resolution_m)
    )
    found = {(int(row), int(column)) for row, column in np.argwhere(maps.occupied)}
    expected = {0.25: {(1, 2)}, 1.0: {(0, 2), (0, 3), (1, 2), (1, 3)}, 0.3: {(2, 2)}}
    assert found == expected[resolution_m]
    assert maps.geometry.resolution_m == RESOLUTION_M


def test_a_truth_that_lies_between_the_cells_is_scored() -> None:
    truth = make_truth((3, 3), (1, 1), origin_m=(0.2, -0.2))
    result = score(make_map(with_peaks((3, 3), (0, 1))), truth)
    assert (result.precision, result.recall) == (1.0, 1.0)


def test_scores_hardly_change_with_the_cells_of_the_truth() -> None:
    walls = np.zeros((40, 40), dtype=bool)
    walls[4, 4:36] = walls[4:36, 4] = walls[20, 8:20] = True
    occupancy = make_map(np.where(walls, 0.9, 0.1))
    same = score(occupancy, TruthMap(GridGeometry(0.5, (0.0, 0.0), walls.shape), walls))
    finer = TruthMap(GridGeometry(0.25, (0.0, 0.0), (80, 80)), np.kron(walls, np.ones((2, 2))) > 0)
    np.testing.assert_equal(asdict(score(occupancy, finer)), asdict(same))


def test_a_truth_at_the_other_end_of_the_world_is_refused() -> None:
    with pytest.raises(MapSizeError, match="may have 1e"):
        score(make_map(np.full((2, 2), 0.5)), make_truth((2, 2), origin_m=(1e6, 1e6)))
