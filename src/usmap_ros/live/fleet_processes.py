"""The nodes that a fleet of simulated robots and its map consist of, and their processes."""

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from usmap_ros.errors import ConfigurationError
from usmap_ros.io.yaml_files import read_mapping
from usmap_ros.live.supervisor import Task
from usmap_ros.simulation import Scenario


@dataclass(frozen=True)
class FleetNode:
    """A node of a fleet."""

    #: Of the node and its executable.
    name: str
    #: The robot that it belongs to; empty: all of them.
    namespace: str
    #: What the scenario and the caller determine; everything else is for parameter files.
    parameters: dict[str, Any]


def fleet_nodes(
    path: Path,
    *,
    start_time_s: float | None = None,
    robots: Sequence[str] = (),
    checkpoint: Path | None = None,
) -> list[FleetNode]:
    """A driver and a reconstructor for each robot, and one fusion for all.

    Parameters
    ----------
    path : path
        File of the scenario.
    start_time_s : float, optional
        When all robots start on their paths, in seconds of the nodes' clock; None: each does with
        its driver.
    robots : sequence of str
        Of those in the scenario; empty: all.
    checkpoint : path, optional
        Folder in which fusion keeps the map.

    Raises
    ------
    UsmapError
        If the scenario is unusable, or has no such robot: what the drivers would refuse one by
        one is said once, before anything starts.
    """
    scenario = Scenario.load(path)
    scenario.fleet(scenario.scene())
    known = {robot.name: robot for robot in scenario.robots}
    for name in robots:
        if name not in known:
            raise ConfigurationError(path, f"has no robot {name!r}; it has {', '.join(known)}")
    start = {} if start_time_s is None else {"start_time_s": float(start_time_s)}
    nodes = []
    for name in robots or known:
        transducers = [transducer.name for transducer in known[name].transducers]
        several = {"transducers": transducers} if len(transducers) > 1 else {}
        driver = {"scenario": str(path.resolve()), "robot": name, **start}
        nodes += [
            FleetNode("echo_driver", name, driver),
            FleetNode("cone_reconstructor", name, several),
        ]
    kept = {} if checkpoint is None else {"checkpoint_path": str(checkpoint.resolve())}
    return [*nodes, FleetNode("map_fusion", "", kept)]


def fleet_task(node: FleetNode, parameters_file: Path | None = None) -> Task:
    """Process of a node, with ROS parameters from a file for what is not determined."""
    command = [sys.executable, "-u", "-m", f"usmap_ros.nodes.{node.name}", "--ros-args"]
    if node.namespace:
        command += ["-r", f"__ns:=/{node.namespace}"]
    if parameters_file is not None:
        command += ["--params-file", str(parameters_file)]
    for name, value in node.parameters.items():
        # ROS reads YAML, which JSON is: a robot that is called 1 or on stays a name.
        command += ["-p", f"{name}:={json.dumps(value)}"]
    return Task(f"{node.namespace} {node.name}".strip(), command)


def check_parameter_file(path: Path) -> None:
    """Refuse a file that ROS would not read: every node would end over it, and start again.

    Raises
    ------
    ConfigurationError
        If it is no YAML, or has nothing under ``ros__parameters``.
    """
    content = read_mapping(path)
    if content and not _holds_parameters(content):
        raise ConfigurationError(path, "holds no ROS parameters: see config/parameters")


def _holds_parameters(content: object) -> bool:
    """Whether all that is below the names of nodes is below ``ros__parameters``."""
    if not isinstance(content, dict) or not content:
        return False
    return "ros__parameters" in content or all(map(_holds_parameters, content.values()))
