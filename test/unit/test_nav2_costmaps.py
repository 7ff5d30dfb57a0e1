"""The shipped costmaps let a robot move: nothing stays marked that nobody clears."""

import sys
from pathlib import Path

import numpy as np
import pytest

from usmap_ros.simulation import Scenario

ROOT = Path(__file__).parents[2]


@pytest.fixture
def costmap(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    sys.modules.pop("costmap", None)
    import costmap

    return costmap


def test_the_local_costmap_has_the_map_and_no_layer_that_only_marks(costmap) -> None:
    settings = costmap.layer_settings()
    assert settings["plugins"][0] == "static_layer"
    assert settings["range_layer"]["phi"] <= 1.2
    for name in settings["plugins"]:
        layer = settings[name]
        for source in layer.get("observation_sources", "").split():
            assert layer[source]["clearing"], f"{name} marks for ever what {source} says"


def test_a_ping_without_an_echo_clears_what_one_with_an_echo_marked(costmap) -> None:
    from types import SimpleNamespace

    layer = costmap.RangeLayer((120, 120), 0.05, costmap.layer_settings()["range_layer"])
    heard = SimpleNamespace(min_range=0.2, max_range=2.0, range=0.8, field_of_view=1.4)
    for _ in range(5):
        layer.take(heard, 3.0, 3.0, 0.0)
    master = np.full((120, 120), costmap.UNKNOWN, np.uint8)
    layer.apply(master)
    assert master[60, 76] == costmap.LETHAL
    assert master[60, 68] == costmap.FREE
    layer.take(SimpleNamespace(**{**vars(heard), "range": 2.0}), 3.0, 3.0, 0.0)
    master[:] = costmap.UNKNOWN
    layer.apply(master)
    assert master[60, 76] == costmap.FREE


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
