"""Leak, lost and escape, in rooms small enough to work out by hand."""

import numpy as np
import pytest
from scipy.special import logit

from usmap_ros.evaluation.alignment import align
from usmap_ros.evaluation.drivability import drivability, reachable
from usmap_ros.evaluation.line_of_sight import pings_in_sight
from usmap_ros.evaluation.scoring import score
from usmap_ros.grids import GridGeometry, OccupancyMap, TruthMap
from usmap_ros.pings.fields_of_view import PingViews

RESOLUTION_M = 0.1
ALL_AROUND = np.pi
FREE, UNKNOWN, WALL = 0.05, 0.5, 0.95


def cells(*rows: str) -> np.ndarray:
    """A drawing as characters, its last line at the lowest y."""
    return np.array([list(row) for row in rows[::-1]])


def geometry_of(drawing: np.ndarray) -> GridGeometry:
    return GridGeometry(RESOLUTION_M, (0.0, 0.0), drawing.shape)


def looking(
    *places: tuple[float, float], yaw_rad=0.0, half_angle_rad=ALL_AROUND, max_range_m=10.0
) -> PingViews:
    """Pings from (column, row), all with one beam."""
    positions_m = (np.array(places, dtype=float).reshape(-1, 2) + 0.5) * RESOLUTION_M
    beams = np.tile([yaw_rad, half_angle_rad, max_range_m], (len(places), 1))
    return PingViews(positions_m, beams)


def make_map(drawing: np.ndarray) -> OccupancyMap:
    """A map that calls `.` free and `#` occupied; it knows nothing of the rest."""
    probability = np.select([drawing == ".", drawing == "#"], [FREE, WALL], UNKNOWN)
    log_odds = logit(probability).astype(np.float32)
    return OccupancyMap(geometry_of(drawing), log_odds, probability != UNKNOWN, "map")


def make_truth(drawing: np.ndarray) -> TruthMap:
    return TruthMap(geometry_of(drawing), drawing == "#")


class TestLineOfSight:
    def test_a_wall_is_seen_and_hides_what_is_behind(self) -> None:
        truth = cells("...#...", "...#...", "...#...")
        counts = pings_in_sight(truth == "#", geometry_of(truth), looking((0, 1)))
        expected = np.tile([1, 1, 1, 1, 0, 0, 0], (3, 1))
        np.testing.assert_array_equal(counts, expected)

    @pytest.mark.parametrize("turn", range(4))
    def test_no_ray_slips_through_where_cells_touch_at_a_corner(self, turn: int) -> None:
        drawing = cells(".....#", "....#.", "...#..", "..#...", ".#....", "#.....")
        wall = np.rot90(drawing == "#", turn)
        place = [(0, 5), (5, 5), (5, 0), (0, 0)][turn]
        geometry = geometry_of(drawing)
        seen = pings_in_sight(wall, geometry, looking(place)) > 0
        rows, columns = np.nonzero(np.rot90(seen, -turn))
        # The drawing's upper left corner has the highest row.
        assert np.all(rows >= columns)
        assert np.count_nonzero(seen) == 21

    def test_nothing_is_seen_beyond_the_range_and_the_beam(self) -> None:
        empty = np.zeros((41, 41), dtype=bool)
        geometry = GridGeometry(RESOLUTION_M, (0.0, 0.0), empty.shape)
        views = looking((20, 20), yaw_rad=np.pi / 2, half_angle_rad=np.pi / 6, max_range_m=1.5)
        rows, columns = np.nonzero(pings_in_sight(empty, geometry, views))
        ahead, aside = rows - 20, columns - 20
        half_diagonal = np.sqrt(0.5)
        assert np.all(np.hypot(ahead, aside) <= 15 + half_diagonal)
        # Distance off the edge of the beam.
        edge = np.abs(aside) * np.cos(np.pi / 6) - ahead * np.sin(np.pi / 6)
        assert edge.max() <= half_diagonal
        middle = (np.arange(20, 36), np.full(16, 20))
        assert pings_in_sight(empty, geometry, views)[middle].tolist() == [1] * 16

    def test_no_cell_of_an_empty_disc_is_missed(self) -> None:
        empty = np.zeros((81, 81), dtype=bool)
        geometry = GridGeometry(RESOLUTION_M, (0.0, 0.0), empty.shape)
        counts = pings_in_sight(empty, geometry, looking((40, 40), max_range_m=3.0))
        rows, columns = np.indices(empty.shape) - 40
        np.testing.assert_array_equal(counts[np.hypot(rows, columns) <= 29.2], 1)

    def test_every_ping_counts_once_and_looks_in_from_outside(self) -> None:
        empty = np.zeros((3, 5), dtype=bool)
        geometry = GridGeometry(RESOLUTION_M, (0.0, 0.0), empty.shape)
        views = looking((0, 1), (2, 1), (-3, 1), (60, 1), max_range_m=1.0)
        np.testing.assert_array_equal(pings_in_sight(empty, geometry, views), 3)

    def test_nobody_sees_nothing(self) -> None:
        empty = np.zeros((3, 5), dtype=bool)
        geometry = GridGeometry(RESOLUTION_M, (0.0, 0.0), empty.shape)
        assert not pings_in_sight(empty, geometry, looking()).any()


#: A room whose eastern wall has a gap in the map; beyond it the map dreams of free space.
ROOM = cells(
    "########    ",
    "#......#....",
    "#......#....",
    "#......#....",
    "#...........",
    "#...........",
    "#...........",
    "#...........",
    "#......#....",
    "#......#....",
    "#......#....",
    "########    ",
)
CLOSED = ROOM.copy()
CLOSED[:, 7] = "#"


class TestDrivability:
    def test_free_space_behind_a_wall_leaks(self) -> None:
        result = drivability(align(make_map(ROOM), make_truth(CLOSED)), looking((3, 5)))
        # Of 10 × 4 cells called free behind the wall, the column beside it is within one cell of
        # one in sight.
        free = np.count_nonzero(ROOM == ".")
        assert result.leak == pytest.approx(30 / free)

    def test_a_robot_escapes_through_a_gap_that_is_wide_enough(self) -> None:
        maps = align(make_map(ROOM), make_truth(CLOSED))
        result = drivability(maps, looking((3, 5)))
        # It fits through the four cells of the gap, of which two are far enough from the wall's
        # ends, and then gets everywhere but within two cells of the wall.
        open_ = reachable(maps.free, maps.predicted, maps.geometry, looking((3, 5)).positions_m)
        assert open_[:, 7].tolist() == [row in (5, 6) for row in range(12)]
        assert result.escape_m2 == pytest.approx(30 * RESOLUTION_M**2)

    def test_no_robot_escapes_where_the_gap_is_closed(self) -> None:
        result = drivability(align(make_map(CLOSED), make_truth(CLOSED)), looking((3, 5)))
        assert result.leak > 0.2
        assert result.escape_m2 == 0.0

    def test_a_robot_does_not_fit_through_a_narrow_gap(self) -> None:
        narrow = CLOSED.copy()
        narrow[5:7, 7] = "."
        result = drivability(align(make_map(narrow), make_truth(CLOSED)), looking((3, 5)))
        assert result.escape_m2 == 0.0

    def test_unknown_cells_are_closed_but_do_not_keep_their_distance(self) -> None:
        unknown = CLOSED.copy()
        unknown[:, 7] = " "
        views = looking((3, 5))
        closed = drivability(align(make_map(unknown), make_truth(CLOSED)), views)
        assert closed.escape_m2 == 0.0
        unknown[5, 7] = "."
        ajar = drivability(align(make_map(unknown), make_truth(CLOSED)), views)
        assert ajar.escape_m2 == pytest.approx(30 * RESOLUTION_M**2)

    def test_walls_seen_twice_and_called_free_are_lost(self) -> None:
        truth = CLOSED.copy()
        truth[:, 8:] = " "
        # All of the eastern wall is seen, of which the map holds one end up to the gap.
        views = looking((3, 5), (3, 6))
        sightings = pings_in_sight(truth == "#", geometry_of(truth), views)
        known = np.count_nonzero((truth == "#") & (sightings >= 2))
        result = drivability(align(make_map(ROOM), make_truth(truth)), views)
        # Four cells called free, of which the outer two have a predicted one beside them.
        assert result.lost == pytest.approx(2 / known)

    def test_walls_seen_once_cannot_be_lost(self) -> None:
        result = drivability(align(make_map(ROOM), make_truth(CLOSED)), looking((3, 5)))
        assert result.lost == 0.0


def test_reachable_starts_only_where_a_robot_was() -> None:
    drawing = cells("...#...", "...#...", "...#...")
    free, wall = drawing == ".", drawing == "#"
    got = reachable(free, wall, geometry_of(drawing), looking((5, 1)).positions_m)
    np.testing.assert_array_equal(got, np.tile([0, 0, 0, 0, 0, 1, 1], (3, 1)).astype(bool))
    nowhere = reachable(free, wall, geometry_of(drawing), looking((30, 30)).positions_m)
    assert not nowhere.any()


def test_a_score_without_views_says_that_it_does_not_know() -> None:
    result = score(make_map(ROOM), make_truth(CLOSED))
    assert np.isnan([result.leak, result.lost, result.escape_m2]).all()
    seen = score(make_map(ROOM), make_truth(CLOSED), looking((3, 5)))
    assert seen.escape_m2 == pytest.approx(0.3)
