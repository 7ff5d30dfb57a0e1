"""Paths of maps, told apart from the true ones."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from usmap_ros.io.map_files import load_map
from usmap_ros.io.tum_files import load_trajectories

SCENARIO = """\
seed: 3
duration_s: 4.0
world:
  points: [{x_m: 2.0, y_m: 0.4}, {x_m: 1.5, y_m: -0.6}]
robots:
  - name: robot1
    odometry: {heading_rad_per_sqrt_m: 0.05}
    motion: {kind: waypoints, waypoints_m: [[0.0, -1.0], [0.0, 1.0]], speed_m_s: 1.0}
    transducers: [{mount: {yaw_rad: -1.2}}]
"""


@pytest.fixture(scope="module")
def drifted(folder_of: Callable[..., Path]) -> Path:
    """Give a folder with a recording of a robot that drifts, its true path and its map."""
    simulate = ["simulate", "scenario.yaml", "-o", "bag", "--true-paths", "true"]
    return folder_of(SCENARIO, simulate, ["map", "bag", "-o", "map", "--poses", "told"])


def test_a_map_keeps_the_paths_of_its_robots(drifted: Path) -> None:
    ours = load_map(drifted / "map")[1].trajectories()["/robot1/echo"]
    true = load_trajectories(drifted / "true")["robot1.echo.tum"]
    assert ours.stamps_ns.tolist() == true.stamps_ns.tolist()
    assert len(ours) == 40


@pytest.mark.parametrize("truth", ["true", "true/robot1.echo.tum"])
def test_paths_are_scored(usmap: Callable[..., Any], drifted: Path, truth: str) -> None:
    done = usmap("evaluate", "map", "--paths", truth, "--json", cwd=drifted)
    assert done.returncode == 0, done.stderr
    score = json.loads(done.stdout)["paths"]["robot1.echo"]
    assert score["poses"] == 40
    assert 0.001 < score["ate_m"] <= score["ate_max_m"] < 1.0
    told = usmap("evaluate", "map", "--paths", truth, cwd=drifted).stdout
    assert f"ATE {score['ate_m']:.3f} m" in told


@pytest.mark.parametrize(
    ("arguments", "cause"),
    [
        ([], "--paths"),
        (["--truth", "truth.yaml", "--align"], "--paths"),
        (["--paths", "true", "--max-range", "3"], "--truth"),
    ],
)
def test_options_that_would_do_nothing_are_refused(
    usmap: Callable[..., Any], drifted: Path, arguments: list[str], cause: str
) -> None:
    done = usmap("evaluate", "map", *arguments, cwd=drifted)
    assert done.returncode == 2
    assert cause in done.stderr


def test_a_true_path_that_cannot_be_read_is_one_line(
    usmap: Callable[..., Any], drifted: Path
) -> None:
    done = usmap("evaluate", "map", "--paths", "nothing.tum", cwd=drifted)
    assert done.returncode == 1
    assert done.stderr.startswith("usmap: error: nothing.tum: does not exist")


def test_odometry_is_refined_unless_told_poses_are_wanted(
    usmap: Callable[..., Any], drifted: Path, tmp_path: Path
) -> None:
    assert not (drifted / "map" / "paths").exists()
    told = json.loads((drifted / "map" / "summary.json").read_text())["poses"]
    assert told == {"used": "told", "robots": {}}
    done = usmap("map", str(drifted / "bag"), "-o", "map", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    refined = json.loads((tmp_path / "map" / "summary.json").read_text())["poses"]
    assert refined["used"] == "refined"
    assert refined["robots"]["robot1"]["poses"] == "odometry"
    assert refined["robots"]["robot1"]["correction_m"] >= 0.0
    for folder in ("paths", "paths/told"):
        assert list(load_trajectories(tmp_path / "map" / folder)) == ["robot1.echo.tum"]


def test_collections_are_mapped_with_poses_as_told(
    usmap: Callable[..., Any], drifted: Path
) -> None:
    done = usmap("map", ".", "-o", "all", "--poses", "refined", cwd=drifted)
    assert done.returncode == 2
    assert "--poses" in done.stderr
