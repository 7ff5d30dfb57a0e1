"""What stands in front of a cell keeps it from being heard, as far as the map believes in it."""

from collections.abc import Callable

import numpy as np
import pytest

from usmap_ros.cone import EchoCone
from usmap_ros.mapping.footprint import Footprint, footprint
from usmap_ros.mapping.visibility import RAYS, Rays, cast_rays, visibility

RESOLUTION_M = 0.05
FREE = 1e-4
BELIEVED = 0.92


@pytest.fixture(scope="module")
def cells(make_cone: Callable[..., EchoCone]) -> Footprint:
    return footprint(make_cone(max_range_m=5.0), RESOLUTION_M)


@pytest.fixture(scope="module")
def rays(cells: Footprint) -> Rays:
    return cast_rays(cells, RESOLUTION_M)


@pytest.fixture(scope="module")
def x_m(cells: Footprint) -> np.ndarray:
    return (cells.columns + 0.5) * RESOLUTION_M


@pytest.mark.parametrize("probability", [0.0, FREE])
def test_everything_is_visible_in_an_empty_map(
    cells: Footprint, rays: Rays, probability: float
) -> None:
    seen = visibility(rays, np.full(len(cells.range_m), probability))
    np.testing.assert_allclose(seen, 1.0, atol=100 * probability)
    assert np.all(seen <= 1.0)


@pytest.mark.parametrize("wall_m", [0.4, 0.7, 1.0, 2.0, 4.0])
def test_nothing_behind_a_believed_wall_is_audible(
    rays: Rays, x_m: np.ndarray, wall_m: float
) -> None:
    inside = (x_m > wall_m) & (x_m < wall_m + 3 * RESOLUTION_M)
    seen = visibility(rays, np.where(inside, BELIEVED, FREE))
    # Beyond the two cells that a surface is taken to be thick along the slanting rays, too.
    behind = x_m > wall_m + 6 * RESOLUTION_M
    assert np.max(seen[behind]) < 0.1
    assert np.min(seen[x_m < wall_m]) > 0.95


def test_a_surface_does_not_hide_itself(cells: Footprint, rays: Rays, x_m: np.ndarray) -> None:
    inside = (x_m > 1.0) & (x_m < 1.0 + RESOLUTION_M)
    seen = visibility(rays, np.where(inside, BELIEVED, FREE))
    ahead = np.abs(cells.bearing_rad) < 0.2
    assert np.min(seen[inside & ahead]) > 0.95


def test_a_pole_hides_only_what_stands_in_its_shadow(cells: Footprint, rays: Rays) -> None:
    pole = int(np.argmin(np.hypot(cells.range_m - 1.0, cells.bearing_rad - 0.2)))
    probability = np.full(len(cells.range_m), FREE)
    probability[pole] = BELIEVED
    seen = visibility(rays, probability)
    off_rad = np.abs(cells.bearing_rad - cells.bearing_rad[pole])
    half_width_rad = 0.5 * RESOLUTION_M / cells.range_m[pole]
    behind = cells.range_m > cells.range_m[pole] + 3 * RESOLUTION_M
    assert np.max(seen[behind & (off_rad < 0.3 * half_width_rad)]) < 0.6
    ray_rad = 2 * cells.bearing_rad.max() / RAYS
    assert np.min(seen[behind & (off_rad > half_width_rad + ray_rad)]) > 0.95


def test_the_more_a_wall_is_believed_in_the_more_it_hides(rays: Rays, x_m: np.ndarray) -> None:
    wall = (x_m > 1.0) & (x_m < 1.1)
    behind = x_m > 1.4
    seen = [
        visibility(rays, np.where(wall, belief, 0.0))[behind].mean()
        for belief in (0.0, 0.1, 0.5, 0.9, 1.0)
    ]
    assert np.all(np.diff(seen) < 0.0)
    assert seen[0] == 1.0
    assert seen[-1] > 0.0


def test_a_beam_without_cells_is_no_trouble(make_cone: Callable[..., EchoCone]) -> None:
    nothing = footprint(make_cone(min_range_m=0.1, max_range_m=0.1001), RESOLUTION_M)
    assert len(nothing.range_m) == 0
    assert len(visibility(cast_rays(nothing, RESOLUTION_M), np.zeros(0))) == 0
