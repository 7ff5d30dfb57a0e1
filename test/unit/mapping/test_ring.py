"""Which cells an echo may have come from, and how well it fits each of them."""

from collections.abc import Callable

import numpy as np
import pytest

from usmap_ros.mapping.footprint import footprint
from usmap_ros.mapping.ring import find_ring
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

PARAMETERS = MappingParameters()
MakeCone = Callable[..., EchoCone]


@pytest.mark.parametrize("planar_covariance", [None, np.diag([9e-4, 9e-4, 1e-4])])
def test_find_ring_pairs_each_echo_with_all_cells_whose_range_it_fits(
    make_cone: MakeCone, planar_covariance: np.ndarray | None
) -> None:
    cone = make_cone(0.7, 0.72, 1.4, 2.9, x_m=0.013, planar_covariance=planar_covariance)
    cells = footprint(cone, 0.05)
    ring = find_ring(cone, cells, PARAMETERS)
    found = set(zip(ring.cells[ring.cell].tolist(), ring.echo.tolist(), strict=True))
    expected = {
        (cell, echo)
        for cell in range(len(cells.range_m))
        for echo, range_m in enumerate(cone.ranges_m)
        if abs(range_m - cells.range_m[cell])
        < cells.half_depth_m[cell] + 3.0 * np.hypot(cells.range_std_m[cell], 0.003)
    }
    assert len(expected) > 100
    assert found == expected
    assert len(np.unique(ring.cells)) == len(ring.cells)


def test_a_silent_cone_has_no_ring(make_cone: MakeCone) -> None:
    cone = make_cone()
    cells = footprint(cone, 0.05)
    ring = find_ring(cone, cells, PARAMETERS)
    assert (len(ring.cells), len(ring.cell), ring.echo_count) == (0, 0, 0)


@pytest.mark.parametrize("row", [0, 6, 20], ids=["along a side", "aslant", "across a corner"])
def test_the_range_fit_is_that_of_an_object_anywhere_in_the_square(
    make_cone: MakeCone, row: int
) -> None:
    """By Monte Carlo: objects spread over the cell, ranges with the stated error."""
    resolution_m, column, x_m, y_m = 0.05, 20, 0.0125, 0.02
    center_m = (np.array([column, row]) + 0.5) * resolution_m
    yaw_rad = np.arctan2(center_m[1] - y_m, center_m[0] - x_m)
    echoes_m = np.hypot(*(center_m - [x_m, y_m])) + np.linspace(-0.045, 0.045, 7)
    parameters = MappingParameters(range_error_m=0.006)
    cone = make_cone(*echoes_m, x_m=x_m, y_m=y_m, yaw_rad=yaw_rad)
    cells = footprint(cone, resolution_m)
    ring = find_ring(cone, cells, parameters)
    place = int(np.flatnonzero((cells.rows == row) & (cells.columns == column))[0])
    pairs = np.flatnonzero(ring.cells[ring.cell] == place)
    assert len(pairs) >= 5

    generator = np.random.default_rng(1)
    objects_m = center_m + generator.uniform(-0.5, 0.5, (400_000, 2)) * resolution_m
    ranges_m = np.hypot(*(objects_m - [x_m, y_m]).T)
    ranges_m += np.hypot(0.006, 1e-3) * generator.standard_normal(len(ranges_m))
    width_m = 0.004
    share = [np.mean(np.abs(ranges_m - echoes_m[echo]) < width_m / 2) for echo in ring.echo[pairs]]
    # A density, scaled to the plateau of a box as deep as the square's projection at half height.
    plateau_m = 2.0 * cells.half_depth_m[place] - cells.taper_m[place]
    expected = np.array(share) * plateau_m / width_m
    np.testing.assert_allclose(ring.range_fit[pairs], expected, atol=0.06)


def test_an_amplitude_is_read_as_the_reflectivity_it_would_need(make_cone: MakeCone) -> None:
    cone = make_cone((1.0, 0.4), amplitude_std=0.04, attenuation_db_m=2.0)
    cells = footprint(cone, 0.05)
    ring = find_ring(cone, cells, PARAMETERS)
    place = ring.cells[ring.cell]
    spreading = cells.range_m[place] ** -2 * 10 ** (-2.0 * 2.0 * cells.range_m[place] / 20)
    gain = 1.0 - np.abs(cells.bearing_rad[place]) / np.deg2rad(40)
    np.testing.assert_allclose(
        ring.log_reflectivity, np.log(0.4 / (gain * spreading)), rtol=1e-5, atol=1e-5
    )
    np.testing.assert_allclose(ring.variance, 0.1**2 + PARAMETERS.fluctuation**2, rtol=1e-5)
