"""The rectangle of cells grows where it is asked to, as far as a map may reach."""

from collections.abc import Callable

import numpy as np
import pytest

from usmap_ros.errors import MapSizeError
from usmap_ros.mapping.yardsticks.range_only import RangeSensorFusion
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

MakeCone = Callable[..., EchoCone]


def test_robots_that_are_too_far_apart_are_refused_in_one_line(make_cone: MakeCone) -> None:
    fusion = RangeSensorFusion(MappingParameters())
    fusion.fuse(make_cone(1.0))
    before = fusion.occupancy_map()
    with pytest.raises(MapSizeError, match=r"300\d m x 300\d m .* larger cells") as error:
        fusion.fuse(make_cone(1.0, x_m=3000.0, y_m=3000.0))
    assert "\n" not in str(error.value)
    np.testing.assert_array_equal(fusion.occupancy_map().log_odds, before.log_odds)


def test_a_long_corridor_is_not(make_cone: MakeCone) -> None:
    fusion = RangeSensorFusion(MappingParameters())
    fusion.fuse(make_cone(1.0))
    fusion.fuse(make_cone(1.0, x_m=500.0))
    rows, columns = fusion.occupancy_map().geometry.shape
    assert rows < 100
    assert columns > 10_000
    assert fusion.memory_bytes < 2 * 4 * 200 * 11_000


@pytest.mark.parametrize("toward_m", [(20.0, 0.0), (-20.0, 0.0), (0.0, 20.0), (-20.0, -20.0)])
def test_growing_in_any_direction_shifts_nothing(
    make_cone: MakeCone, toward_m: tuple[float, float]
) -> None:
    fusion = RangeSensorFusion(MappingParameters())
    fusion.fuse(make_cone(1.0))
    alone = fusion.occupancy_map()
    fusion.fuse(make_cone(1.0, x_m=toward_m[0], y_m=toward_m[1]))
    grown = fusion.occupancy_map()
    left, top = np.subtract(alone.geometry.first_cell, grown.geometry.first_cell)
    rows, columns = alone.geometry.shape
    part = grown.log_odds[top : top + rows, left : left + columns]
    np.testing.assert_array_equal(part, alone.log_odds)
    assert np.count_nonzero(grown.observed) == 2 * np.count_nonzero(alone.observed)
