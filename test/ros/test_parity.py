"""A bag mapped offline, and replayed through the nodes as processes, gives the same map."""

import signal
from collections.abc import Callable
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from usmap_ros.grids import OCCUPIED_PROBABILITY, OccupancyMap
from usmap_ros.io.bags import write_bag
from usmap_ros.io.map_files import load_map
from usmap_ros.live.ordering import QUIET_S
from usmap_ros.simulation import Scenario, simulate

pytestmark = pytest.mark.slow

#: Of the whole scenario; and fewer for what takes long to reconstruct.
PINGS, FEW = 300, 60
#: Ends a hang; a busy machine is far from it.
DEADLINE_S = 300.0
ROBOTS = ("robot1", "robot2", "robot3")


@pytest.fixture(scope="module")
def bags(poles: Scenario, tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    """Give bags of the scenario 'poles', by how many pings they hold."""
    folder, traces = tmp_path_factory.mktemp("parity"), list(simulate(poles))
    paths = {pings: folder / f"{pings}" for pings in (PINGS, FEW)}
    for pings, path in paths.items():
        write_bag(path, islice(traces, pings))
    return paths


@pytest.fixture
def offline(usmap: Any, tmp_path: Path) -> Callable[..., OccupancyMap]:
    """Give a function that maps as 'usmap map' does."""

    def make(bag: Path, settings: dict[str, Any]) -> OccupancyMap:
        options = [f"--set=reconstruction.{name}={value}" for name, value in settings.items()]
        done = usmap("map", str(bag), "-o", "map", *options, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        return load_map(tmp_path / "map")[0]

    return make


@pytest.fixture
def replayed(
    live: Any, processes: Any, diagnostics: Any, tmp_path: Path
) -> Callable[..., OccupancyMap]:
    """Give a function that replays a bag through a reconstructor a robot, and fusion.

    With every wait and queue as it is by default, at whatever rate: the replay waits for all.
    """

    def make(bag: Path, pings: int, rate: float, settings: dict[str, Any]) -> OccupancyMap:
        folder = tmp_path / "live"
        processes.start("map_fusion", save_path=folder, use_sim_time="true")
        options = {f"reconstruction__{name}": value for name, value in settings.items()}
        for robot in ROBOTS:
            processes.start("cone_reconstructor", robot, use_sim_time="true", **options)
        # A busy machine takes long to start so many.
        processes.start("bag_replay", bag=bag, rate=rate, wait_s=DEADLINE_S)
        live.until(lambda: diagnostics.total("/map_fusion", "fused") == pings, DEADLINE_S)
        for what in ("late", "dropped", "malformed", "refused", "failed"):
            assert diagnostics.total("/map_fusion", what) == 0
        assert live.call("std_srvs/srv/Trigger", "/map_fusion/save_map").success
        processes.end_all()
        return load_map(folder)[0]

    return make


def same_cells(one: OccupancyMap, other: OccupancyMap) -> None:
    """Assert that two maps agree: the same cells at 0.65, and log-odds within 1e-4."""
    assert one.geometry == other.geometry
    np.testing.assert_array_equal(one.observed, other.observed)
    np.testing.assert_array_equal(
        one.probability() >= OCCUPIED_PROBABILITY, other.probability() >= OCCUPIED_PROBABILITY
    )
    np.testing.assert_allclose(one.log_odds, other.log_odds, rtol=0.0, atol=1e-4)


# Which dictionaries and solvers there are, test/replay/test_one_front_door.py has; that nodes obey
# what is set, one that changes all of it shows.
@pytest.mark.parametrize(
    ("rate", "pings", "settings"),
    [
        (1.0, PINGS, {}),
        (50.0, PINGS, {}),
        (50.0, FEW, {"dictionary": "cells", "cell_size_m": 0.4, "solver": "nnls"}),
    ],
    ids=["real time", "as fast as its readers", "cells by nnls"],
)
def test_replay_through_the_nodes_gives_the_offline_map(
    offline: Callable[..., OccupancyMap],
    replayed: Callable[..., OccupancyMap],
    bags: dict[int, Path],
    rate: float,
    pings: int,
    settings: dict[str, Any],
) -> None:
    same_cells(replayed(bags[pings], pings, rate, settings), offline(bags[pings], settings))


def test_a_reader_that_hangs_for_some_seconds_is_not_late(
    live: Any, processes: Any, diagnostics: Any, bags: dict[int, Path]
) -> None:
    """The replay waits for it, and so must who fuses."""
    processes.start("map_fusion", use_sim_time="true")
    first, *_ = [
        processes.start("cone_reconstructor", robot, use_sim_time="true") for robot in ROBOTS
    ]
    processes.start("bag_replay", bag=bags[FEW], rate=1.0, wait_s=DEADLINE_S)
    live.until(lambda: diagnostics.total("/map_fusion", "fused") > 0, DEADLINE_S)
    first.send_signal(signal.SIGSTOP)
    live.spin(QUIET_S + 1.0)
    first.send_signal(signal.SIGCONT)
    live.until(lambda: diagnostics.total("/map_fusion", "fused") == FEW, DEADLINE_S)
    assert diagnostics.total("/map_fusion", "late") == 0
