"""The shipped costmaps let a robot move: nothing stays marked that nobody clears."""

import sys
from pathlib import Path

import numpy as np
import pytest

from usmap_ros.grids import GridGeometry, OccupancyMap
from usmap_ros.simulation import Scenario

ROOT = Path(__file__).parents[2]


@pytest.fixture
def costmap(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    for name in ("costmap", "nav2_layers"):
        sys.modules.pop(name, None)
    import costmap

    return costmap


def test_the_local_costmap_has_the_map_and_no_layer_that_only_marks(costmap) -> None:
    settings = costmap.layer_settings()
    assert settings["plugins"][0] == "static_layer"
    assert settings["range_layer"]["phi"] <= 1.2
    # An echo sets one cell straight ahead to 233: seen at once, and gone with the first doubt.
    assert 220 < int(settings["range_layer"]["mark_threshold"] * costmap.LETHAL) < 233
    for name in settings["plugins"]:
        layer = settings[name]
        for source in layer.get("observation_sources", "").split():
            assert layer[source]["clearing"], f"{name} marks for ever what {source} says"


def test_a_ping_without_an_echo_clears_what_one_with_an_echo_marked(costmap) -> None:
    from types import SimpleNamespace

    window = costmap.Window(0.05, 120, 127)
    layer = costmap.RangeLayer(window, costmap.layer_settings()["range_layer"])
    heard = SimpleNamespace(min_range=0.2, max_range=2.0, range=0.8, field_of_view=1.4)
    master = np.full((120, 120), costmap.UNKNOWN, np.uint8)
    for _ in range(5):
        layer.take(heard, (3.0, 3.0), 0.0)
    layer.apply(master)
    assert master[60, 76] == costmap.LETHAL
    assert master[60, 68] == costmap.FREE
    layer.take(SimpleNamespace(**{**vars(heard), "range": 2.0}), (3.0, 3.0), 0.0)
    master[:] = costmap.UNKNOWN
    layer.apply(master)
    assert master[60, 76] == costmap.FREE


def test_a_window_rolls_by_whole_cells_and_forgets_what_it_leaves(costmap) -> None:
    window = costmap.Window(0.5, 4, 9)
    window.values[:] = np.arange(16).reshape(4, 4)
    window.roll((1.6, 1.0))
    np.testing.assert_array_equal(window.corner, [1, 0])
    np.testing.assert_array_equal(window.values[0], [1, 2, 3, 9])
    window.roll((1.6, 0.4))
    np.testing.assert_array_equal(window.corner, [1, -1])
    np.testing.assert_array_equal(window.values[:2], [[9, 9, 9, 9], [1, 2, 3, 9]])
    window.roll((20.0, 20.0))
    assert (window.values == 9).all()


def test_the_shipped_costmap_does_not_box_the_robot_in(costmap) -> None:
    scenario = Scenario.load(ROOT / "config/scenarios/room.yaml")
    scenario = scenario.model_copy(update={"duration_s": 3.0})
    shares, _, _ = costmap.drive(scenario, costmap.layer_settings())
    shipped, uncleared, cleared = shares.values()
    assert np.mean(shipped.boxed) == 0.0
    assert shipped.false_lethal[-1] < 0.5 * uncleared.false_lethal[-1]
    assert shipped.free[-1] > 0.1
    # Rays clear much of what single pings mark all around.
    assert cleared.false_lethal[-1] < 0.9 * uncleared.false_lethal[-1]


def test_a_planner_says_in_one_line_that_there_is_no_way(
    costmap, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    from planner import NoPathError, plan

    log_odds = np.full((60, 60), -4.0, np.float32)
    # A closed ring of walls, with the start inside of it.
    log_odds[20:41, [20, 40]] = log_odds[[20, 40], 20:41] = 4.0
    geometry = GridGeometry(0.05, (0.0, 0.0), log_odds.shape)
    walled = OccupancyMap(geometry, log_odds, np.ones(log_odds.shape, bool), "map", 0)
    assert len(plan(walled, (1.5, 1.5), (1.4, 1.6))) > 1
    with pytest.raises(NoPathError, match=r"no path leads from \(1.5, 1.5\) m to \(0.3, 0.3\) m"):
        plan(walled, (1.5, 1.5), (0.3, 0.3))
    with pytest.raises(NoPathError, match=r"\(9, 0.3\) m lies outside of the map"):
        plan(walled, (1.5, 1.5), (9.0, 0.3))
