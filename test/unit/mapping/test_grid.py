"""The tiled grid grows where it is asked to, and what is in it stays where it is."""

import numpy as np
import pytest

from usmap_ros.mapping.grid import TILE_CELLS, TILE_SIDE, TiledGrid

FAR = 5 * TILE_SIDE


@pytest.fixture
def grid() -> TiledGrid:
    return TiledGrid(0.1, {"height": 0.25, "count": 0.0})


def slot(grid: TiledGrid, row: int, column: int) -> int:
    return int(grid.slots(np.array([row]), np.array([column]))[0])


def tiles(grid: TiledGrid) -> float:
    """Tiles in memory, by what their two layers take."""
    return grid.memory_bytes / (2 * 4 * TILE_CELLS)


def test_a_new_grid_holds_nothing(grid: TiledGrid) -> None:
    assert tiles(grid) == 0
    assert len(grid.layer("height")) == 0
    assert all(len(part) == 0 for part in grid.cells(np.zeros(0, dtype=bool)))


def test_asking_for_no_cell_adds_no_tile(grid: TiledGrid) -> None:
    nothing = np.zeros(0, dtype=np.intp)
    assert len(grid.slots(nothing, nothing)) == 0
    assert tiles(grid) == 0


def test_every_layer_starts_from_its_own_default(grid: TiledGrid) -> None:
    slot(grid, 3, -4)
    np.testing.assert_array_equal(grid.layer("height"), np.float32(0.25))
    np.testing.assert_array_equal(grid.layer("count"), np.float32(0.0))


@pytest.mark.parametrize("toward", [(FAR, 0), (-FAR, 0), (0, FAR), (0, -FAR), (-FAR, -FAR)])
def test_growing_in_any_direction_shifts_nothing(grid: TiledGrid, toward: tuple[int, int]) -> None:
    before = slot(grid, 1, -2)
    grid.layer("height")[before] = 9.0
    beyond = slot(grid, 1 + toward[0], -2 + toward[1])
    grid.layer("height")[beyond] = 5.0

    assert slot(grid, 1, -2) == before
    assert grid.layer("height")[before] == 9.0
    rows, columns, slots = grid.cells(grid.layer("height") > 1.0)
    found = dict(zip(zip(rows.tolist(), columns.tolist(), strict=True), slots, strict=True))
    assert found == {(1, -2): before, (1 + toward[0], -2 + toward[1]): beyond}


def test_memory_is_taken_only_where_something_was_observed(grid: TiledGrid) -> None:
    slot(grid, 0, 0)
    slot(grid, 200 * TILE_SIDE, -300 * TILE_SIDE)
    assert tiles(grid) == 2
    # The pool may hold a spare tile or two, but never the rectangle between the cells.
    assert len(grid.layer("height")) <= 4 * TILE_CELLS


def test_the_cells_of_one_tile_have_slots_of_their_own(grid: TiledGrid) -> None:
    rows, columns = np.mgrid[-TILE_SIDE:0, 0:TILE_SIDE].reshape(2, -1)
    slots = grid.slots(rows, columns)
    assert tiles(grid) == 1
    assert len(np.unique(slots)) == TILE_CELLS


def test_tiles_that_were_never_asked_for_are_not_among_the_cells(grid: TiledGrid) -> None:
    for number in range(7):
        slot(grid, 0, number * TILE_SIDE)
    rows, columns, _ = grid.cells(np.ones(len(grid.layer("count")), dtype=bool))
    assert len(rows) == 7 * TILE_CELLS
    assert (rows.min(), rows.max()) == (0, TILE_SIDE - 1)
    assert (columns.min(), columns.max()) == (0, 7 * TILE_SIDE - 1)
