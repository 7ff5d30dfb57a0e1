"""Commands that run often load nothing that takes long and that they do not need."""

import subprocess
import sys
from pathlib import Path

import pytest

from usmap_ros.grids import TruthMap
from usmap_ros.io.bag_writer import new_bag
from usmap_ros.io.map_files import load_map, save_truth
from usmap_ros.simulation.points import hear

RUN = """
import sys
from usmap_ros.cli import main

try:
    main()
finally:
    print(*sys.modules, sep="\\n", file=sys.stderr)
"""
#: What drawing, calibrating, simulating, other solvers and ways of mapping need; and what Numba
#: loads for linear algebra in compiled functions, which none of ours does.
SLOW = {
    "PIL", "matplotlib", "rosbags.typesys.stores.ros2_jazzy", "scipy.fft",
    "scipy.linalg", "scipy.ndimage", "scipy.optimize", "scipy.signal", "scipy.sparse",
    "scipy.spatial", "scipy.special", "usmap_ros.calibration.estimation", "usmap_ros.simulation",
    "distributed", "rclpy",
}  # fmt: skip


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bags") / "bag"
    with new_bag(path) as writer:
        writer.write_trace("/robot1/echo", hear([(1.5, 0.2), (2.5, -0.3)]))
    return path


def loaded(*arguments: str) -> set[str]:
    command = [sys.executable, "-c", RUN, *arguments]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return set(done.stderr.split())


@pytest.mark.parametrize("command", ["map", "info"])
def test_what_a_command_loads(command, bag, tmp_path):
    output = ["-o", str(tmp_path / "map"), "--jobs", "1"] if command == "map" else ["--json"]
    # Both commands compile in other processes what is not kept yet.
    assert not loaded(command, str(bag), *output) & SLOW


#: What commands that look at maps load of this: nothing to reconstruct, and no formats of bags.
#: Lines of sight are followed in a compiled loop.
OF_MAPS: dict[str, set[str]] = {
    "evaluate": {"llvmlite", "numba", "scipy"},
    "merge": set(),
    "plot": {"matplotlib"},
    "walls": set(),
}
NOT_OF_MAPS = {
    "llvmlite", "matplotlib", "mcap", "numba", "rclpy", "rosbags", "scipy",
    "usmap_ros.mapping.joint", "usmap_ros.reconstruction", "usmap_ros.simulation",
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(bag: Path) -> Path:
    path = bag.parent / "map"
    loaded("map", str(bag), "-o", str(path), "--jobs", "1")
    occupancy, _ = load_map(path)
    save_truth(bag.parent / "truth.yaml", TruthMap(occupancy.geometry, occupancy.observed))
    return path


@pytest.mark.parametrize("command", OF_MAPS)
def test_commands_that_look_at_maps_load_no_more_than_that_takes(command, folder, tmp_path):
    arguments = {
        "evaluate": ["--truth", str(folder.parent / "truth.yaml")],
        "merge": [str(folder), "-o", str(tmp_path / "merged")],
        "plot": ["-o", str(tmp_path / "map.png")],
        "walls": ["-o", str(tmp_path / "walls.yaml")],
    }
    found = loaded(command, str(folder), *arguments[command]) & NOT_OF_MAPS
    assert found == OF_MAPS[command]


def test_help_is_given_without_numpy():
    assert not loaded("--help") & {"numba", "numpy", "pydantic"}


def test_the_version_is_told_without_numpy():
    assert not loaded("--version") & {"numba", "numpy"}
