"""Commands that run often load nothing that takes long and that they do not need."""

import subprocess
import sys
from pathlib import Path

import pytest

from usmap_ros.io.bag_writer import new_bag
from usmap_ros.simulation.points import hear

RUN = """
import sys
from usmap_ros.cli import main

try:
    main()
finally:
    print(*sys.modules, sep="\\n", file=sys.stderr)
"""
#: What drawing, calibrating, simulating, other solvers and ways of mapping need, and Numba to
#: compile what is not kept on disk.
SLOW = {
    "PIL", "matplotlib", "numba.np.arraymath", "rosbags.typesys.stores.ros2_jazzy", "scipy.fft",
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


def test_the_version_is_told_without_numpy():
    assert not loaded("--version") & {"numba", "numpy"}
