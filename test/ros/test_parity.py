"""A bag mapped offline, and replayed through the nodes as processes, gives the same map."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from usmap_ros.grids import OCCUPIED_PROBABILITY, OccupancyMap
from usmap_ros.io.map_files import load_map

pytestmark = pytest.mark.slow

PINGS = 300
#: Ends a hang; a busy machine is far from it.
DEADLINE_S = 300.0
ROBOTS = ("robot1", "robot2", "robot3")


def usmap(*arguments: object) -> None:
    command = [sys.executable, "-m", "usmap_ros"]
    subprocess.run([*command, *map(str, arguments)], check=True, timeout=300)


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give a bag of the scenario 'poles'."""
    path = tmp_path_factory.mktemp("parity") / "poles"
    usmap("simulate", Path(__file__).parents[2] / "config/scenarios/poles.yaml", "-o", path)
    return path


def offline(bag: Path, folder: Path, settings: dict[str, Any]) -> OccupancyMap:
    """Map as 'usmap map' makes it."""
    options = [f"--set=reconstruction.{name}={value}" for name, value in settings.items()]
    usmap("map", bag, "-o", folder, *options)
    return load_map(folder)[0]


def replay(
    live: Any,
    processes: Any,
    diagnostics: Any,
    bag: Path,
    folder: Path,
    rate: float,
    settings: dict[str, Any],
) -> OccupancyMap:
    """Map that comes of replaying the bag through a reconstructor a robot, and fusion.

    With every wait and queue as it is by default, at whatever rate: the replay waits for all.
    """
    processes.start("map_fusion", save_path=folder, use_sim_time="true")
    options = {f"reconstruction__{name}": value for name, value in settings.items()}
    for robot in ROBOTS:
        processes.start("cone_reconstructor", robot, use_sim_time="true", **options)
    # A busy machine takes long to start so many.
    processes.start("bag_replay", bag=bag, rate=rate, wait_s=DEADLINE_S)
    live.until(lambda: diagnostics.total("/map_fusion", "fused") == PINGS, DEADLINE_S)
    for what in ("late", "dropped", "malformed", "refused", "failed"):
        assert diagnostics.total("/map_fusion", what) == 0
    assert live.call("std_srvs/srv/Trigger", "/map_fusion/save_map").success
    processes.end_all()
    return load_map(folder)[0]


def same_cells(one: OccupancyMap, other: OccupancyMap) -> None:
    """Assert that two maps agree: the same cells at 0.65, and log-odds within 1e-4."""
    assert one.geometry == other.geometry
    np.testing.assert_array_equal(one.observed, other.observed)
    np.testing.assert_array_equal(
        one.probability() >= OCCUPIED_PROBABILITY, other.probability() >= OCCUPIED_PROBABILITY
    )
    np.testing.assert_allclose(one.log_odds, other.log_odds, rtol=0.0, atol=1e-4)


@pytest.mark.parametrize(
    ("rate", "settings"),
    [
        (1.0, {}),
        (50.0, {}),
        (50.0, {"dictionary": "cells", "cell_size_m": 0.2}),
        (50.0, {"dictionary": "cells", "cell_size_m": 0.4, "solver": "nnls"}),
    ],
    ids=["real time", "as fast as its readers", "cells", "cells by nnls"],
)
def test_replay_through_the_nodes_gives_the_offline_map(
    live: Any,
    processes: Any,
    diagnostics: Any,
    bag: Path,
    tmp_path: Path,
    rate: float,
    settings: dict[str, Any],
) -> None:
    lived = replay(live, processes, diagnostics, bag, tmp_path / "live", rate, settings)
    same_cells(lived, offline(bag, tmp_path / "map", settings))
