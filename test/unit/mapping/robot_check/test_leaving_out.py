"""What a robot said that lies is taken back."""

import numpy as np
import pytest

import usmap_ros
from usmap_ros.mapping.fusion import Fusion
from usmap_ros.parameters import MappingParameters, PipelineParameters

PLACES = [(0.0, 0.0), (0.5, 0.2), (1.0, -0.4), (1.2, 0.5), (1.5, 1.2), (0.7, 0.9), (2.4, 1.4)]


def pipeline(window: int = 600) -> usmap_ros.Pipeline:
    return usmap_ros.Pipeline(PipelineParameters(mapping=MappingParameters(window=window)))


def expect_ping(
    made: usmap_ros.Pipeline, pole_m: tuple[float, float], source: str, count: int
) -> None:
    for x_m, y_m in PLACES[:count]:
        pose = usmap_ros.Pose.planar(x_m, y_m, float(np.arctan2(0.3 - y_m, 2.0 - x_m)))
        cone = made.reconstruct(usmap_ros.hear([pole_m], pose=pose))
        made.fuse(cone, source)


def poles_m(fusion: Fusion) -> np.ndarray:
    occupancy = fusion.occupancy_map()
    return occupancy.geometry.cell_centers_m(*np.nonzero(occupancy.predicted()))


@pytest.mark.parametrize("count", [3, 7])
def test_what_only_the_liar_heard_is_gone_at_once(count: int) -> None:
    """With few pings, and with many."""
    made = pipeline()
    expect_ping(made, (2.0, 0.3), "/robot1/cone", count)
    expect_ping(made, (2.4, 0.5), "/robot9/cone", count)
    assert made.fusion.leave_out(lambda source: source == "/robot9/cone") == count
    found_m = poles_m(made.fusion)
    assert len(found_m) > 0
    assert np.abs(found_m - [2.0, 0.3]).max() < 0.1


def test_the_rest_is_the_map_of_the_others() -> None:
    """Whoever else had been there: the first few pings are explained from the start."""
    made, alone = pipeline(), pipeline()
    expect_ping(made, (2.0, 0.3), "/robot1/cone", 4)
    expect_ping(made, (2.4, 0.5), "/robot9/cone", 1)
    made.fusion.leave_out(lambda source: source == "/robot9/cone")
    expect_ping(alone, (2.0, 0.3), "/robot1/cone", 4)
    np.testing.assert_array_equal(poles_m(made.fusion), poles_m(alone.fusion))


def test_with_nobody_left_nothing_is_known() -> None:
    made = pipeline()
    expect_ping(made, (2.0, 0.3), "/robot1/cone", 7)
    assert made.fusion.occupancy_map().observed.any()
    assert made.fusion.leave_out(lambda source: True) == 7
    assert not made.fusion.occupancy_map().observed.any()
    expect_ping(made, (2.0, 0.3), "/robot1/cone", 7)
    assert len(poles_m(made.fusion)) > 0


def test_what_has_left_the_window_stays() -> None:
    made = pipeline(window=3)
    expect_ping(made, (2.0, 0.3), "/robot1/cone", 7)
    assert made.fusion.leave_out(lambda source: True) == 3
    assert made.fusion.occupancy_map().observed.any()


def test_who_said_nothing_changes_nothing() -> None:
    made = pipeline()
    expect_ping(made, (2.0, 0.3), "/robot1/cone", 5)
    before = made.fusion.occupancy_map().log_odds
    assert made.fusion.leave_out(lambda source: source == "/robot9/cone") == 0
    np.testing.assert_array_equal(made.fusion.occupancy_map().log_odds, before)
