"""Every scenario in config/ can be loaded, simulated and judged."""

from pathlib import Path

import numpy as np
import pytest

from usmap_ros.simulation import Scenario, simulate

FOLDER = Path(__file__).parents[3] / "config" / "scenarios"
FILES = sorted(FOLDER.glob("*.yaml"))


def test_there_are_some():
    assert {"poles", "room", "nav2_map"} <= {path.stem for path in FILES}


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_shipped_scenario_works(path):
    scenario = Scenario.load(path)
    assert scenario.description
    short = Scenario.from_mapping(scenario.model_dump() | {"duration_s": 0.5}, path)
    heard = 0
    pings = list(simulate(short))
    for _, trace in pings:
        trace.validate()
        heard += np.abs(trace.signal()).max() > 8.0 * trace.noise_std
    assert len(pings) == short.ping_count
    assert heard > len(pings) / 4
    assert short.truth_map().occupied.any()


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_robots_keep_inside_the_truth_map(path):
    scenario = Scenario.load(path)
    x_min, x_max, y_min, y_max = scenario.truth_map().geometry.extent_m
    for robot in scenario.fleet(scenario.scene()):
        for time_s in np.linspace(0.0, scenario.duration_s, 60):
            x, y, _ = robot.motion.pose(time_s).position_m
            assert x_min <= x <= x_max
            assert y_min <= y <= y_max
