"""The rectangle of a map has a limit."""

import numpy as np
import pytest
from scipy.special import logit

from usmap_ros.errors import MapSizeError
from usmap_ros.mapping.export import EXPOSURE, LOG_ODDS, as_map
from usmap_ros.mapping.grid import TiledGrid
from usmap_ros.parameters import MappingParameters


def grid_of(*places_m: tuple[float, float]) -> TiledGrid:
    """Grid of 5 cm cells in which one cell at each place is taken for free."""
    grid = TiledGrid(0.05, {LOG_ODDS: float(logit(MappingParameters().prior)), EXPOSURE: 0.0})
    x, y = np.rint(np.transpose(places_m) / 0.05).astype(np.intp)
    slots = grid.slots(y, x)
    grid.layer(LOG_ODDS)[slots] = -5.0
    grid.layer(EXPOSURE)[slots] = 10.0
    return grid


def test_robots_that_are_too_far_apart_are_refused_in_one_line() -> None:
    grid = grid_of((0.0, 0.0), (3000.0, 3000.0))
    with pytest.raises(MapSizeError, match=r"3000 m x 3000 m .* larger cells") as error:
        as_map(grid, MappingParameters(), "map", 0)
    assert "\n" not in str(error.value)


def test_a_long_corridor_is_not() -> None:
    occupancy = as_map(grid_of((0.0, 0.0), (3000.0, 1.0)), MappingParameters(), "map", 0)
    assert occupancy.geometry.shape == (21, 60_001)
