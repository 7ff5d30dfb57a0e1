"""A fleet of real processes: the map is right, and stays so when processes are killed."""

import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from usmap_ros.evaluation.scoring import score
from usmap_ros.io.conversions import grid_from_message
from usmap_ros.io.map_files import load_map
from usmap_ros.simulation import Scenario

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
SCENARIO = ROOT / "config/scenarios/poles.yaml"
ROBOTS = ("robot1", "robot2", "robot3")
GRID = "nav_msgs/msg/OccupancyGrid"


def start_robot(processes: Any, robot: str) -> tuple[Any, Any]:
    """Driver and reconstructor of a robot."""
    return (
        processes.start("echo_driver", robot, scenario=SCENARIO, robot=robot),
        processes.start("cone_reconstructor", robot),
    )


def test_three_robots_and_a_fusion_map_the_world(
    live: Any,
    processes: Any,
    diagnostics: Any,
    poles: Scenario,
    nav2_qos: Any,
    assert_nav2_takes: Any,
    tmp_path: Path,
) -> None:
    grids = live.listen(GRID, "/map", nav2_qos)
    # However busy the machine is, cones wait.
    processes.start(
        "map_fusion", checkpoint_path=tmp_path / "map", publish_rate_hz=5.0, queue_depth=100_000
    )
    robots = {robot: start_robot(processes, robot) for robot in ROBOTS}
    live.until(lambda: diagnostics.total("/map_fusion", "fused") > 120, timeout_s=300.0)

    # One robot dies; the others go on.
    for process in robots["robot2"]:
        process.kill()
        process.wait()
    before = diagnostics.total("/map_fusion", "fused")
    live.until(lambda: diagnostics.total("/map_fusion", "fused") > before + 120, timeout_s=300.0)
    for robot in ("robot1", "robot3"):
        assert all(process.poll() is None for process in robots[robot])

    # It comes back, and is fused again without anybody's help.
    start_robot(processes, "robot2")
    live.until(lambda: diagnostics.total("/robot2/cone_reconstructor", "published") > 20,
               timeout_s=300.0)  # fmt: skip
    for message in grids:
        assert_nav2_takes(message)
        assert set(message.data) <= {-1, 0, 100}
    processes.end_all()
    occupancy, _ = load_map(tmp_path / "map")
    assert score(occupancy, poles.truth_map()).f1 > 0.9
    for what in ("malformed", "refused", "failed", "dropped"):
        assert diagnostics.total("/map_fusion", what) == 0


def test_a_killed_fusion_resumes_and_has_lost_an_interval_at_most(
    live: Any, processes: Any, diagnostics: Any, tmp_path: Path, nav2_qos: Any
) -> None:
    folder = tmp_path / "map"
    options = {"checkpoint_path": folder, "checkpoint_period_s": 1.0, "publish_rate_hz": 10.0}
    grids = live.listen(GRID, "/map", nav2_qos)
    fusion = processes.start("map_fusion", **options)
    drivers = [start_robot(processes, robot)[0] for robot in ROBOTS]
    live.until(lambda: diagnostics.total("/map_fusion", "fused") > 150, timeout_s=300.0)
    # A busy machine draws maps late.
    live.until(lambda: grids)
    # What was published is on disk soon after: the checkpoint follows the map.
    published_ns = _stamp_ns(grids[-1])
    live.until(lambda: _kept_stamp_ns(folder) >= published_ns)
    fusion.send_signal(signal.SIGKILL)
    fusion.wait()
    for driver in drivers:
        driver.send_signal(signal.SIGINT)
    live.spin(1.0)
    kept, _ = load_map(folder)
    assert kept.stamp_ns >= published_ns

    del grids[:]
    processes.start("map_fusion", **options)
    live.until(lambda: grids, timeout_s=300.0)
    geometry, values, _, stamp_ns = grid_from_message(grids[0])
    assert stamp_ns == kept.stamp_ns
    shift = np.rint((np.array(kept.geometry.origin_m) - geometry.origin_m) / 0.05).astype(int)
    rows, columns = kept.geometry.shape
    part = values[shift[1] : shift[1] + rows, shift[0] : shift[0] + columns]
    np.testing.assert_array_equal(part, kept.trinary())


def _stamp_ns(message: Any) -> int:
    stamp = message.header.stamp
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def _kept_stamp_ns(folder: Path) -> int:
    """Stamp of the newest cone in the map on disk; 0 if there is none."""
    return load_map(folder)[0].stamp_ns if (folder / "map.npz").exists() else 0
