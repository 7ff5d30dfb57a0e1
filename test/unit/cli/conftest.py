"""What the tests of the command line share."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

SCENARIO = """\
seed: 3
duration_s: 1.0
world:
  points:
    - {x_m: 2.025, y_m: 0.425, reflectivity: 1.0}
    - {x_m: 1.525, y_m: -0.575, reflectivity: 0.8}
robots:
  - name: robot1
    motion: {kind: waypoints, waypoints_m: [[0.0, -1.0], [0.0, 1.0]], speed_m_s: 1.0}
    transducers:
      - mount: {yaw_rad: -1.2}
        receiver: {encoding: iq, sample_rate_hz: 25000.0, noise_std: 0.01}
"""


@pytest.fixture(scope="session")
def folder_of(
    usmap: Callable[..., Any], tmp_path_factory: pytest.TempPathFactory
) -> Callable[..., Path]:
    """Give a function that makes a folder with a scenario and what commands make of it."""

    def make(scenario: str, *commands: list[str]) -> Path:
        folder = tmp_path_factory.mktemp("scenario")
        (folder / "scenario.yaml").write_text(scenario)
        for command in commands:
            done = usmap(*command, cwd=folder)
            assert done.returncode == 0, done.stderr
            assert done.stderr == ""
        return folder

    return make


@pytest.fixture(scope="session")
def recorded(folder_of: Callable[..., Path]) -> Path:
    """Give a folder with a scenario, its recording, its truth and a map; not to be changed."""
    simulate = ["simulate", "scenario.yaml", "-o", "bag", "--truth", "truth.yaml"]
    return folder_of(SCENARIO, simulate, ["map", "bag", "-o", "map"])


@pytest.fixture
def workspace(recorded: Path, tmp_path: Path) -> Path:
    """Give a copy of `recorded` that may be changed."""
    shutil.copytree(recorded, tmp_path / "work")
    return tmp_path / "work"


@pytest.fixture(scope="session")
def undecided(folder_of: Callable[..., Path]) -> Path:
    """Give a folder with a map of a few pings, which leave open where the poles are."""
    scenario = SCENARIO.replace("duration_s: 1.0", "duration_s: 0.3")
    simulate = ["simulate", "scenario.yaml", "-o", "bag"]
    return folder_of(scenario, simulate, ["map", "bag", "-o", "map"])
