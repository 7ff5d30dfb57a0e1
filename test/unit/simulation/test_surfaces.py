"""Walls, their roughness, and the walls of a map."""

import numpy as np
import pytest

from usmap_ros.simulation.occlusion import NO_OWNER, hidden_by_walls, point_segment_distances
from usmap_ros.simulation.surfaces import Surface, WallSegments, scatter_along, walls_of_cells


def scattered(density=40.0, roughness=0.005, length=10.0, seed=3):
    surface = Surface(diffuse_reflectivity=2.0, scatterers_per_m=density, roughness_m=roughness)
    walls = WallSegments.along(np.array([[0.0, 0.0], [length, 0.0], [length, length]]), surface)
    return walls, scatter_along(walls, surface, np.random.default_rng(seed))


def test_scatterers_lie_along_their_walls_in_front():
    walls, scatterers = scattered()
    np.testing.assert_array_equal(np.bincount(scatterers.walls), [400, 400])
    starts, ends = walls.starts_m[scatterers.walls], walls.ends_m[scatterers.walls]
    assert point_segment_distances(scatterers.positions_m, starts, ends).max() <= 0.005
    side = np.sum((scatterers.positions_m - starts) * walls.normals[scatterers.walls], axis=-1)
    assert side.min() >= 0.0


@pytest.mark.parametrize("density", [20.0, 80.0])
def test_scattered_energy_does_not_depend_on_the_density(density):
    _, scatterers = scattered(density, length=50.0)
    energy_per_m = np.sum(scatterers.reflectivities**2) / 100.0
    assert energy_per_m == pytest.approx(2.0**2, rel=0.1)


def test_roughness_is_drawn_from_the_generator_alone():
    _, first = scattered(seed=1)
    _, again = scattered(seed=1)
    _, other = scattered(seed=2)
    np.testing.assert_array_equal(first.positions_m, again.positions_m)
    assert not np.array_equal(first.positions_m, other.positions_m)


def test_a_smooth_surface_has_no_scatterers():
    surface = Surface(specular_reflectivity=0.5, diffuse_reflectivity=0.0)
    walls = WallSegments.along(np.array([[0.0, 0.0], [1.0, 0.0]]), surface)
    assert len(scatter_along(walls, surface, np.random.default_rng(0)).reflectivities) == 0


def test_one_cell_has_four_walls_that_look_outwards():
    occupied = np.zeros((3, 4), dtype=bool)
    occupied[1, 2] = True
    starts, ends = walls_of_cells(occupied, 0.5, (10.0, -1.0))
    assert len(starts) == 4
    np.testing.assert_allclose(np.hypot(*(ends - starts).T), 0.5)
    middle = (starts + ends) / 2.0
    center = np.array([10.0 + 2.5 * 0.5, -1.0 + 1.5 * 0.5])
    normals = WallSegments.between(starts, ends, Surface(), one_sided=True).normals
    np.testing.assert_allclose(middle + 0.25 * -normals, np.tile(center, (4, 1)))


def test_straight_runs_of_cells_make_one_wall():
    occupied = np.zeros((5, 20), dtype=bool)
    occupied[2, 1:19] = True
    starts, ends = walls_of_cells(occupied, 0.05, (0.0, 0.0))
    lengths = np.sort(np.hypot(*(ends - starts).T))
    np.testing.assert_allclose(lengths, [0.05, 0.05, 0.9, 0.9])


def test_walls_go_round_cells_at_the_border_of_the_map():
    starts, ends = walls_of_cells(np.ones((2, 3), dtype=bool), 1.0, (0.0, 0.0))
    assert np.hypot(*(ends - starts).T).sum() == pytest.approx(10.0)


def test_walls_around_cells_are_closed():
    cells = np.random.default_rng(5).random((12, 15)) < 0.4
    starts, ends = walls_of_cells(cells, 0.1, (0.0, 0.0))
    # Walking along all of them leads back: every corner is left as often as it is reached.
    left, left_counts = np.unique(np.rint(starts * 10), axis=0, return_counts=True)
    reached, reached_counts = np.unique(np.rint(ends * 10), axis=0, return_counts=True)
    np.testing.assert_array_equal(left, reached)
    np.testing.assert_array_equal(left_counts, reached_counts)


def test_what_is_hidden_by_walls_is_what_cells_are_in_front_of():
    rng = np.random.default_rng(6)
    cells = rng.random((30, 30)) < 0.08
    cells[15, 15] = False
    starts, ends = walls_of_cells(cells, 0.1, (0.0, 0.0))
    origin = np.array([1.55, 1.55])
    targets = rng.uniform(0.0, 3.0, (300, 2))
    hidden = hidden_by_walls(origin, targets, starts, ends, np.full(300, NO_OWNER))
    steps = np.linspace(0.0, 1.0, 3000)[:, np.newaxis]
    for target, is_hidden in zip(targets, hidden, strict=True):
        column, row = (np.floor((origin + steps * (target - origin)) / 0.1).astype(int)).T
        inside = np.count_nonzero(cells[row, column])
        # A corner that is just touched may go either way.
        assert is_hidden == (inside > 0) or inside < 5
