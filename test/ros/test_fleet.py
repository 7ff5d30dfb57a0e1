"""A fleet in one go: by 'usmap fleet', and by the launch file where launch is installed."""

import ast
import json
import os
import signal
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
import yaml

from usmap_ros.io.map_files import load_map
from usmap_ros.live.fleet_processes import fleet_tasks
from usmap_ros.live.interfaces import NODES
from usmap_ros.simulation import Scenario

ROOT = Path(__file__).parents[2]
LAUNCH_FILE = ROOT / "launch/fleet.launch.py"


def test_every_robot_has_a_driver_and_a_reconstructor(poles: Scenario) -> None:
    path = ROOT / "config/scenarios/poles.yaml"
    names = [task.name for task in fleet_tasks(path, poles, 0.0)]
    expected = [f"robot{n} {node}" for n in (1, 2, 3) for node in ("echo_driver",
                "cone_reconstructor")]  # fmt: skip
    assert names == [*expected, "map_fusion"]


def test_reconstructors_know_the_transducers_of_their_robots() -> None:
    path = ROOT / "config/scenarios/two_transducers.yaml"
    scenario = Scenario.load(path)
    names = ", ".join(transducer.name for transducer in scenario.robots[0].transducers)
    commands = [task.command for task in fleet_tasks(path, scenario, 0.0)]
    assert f"transducers:=[{names}]" in commands[1]


@pytest.mark.slow
def test_one_ctrl_c_ends_a_fleet_that_has_mapped(
    live: Any, processes: Any, nav2_qos: Any, tmp_path: Path
) -> None:
    command = [sys.executable, "-c", "from usmap_ros.cli import main; main()", "fleet"]
    command += [str(ROOT / "config/scenarios/poles.yaml"), "-o", str(tmp_path / "map")]
    fleet = processes.run(command, "fleet")
    grids = live.listen("nav_msgs/msg/OccupancyGrid", "/map", nav2_qos)
    live.until(lambda: len(grids) > 3, timeout_s=300.0)
    # By name, as a robot's own crash would be: which process it is, the fleet alone knows.
    drivers = [line for line in _processes() if "start_time_s" in line[1] and "robot2" in line[1]
               and str(fleet.pid) == line[2]]  # fmt: skip

    os.kill(int(drivers[0][0]), signal.SIGKILL)
    live.until(lambda: "was killed by SIGKILL; starting it again" in fleet.log.read_text())
    fleet.send_signal(signal.SIGINT)
    assert fleet.wait(90.0) == 0
    assert not [line for line in _processes() if str(tmp_path) in line[1]]
    occupancy, _ = load_map(tmp_path / "map")
    assert occupancy.observed.any()
    assert "[robot1 echo_driver" in fleet.log.read_text() or "robot2" in fleet.log.read_text()


def _processes() -> list[tuple[str, str, str]]:
    """Number, command line and parent of every process."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            command = (folder / "cmdline").read_text().replace("\0", " ")
            parent = (folder / "stat").read_text().rpartition(")")[2].split()[1]
        except OSError:
            continue
        found.append((folder.name, command, parent))
    return found


def test_the_launch_file_starts_nodes_and_parameters_that_exist() -> None:
    tree = ast.parse(LAUNCH_FILE.read_text(encoding="utf-8"))
    functions = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    assert "generate_launch_description" in functions
    words = {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)}
    interfaces = {node.name: node for node in NODES}
    for name in ("echo_driver", "cone_reconstructor", "map_fusion"):
        assert name in words
    driver = interfaces["echo_driver"].parameters.model_fields
    assert {"scenario", "robot", "pose_source", "start_time_s"} <= words & set(driver)
    assert "checkpoint_path" in words & set(interfaces["map_fusion"].parameters.model_fields)


@pytest.mark.skipif(find_spec("launch_ros") is None, reason="launch is not in the wheels of ROS")
def test_the_launch_file_makes_a_node_a_robot_and_a_fusion() -> None:
    import importlib.util

    from launch import LaunchContext

    specification = importlib.util.spec_from_file_location("fleet_launch", LAUNCH_FILE)
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    assert module.generate_launch_description().entities
    context = LaunchContext()
    for name, (default, _) in module.ARGUMENTS.items():
        context.launch_configurations[name] = default
    assert len(module.make_nodes(context)) == 7


def test_integration_files_name_topics_that_there_are() -> None:
    names = {topic.name for node in NODES for topic in (*node.publishes, *node.subscribes)}
    rviz = yaml.safe_load((ROOT / "config/rviz/usmap.rviz").read_text(encoding="utf-8"))
    displays = rviz["Visualization Manager"]["Displays"]
    topics = [display[key]["Value"] for display in displays for key in ("Topic", "Update Topic")
              if key in display]  # fmt: skip
    foxglove = json.loads((ROOT / "config/foxglove/usmap.json").read_text(encoding="utf-8"))
    topics += foxglove["configById"]["3D!map"]["topics"]
    nav2 = yaml.safe_load((ROOT / "config/nav2/costmaps.yaml").read_text(encoding="utf-8"))
    static = nav2["global_costmap"]["global_costmap"]["ros__parameters"]["static_layer"]
    local = nav2["local_costmap"]["local_costmap"]["ros__parameters"]
    topics += [static["map_topic"], *local["range_layer"]["topics"]]
    topics += [local["obstacle_layer"]["cone_cells"]["topic"]]
    assert static["map_subscribe_transient_local"]
    assert {topic.rpartition("/")[2] for topic in topics} <= names
