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
    command = [sys.executable, "-c", "from usmap_ros.cli import main; main()"]
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
    live: Any, processes: Any, bag: Path, folder: Path, rate: float, settings: dict[str, Any]
) -> OccupancyMap:
    """Map that comes of replaying the bag through a reconstructor a robot, and fusion."""
    diagnostics = live.listen("diagnostic_msgs/msg/DiagnosticArray", "/diagnostics", 100)
    processes.start(
        "map_fusion",
        save_path=folder,
        # The machine may be busy: what counts here is the order, not how soon.
        order_wait_s=60.0,
        use_sim_time="true",
    )
    options = {f"reconstruction__{name}": value for name, value in settings.items()}
    for robot in ROBOTS:
        processes.start(
            "cone_reconstructor", robot, queue_depth=PINGS, use_sim_time="true", **options
        )
    processes.start("bag_replay", bag=bag, rate=rate, start_paused="true", wait_s=1000.0)
    live.until(lambda: all(_is_connected(live, robot) for robot in ROBOTS), DEADLINE_S)
    # Everybody sees it at a different time; what a reconstructor publishes before it does is lost.
    reconstructors = [f"/{robot}/cone_reconstructor" for robot in ROBOTS]
    live.until(
        lambda: all(_total(diagnostics, node, "listeners") for node in reconstructors), DEADLINE_S
    )
    assert live.call("std_srvs/srv/SetBool", "/bag_replay/pause", data=False).success
    # Its last cones wait for others that do not come: a reset of the wait lets them go.
    live.until(lambda: _total(diagnostics, "/map_fusion", "received") == PINGS, DEADLINE_S)
    assert live.set_parameter("/map_fusion", "order_wait_s", 0.0).successful
    live.until(lambda: _total(diagnostics, "/map_fusion", "fused") == PINGS, DEADLINE_S)
    for what in ("late", "dropped", "malformed", "refused", "failed"):
        assert _total(diagnostics, "/map_fusion", what) == 0
    assert live.call("std_srvs/srv/Trigger", "/map_fusion/save_map").success
    processes.end_all()
    return load_map(folder)[0]


def _is_connected(live: Any, robot: str) -> bool:
    """Whether replay, reconstructor and fusion have found each other."""
    peer = live.peer
    echo, cone = f"/{robot}/echo", f"/{robot}/cone"
    ends = [peer.count_publishers(echo), peer.count_subscribers(echo)]
    return all([*ends, peer.count_publishers(cone), peer.count_subscribers(cone)])


def _total(diagnostics: list[Any], node: str, what: str) -> int:
    totals = [
        int(value.value)
        for message in diagnostics
        for status in message.status
        for value in status.values
        if status.name == node and value.key == what
    ]
    return totals[-1] if totals else 0


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
        (3.0, {}),
        (3.0, {"dictionary": "cells", "cell_size_m": 0.2}),
        (3.0, {"dictionary": "cells", "cell_size_m": 0.4, "solver": "nnls"}),
    ],
    ids=["real time", "thrice as fast", "cells", "cells by nnls"],
)
def test_replay_through_the_nodes_gives_the_offline_map(
    live: Any, processes: Any, bag: Path, tmp_path: Path, rate: float, settings: dict[str, Any]
) -> None:
    lived = replay(live, processes, bag, tmp_path / "live", rate, settings)
    same_cells(lived, offline(bag, tmp_path / "map", settings))
