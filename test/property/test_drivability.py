"""What must hold of leak, lost and escape in any room."""

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rooms import AROUND, GEOMETRY, SHAPE, all_views, truths
from scipy.ndimage import binary_dilation

from usmap_ros.evaluation.alignment import AlignedMaps
from usmap_ros.evaluation.drivability import drivability, reachable
from usmap_ros.evaluation.line_of_sight import pings_in_sight
from usmap_ros.grids import GridGeometry
from usmap_ros.pings.fields_of_view import PingViews


def made(occupied: np.ndarray, probability: np.ndarray, observed: np.ndarray) -> AlignedMaps:
    return AlignedMaps(GEOMETRY, probability, observed, occupied, np.ones(SHAPE, dtype=bool))


@given(truths(), all_views())
def test_a_map_that_says_what_was_seen_has_no_fault(occupied: np.ndarray, views: PingViews) -> None:
    seen = pings_in_sight(occupied, GEOMETRY, views) > 0
    maps = made(occupied, np.where(occupied, 0.99, 0.01), seen)
    result = drivability(maps, views)
    assert (result.leak, result.lost, result.escape_m2) == (0.0, 0.0, 0.0)


@given(truths(), all_views(), st.data())
def test_another_ping_never_makes_a_map_leak_more(
    occupied: np.ndarray, views: PingViews, data: st.DataObject
) -> None:
    probability = data.draw(arrays(float, SHAPE, elements=st.sampled_from([0.01, 0.5, 0.99])))
    maps = made(occupied, probability, np.ones(SHAPE, dtype=bool))
    fewer = PingViews(views.positions_m[:1], views.beams[:1])
    assert drivability(maps, views).leak <= drivability(maps, fewer).leak


@given(truths(), all_views())
def test_no_beam_gets_out_of_a_closed_room(occupied: np.ndarray, views: PingViews) -> None:
    outside = np.ones(SHAPE, dtype=bool)
    outside[2:-2, 2:-2] = False
    assert not pings_in_sight(occupied, GEOMETRY, views)[outside].any()


@given(truths(), all_views(), st.integers(1, 3))
def test_sight_turns_with_the_room(occupied: np.ndarray, views: PingViews, turns: int) -> None:
    origin_m = np.array(GEOMETRY.origin_m)
    width_m = SHAPE[1] * GEOMETRY.resolution_m
    height_m = SHAPE[0] * GEOMETRY.resolution_m
    x_m, y_m = (views.positions_m - origin_m).T
    # One on the border between two cells stands in the one, and in the other when it has turned.
    in_cells = np.stack([x_m, y_m]) / GEOMETRY.resolution_m
    assume((np.abs(in_cells - np.rint(in_cells)) > 1e-6).all())
    for _ in range(turns):
        # A quarter to the right, as np.rot90 has it where rows count upwards.
        x_m, y_m = y_m, width_m - x_m
        width_m, height_m = height_m, width_m
    turned = np.rot90(occupied, turns)
    beams = views.beams - [turns * np.pi / 2.0, 0.0, 0.0]
    geometry = GridGeometry(GEOMETRY.resolution_m, (0.0, 0.0), turned.shape)
    got = pings_in_sight(turned, geometry, PingViews(np.stack([x_m, y_m], axis=-1), beams)) > 0
    expected = np.rot90(pings_in_sight(occupied, GEOMETRY, views) > 0, turns)
    # Rays that graze a corner may go either way.
    assert not np.any(got & ~binary_dilation(expected, AROUND))
    assert not np.any(expected & ~binary_dilation(got, AROUND))


@given(truths(), all_views())
def test_all_that_points_along_straight_lines_reach_is_in_sight(
    occupied: np.ndarray, views: PingViews
) -> None:
    """A plain reference: one ray down the middle of each beam, in small steps."""
    counts = pings_in_sight(occupied, GEOMETRY, views)
    for position_m, (yaw, _, max_range_m) in zip(views.positions_m, views.beams, strict=True):
        steps = np.arange(0.0, max_range_m, 0.01 * GEOMETRY.resolution_m)
        places = position_m + steps[:, np.newaxis] * [np.cos(yaw), np.sin(yaw)]
        column, row = np.floor((places - GEOMETRY.origin_m) / GEOMETRY.resolution_m).astype(int).T
        moved = (row != row[0]) | (column != column[0])
        inside = (row >= 0) & (row < SHAPE[0]) & (column >= 0) & (column < SHAPE[1])
        row, column, moved = row[inside], column[inside], moved[inside]
        hits = np.flatnonzero(occupied[row, column] & moved)
        end = hits[0] + 1 if len(hits) else len(row)
        # Half a cell's spacing of rays may miss a corner that the middle one just touches.
        near = binary_dilation(counts > 0, AROUND)
        assert near[row[:end], column[:end]].all()


@given(truths(), all_views(), st.floats(0.0, 0.3))
def test_a_larger_robot_reaches_nothing_more_from_where_it_stands(
    occupied: np.ndarray, views: PingViews, radius_m: float
) -> None:
    free = ~occupied
    small = reachable(free, occupied, GEOMETRY, views.positions_m, radius_m)
    assert not np.any(small & ~free)
    outside = np.ones(SHAPE, dtype=bool)
    outside[2:-2, 2:-2] = False
    if radius_m < 0.1:
        assert not small[outside].any()
    # From the cells that a larger one gets to, and no others.
    large = reachable(free, occupied, GEOMETRY, views.positions_m, radius_m + 0.05)
    rows, columns = np.nonzero(large)
    again = reachable(free, occupied, GEOMETRY, GEOMETRY.cell_centers_m(rows, columns), radius_m)
    assert not np.any(large & ~again)
