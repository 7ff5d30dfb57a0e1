"""Gaps in walls that nothing could drive through are closed, and no others."""

import numpy as np
import pytest

from usmap_ros.grids import GridGeometry, OccupancyMap
from usmap_ros.mapping.continuity import bridge_gaps


def map_of(rows: list[str]) -> OccupancyMap:
    """A map of cells of 5 cm: believed where there is a #, free elsewhere."""
    believed = np.array([[cell == "#" for cell in row] for row in rows])
    log_odds = np.where(believed, np.float32(2.5), np.float32(-5.0))
    geometry = GridGeometry(0.05, (0.0, 0.0), believed.shape)
    return OccupancyMap(geometry, log_odds, np.ones(believed.shape, dtype=bool), "map")


def drawn(occupancy: OccupancyMap) -> list[str]:
    return ["".join("#" if cell else "." for cell in row) for row in occupancy.predicted()]


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (["#.#"], ["###"]),
        (["#....#"], ["######"]),
        (["#.....#"], ["#.....#"]),
        (["#..", "...", "..#"], ["#..", ".#.", "..#"]),
        (["#....", "....."], ["#....", "....."]),
    ],
    ids=["one cell", "four cells", "five cells stay open", "oblique", "a lone cell"],
)
def test_gaps_of_up_to_20_cm_are_closed(before: list[str], after: list[str]) -> None:
    assert drawn(bridge_gaps(map_of(before), 0.2)) == after


def test_bridged_cells_count_as_observed() -> None:
    occupancy = map_of(["#.#"])
    occupancy.observed[0, 1] = False
    assert bridge_gaps(occupancy, 0.2).observed.all()


def test_without_a_gap_nothing_changes() -> None:
    occupancy = map_of(["#.#"])
    assert bridge_gaps(occupancy, 0.0) is occupancy
