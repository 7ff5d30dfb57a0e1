"""The truth map."""

import numpy as np
import pytest

from usmap_ros.grids import FREE_VALUE, OCCUPIED_VALUE, UNKNOWN_VALUE, GridGeometry
from usmap_ros.io.nav2_map import save_nav2_map
from usmap_ros.simulation import Scenario


def truth(world, resolution=0.05, source="file.yaml"):
    content = {"world": world, "robots": [{"name": "robot1"}]}
    return Scenario.from_mapping(content, source).truth_map(resolution)


def occupied_centers(truth_map):
    return truth_map.geometry.cell_centers_m(*np.nonzero(truth_map.occupied))


def test_points_occupy_the_cells_that_they_stand_in():
    world = {"area_m": [-1, 1, -1, 1], "points": [{"x_m": -0.51, "y_m": 0.33}]}
    found = truth(world)
    assert found.geometry == GridGeometry(0.05, (-1.0, -1.0), (40, 40))
    np.testing.assert_allclose(occupied_centers(found), [[-0.525, 0.325]])


@pytest.mark.parametrize("resolution", [0.03, 0.05, 0.1])
def test_the_origin_is_a_multiple_of_the_resolution(resolution):
    geometry = truth({"area_m": [0.12, 3.21, -0.47, 1.93]}, resolution).geometry
    for origin, lowest in zip(geometry.origin_m, (0.12, -0.47), strict=True):
        assert origin / resolution == pytest.approx(round(origin / resolution))
        assert lowest - resolution < origin <= lowest + 1e-9
    assert geometry.extent_m[1] >= 3.21
    assert geometry.extent_m[3] >= 1.93


def test_cylinders_occupy_their_surface():
    world = {"area_m": [0, 2, 0, 2], "cylinders": [{"x_m": 1, "y_m": 1, "radius_m": 0.49}]}
    centers = occupied_centers(truth(world))
    from_surface = np.abs(np.hypot(*(centers - 1.0).T) - 0.49)
    assert from_surface.max() <= 0.05 / np.sqrt(2.0)
    # A circle passes through 8 r / resolution cells, give or take one where it touches a line.
    assert len(centers) == pytest.approx(8 * 0.49 / 0.05, abs=4)


def test_walls_occupy_every_cell_that_they_pass_through():
    world = {"area_m": [0, 2, 0, 2], "walls": [{"corners_m": [[0.02, 0.01], [1.98, 1.57]]}]}
    found = truth(world, 0.1)
    # No gap: neighbours along the wall share a side.
    rows, columns = np.nonzero(found.occupied)
    assert len(rows) == (columns.max() - columns.min()) + (rows.max() - rows.min()) + 1


def test_what_moves_is_not_part_of_it():
    world = {"area_m": [0, 2, 0, 2], "moving": [{"waypoints_m": [[0.5, 0.5], [1.5, 1.5]]}]}
    assert not truth(world).occupied.any()


def write_map(folder):
    values = np.full((20, 30), FREE_VALUE, dtype=np.int8)
    values[5:10, 5:12] = OCCUPIED_VALUE
    values[:, 25:] = UNKNOWN_VALUE
    values[12:15, 23:28] = OCCUPIED_VALUE
    save_nav2_map(folder / "map.yaml", GridGeometry(0.05, (-0.5, 0.25), (20, 30)), values)
    return values


def test_of_a_map_the_cells_that_border_on_free_ones_count(tmp_path):
    values = write_map(tmp_path)
    found = truth({"map": {"path": "map.yaml"}}, source=tmp_path / "file.yaml")
    assert found.geometry.shape == values.shape
    np.testing.assert_allclose(found.geometry.origin_m, (-0.5, 0.25))
    expected = values == OCCUPIED_VALUE
    expected[6:9, 6:11] = False  # deep inside
    expected[12:15, 26:] = False  # beside unknown cells only
    expected[13, 24:26] = False
    np.testing.assert_array_equal(found.occupied, expected)


@pytest.mark.parametrize("resolution", [0.01, 0.025, 0.1])
def test_a_map_may_be_judged_at_another_resolution(tmp_path, resolution):
    write_map(tmp_path)
    source = tmp_path / "file.yaml"
    same = truth({"map": {"path": "map.yaml"}}, source=source)
    other = truth({"map": {"path": "map.yaml"}}, resolution, source)
    for row, column in np.argwhere(other.occupied):
        center = other.geometry.cell_centers_m(row, column)
        apart = np.abs(occupied_centers(same) - center).max(axis=1)
        assert apart.min() <= (0.05 + resolution) / 2.0 + 1e-9
    area = other.occupied.sum() * resolution**2
    if resolution < 0.05:
        assert area == pytest.approx(same.occupied.sum() * 0.05**2, rel=0.01)
