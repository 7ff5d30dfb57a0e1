"""A fleet in one go: by 'usmap fleet', and by the launch file where launch is installed."""

import importlib.util
import json
import os
import signal
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
import yaml

from usmap_ros.errors import ConfigurationError
from usmap_ros.io.map_files import load_map
from usmap_ros.live.fleet_processes import fleet_nodes, fleet_task
from usmap_ros.live.interfaces import NODES
from usmap_ros.simulation import Scenario

ROOT = Path(__file__).parents[2]
POLES = ROOT / "config/scenarios/poles.yaml"
TWO_TRANSDUCERS = ROOT / "config/scenarios/two_transducers.yaml"
LAUNCH_FILE = ROOT / "launch/fleet.launch.py"


def test_every_robot_has_a_driver_and_a_reconstructor() -> None:
    tasks = [fleet_task(node) for node in fleet_nodes(POLES)]
    expected = [f"robot{n} {node}" for n in (1, 2, 3) for node in ("echo_driver",
                "cone_reconstructor")]  # fmt: skip
    assert [task.name for task in tasks] == [*expected, "map_fusion"]


def test_reconstructors_know_the_transducers_of_their_robots() -> None:
    scenario = Scenario.load(TWO_TRANSDUCERS)
    names = [transducer.name for transducer in scenario.robots[0].transducers]
    _, reconstructor, _ = fleet_nodes(TWO_TRANSDUCERS)
    assert reconstructor.parameters == {"transducers": names}
    assert f"transducers:={json.dumps(names)}" in fleet_task(reconstructor).command


def test_robots_are_chosen_by_name() -> None:
    nodes = fleet_nodes(POLES, robots=["robot3", "robot1"])
    assert [node.namespace for node in nodes] == ["robot3", "robot3", "robot1", "robot1", ""]
    with pytest.raises(ConfigurationError, match="has no robot 'r2d2'; it has robot1, robot2, rob"):
        fleet_nodes(POLES, robots=["r2d2"])


def test_only_what_is_determined_is_set_beside_a_parameter_file(tmp_path: Path) -> None:
    nodes = fleet_nodes(POLES, start_time_s=5.0, robots=["robot1"], checkpoint=tmp_path)
    assert [node.parameters for node in nodes] == [
        {"scenario": str(POLES), "robot": "robot1", "start_time_s": 5.0},
        {},
        {"checkpoint_path": str(tmp_path)},
    ]
    assert fleet_nodes(POLES)[-1].parameters == {}
    interfaces = {node.name: node for node in NODES}
    for node in nodes:
        assert node.parameters.keys() <= interfaces[node.name].parameters.model_fields.keys()


@pytest.mark.slow
def test_one_ctrl_c_ends_a_fleet_that_has_mapped(
    live: Any, processes: Any, nav2_qos: Any, tmp_path: Path
) -> None:
    command = [sys.executable, "-m", "usmap_ros", "fleet"]
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


class FakeLaunch:
    """What the launch file uses of launch, which the wheels of ROS lack."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        def action(kind: str) -> Any:
            return lambda *given, **options: SimpleNamespace(kind=kind, given=given, **options)

        kinds = {
            "launch": ["LaunchContext", "LaunchDescription"],
            "launch.actions": [
                "DeclareLaunchArgument",
                "LogInfo",
                "OpaqueFunction",
                "RegisterEventHandler",
                "TimerAction",
            ],
            "launch.conditions": ["IfCondition"],
            "launch.event_handlers": ["OnProcessExit"],
            "launch.substitutions": [],
            "launch_ros": [],
            "launch_ros.actions": ["Node"],
        }
        for name, members in kinds.items():
            module: Any = ModuleType(name)
            for member in members:
                setattr(module, member, action(member))
            monkeypatch.setitem(sys.modules, name, module)
        self.given: dict[str, str] = {}
        substitutions: Any = sys.modules["launch.substitutions"]
        substitutions.LaunchConfiguration = lambda name: SimpleNamespace(
            perform=lambda context: self.given[name]
        )

    def make_nodes(self, **given: str) -> tuple[list[Any], list[Any]]:
        """Nodes of the launch file, and what is to happen when each of them ends."""
        specification = importlib.util.spec_from_file_location("fleet_launch", LAUNCH_FILE)
        assert specification is not None
        assert specification.loader is not None
        module = importlib.util.module_from_spec(specification)
        specification.loader.exec_module(module)
        assert module.generate_launch_description().kind == "LaunchDescription"
        defaults = {name: default for name, (default, _) in module.ARGUMENTS.items()}
        assert given.keys() <= defaults.keys()
        self.given = {**defaults, "scenario": str(POLES), **given}
        actions = module.make_nodes(None)
        nodes = [action for action in actions if action.kind == "Node"]
        return nodes, [action.given[0] for action in actions if action not in nodes]


@pytest.fixture
def launch(monkeypatch: pytest.MonkeyPatch) -> FakeLaunch:
    """Give a stand-in for launch, also where the real one is installed."""
    share = "ament_index_python.packages.get_package_share_directory"
    monkeypatch.setattr(share, lambda name: str(ROOT))
    return FakeLaunch(monkeypatch)


def test_the_launch_file_makes_the_nodes_of_usmap_fleet(launch: FakeLaunch) -> None:
    nodes, _ = launch.make_nodes(scenario=str(TWO_TRANSDUCERS), use_sim_time="true")
    expected = fleet_nodes(TWO_TRANSDUCERS)
    assert [(node.executable, node.namespace) for node in nodes] == [
        (node.name, node.namespace) for node in expected
    ]
    assert [node.parameters for node in nodes] == [
        [{**node.parameters, "use_sim_time": True}] for node in expected
    ]


def test_the_launch_file_takes_names_with_blanks_between_and_checks_them(
    launch: FakeLaunch,
) -> None:
    nodes, _ = launch.make_nodes(robots="robot1, robot3")
    assert [node.namespace for node in nodes[::2]] == ["robot1", "robot3", ""]
    with pytest.raises(ConfigurationError, match="has no robot 'r2d2'"):
        launch.make_nodes(robots="r2d2")


def test_the_launch_file_leaves_to_a_parameter_file_what_is_not_given(
    launch: FakeLaunch, tmp_path: Path
) -> None:
    nodes, _ = launch.make_nodes(parameters="my.yaml", robots="robot1")
    assert [node.parameters[0] for node in nodes] == ["my.yaml"] * 3
    assert nodes[0].parameters[1].keys() == {"scenario", "robot", "start_time_s"}
    assert [len(node.parameters) for node in nodes[1:]] == [1, 1]
    nodes, _ = launch.make_nodes(robots="robot1", checkpoint=str(tmp_path), pose_source="odometry")
    assert nodes[0].parameters[0]["pose_source"] == "odometry"
    assert nodes[2].parameters[0] == {"checkpoint_path": str(tmp_path)}


def test_the_launch_file_starts_what_dies_again_ever_more_slowly(launch: FakeLaunch) -> None:
    nodes, (on_exit, *_) = launch.make_nodes(robots="robot1")
    ended = SimpleNamespace(process_name="echo_driver-1", returncode=-11)
    waits_s = []
    for _ in range(3):
        assert on_exit.target_action is nodes[0]
        said, timer = on_exit.on_exit(ended, SimpleNamespace(is_shutdown=False))
        assert said.msg.startswith("echo_driver-1 ended with -11; starting it again in")
        waits_s.append(timer.period)
        handler, nodes[0] = timer.actions[0].function(None)
        on_exit = handler.given[0]
    assert waits_s == [0.5, 1.0, 2.0]
    assert on_exit.on_exit(ended, SimpleNamespace(is_shutdown=True)) is None


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
    topics += [static["map_topic"], local["static_layer"]["map_topic"]]
    topics += local["range_layer"]["topics"]
    assert static["map_subscribe_transient_local"]
    assert {topic.rpartition("/")[2] for topic in topics} <= names
