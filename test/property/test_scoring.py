"""What must hold of the score of any map of any room."""

from dataclasses import replace

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rooms import AROUND, GEOMETRY, SHAPE, all_views, truths
from scipy.ndimage import binary_dilation

from usmap_ros.evaluation.line_of_sight import pings_in_sight
from usmap_ros.evaluation.scoring import score
from usmap_ros.grids import OccupancyMap, TruthMap
from usmap_ros.pings.fields_of_view import PingViews

#: Of cells called free, unknown and predicted.
LOG_ODDS = (-3.0, 0.0, 3.0)


@st.composite
def maps(draw: st.DrawFn) -> OccupancyMap:
    """Any map, of which some cells are observed."""
    log_odds = draw(arrays(np.float32, SHAPE, elements=st.sampled_from(LOG_ODDS)))
    observed = draw(arrays(bool, SHAPE, elements=st.booleans()))
    return OccupancyMap(GEOMETRY, log_odds, observed, "map")


def twice(views: PingViews) -> PingViews:
    """Each ping two times, so that what one sees could be known."""
    return PingViews(np.tile(views.positions_m, (2, 1)), np.tile(views.beams, (2, 1)))


@given(truths(), all_views())
def test_a_map_that_says_nothing_scores_nothing(occupied: np.ndarray, views: PingViews) -> None:
    nothing = OccupancyMap(
        GEOMETRY, np.zeros(SHAPE, np.float32), np.zeros(SHAPE, dtype=bool), "map"
    )
    result = score(nothing, TruthMap(GEOMETRY, occupied), twice(views))
    assert (result.f1, result.precision, result.recall, result.known) == (0.0, 0.0, 0.0, 0.0)
    assert (result.leak, result.lost, result.escape_m2) == (0.0, 0.0, 0.0)
    np.testing.assert_allclose([result.log_loss, result.brier], [np.log(2.0), 0.25])


@given(truths(), all_views())
def test_a_map_that_says_what_was_in_sight_scores_all(
    occupied: np.ndarray, views: PingViews
) -> None:
    seen = pings_in_sight(occupied, GEOMETRY, views) > 0
    log_odds = np.where(occupied, 3.0, -3.0).astype(np.float32)
    truth = TruthMap(GEOMETRY, occupied)
    result = score(OccupancyMap(GEOMETRY, log_odds, seen, "map"), truth, twice(views))
    assume(result.surface_cells and result.open_cells)
    assert (result.f1, result.recall, result.known, result.leak) == (1.0, 1.0, 1.0, 0.0)


@given(truths(), all_views(), maps(), arrays(bool, SHAPE, elements=st.booleans()))
def test_what_is_forgotten_is_neither_found_nor_known(
    occupied: np.ndarray, views: PingViews, whole: OccupancyMap, forgotten: np.ndarray
) -> None:
    less = replace(whole, observed=whole.observed & ~forgotten)
    truth = TruthMap(GEOMETRY, occupied)
    before, after = score(whole, truth, twice(views)), score(less, truth, twice(views))
    assert after.recall <= before.recall
    assert after.known <= before.known
    # What is asked depends on the truth and the pings alone.
    assert (after.surface_cells, after.open_cells) == (before.surface_cells, before.open_cells)
    assert score(whole, truth).recall <= 1.0


@given(truths(), all_views(), maps())
def test_calling_free_what_nothing_can_have_seen_leaks_and_is_no_knowledge(
    occupied: np.ndarray, views: PingViews, said: OccupancyMap
) -> None:
    seen = binary_dilation(pings_in_sight(occupied, GEOMETRY, views) > 0, AROUND)
    dreamt = replace(
        said,
        log_odds=np.where(seen, said.log_odds, np.float32(-3.0)),
        observed=said.observed | ~seen,
    )
    assume(not seen.all())
    truth = TruthMap(GEOMETRY, occupied)
    before, after = score(said, truth, twice(views)), score(dreamt, truth, twice(views))
    assert after.leak >= before.leak
    assert after.leak > 0.0
    assert after.known == before.known


@given(truths(), all_views(), maps(), st.data())
def test_another_ping_never_asks_less(
    occupied: np.ndarray, views: PingViews, said: OccupancyMap, data: st.DataObject
) -> None:
    truth, all_pings = TruthMap(GEOMETRY, occupied), twice(views)
    count = data.draw(st.integers(1, len(all_pings)))
    fewer = PingViews(all_pings.positions_m[:count], all_pings.beams[:count])
    some, most = score(said, truth, fewer), score(said, truth, all_pings)
    assert some.surface_cells <= most.surface_cells
    assert some.open_cells <= most.open_cells
    assert some.precision == most.precision
