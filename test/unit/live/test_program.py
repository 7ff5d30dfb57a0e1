"""A node says in one line that ROS is missing, however it is started."""

import subprocess
import sys
from pathlib import Path

import pytest

from usmap_ros.live.interfaces import NODES
from usmap_ros.nodes.program import NODE_NAMES, node_name

#: Hides rclpy, as where it is not installed, and runs what follows on the command line.
WITHOUT_ROS = """
import importlib.util, runpy, sys

find_spec = importlib.util.find_spec
importlib.util.find_spec = lambda name, *more: None if name == "rclpy" else find_spec(name, *more)
sys.modules["rclpy"] = None
sys.argv = sys.argv[1:]
runpy.run_path(sys.argv[0], run_name="__main__")
"""


def test_every_node_is_known() -> None:
    assert sorted(NODE_NAMES) == sorted(node.name for node in NODES)


@pytest.mark.parametrize(
    ("program", "arguments", "name"),
    [
        (
            "/usr/lib/usmap_ros/map_fusion",
            ["python3", "/usr/lib/usmap_ros/map_fusion"],
            "map_fusion",
        ),
        ("-m", ["python3", "-u", "-m", "usmap_ros.nodes.echo_driver", "-p", "a:=b"], "echo_driver"),
        ("-m", ["python3", "-m", "pytest", "test/ros"], None),
        ("/usr/bin/usmap", ["python3", "/usr/bin/usmap", "replay"], None),
        ("-c", ["python3", "-c"], None),
        ("", ["python3"], None),
    ],
)
def test_a_program_is_told_from_a_library(
    program: str, arguments: list[str], name: str | None
) -> None:
    assert node_name(program, arguments) == name


@pytest.mark.parametrize("name", NODE_NAMES)
def test_a_node_without_ros_says_so_in_one_line(name: str, tmp_path: Path) -> None:
    # As the executable that pip makes of the entry point.
    script = tmp_path / name
    script.write_text(f"from usmap_ros.nodes.{name} import main\nmain()\n")
    command = [sys.executable, "-c", WITHOUT_ROS, str(script)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 1
    assert done.stderr == (
        f"{name}: error: this command needs ROS 2 Jazzy, and the Python package rclpy is missing;"
        " see 'Install' in the README\n"
    )
