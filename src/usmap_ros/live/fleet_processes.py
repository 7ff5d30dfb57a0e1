"""The processes that a fleet of simulated robots and its map consist of."""

from __future__ import annotations

import sys
from pathlib import Path

from usmap_ros.live.supervisor import Task
from usmap_ros.simulation import Scenario


def fleet_tasks(
    scenario_path: Path,
    scenario: Scenario,
    start_time_s: float,
    *,
    parameters_file: Path | None = None,
    checkpoint: Path | None = None,
) -> list[Task]:
    """A driver and a reconstructor for each robot, and one fusion for all.

    Parameters
    ----------
    scenario_path : path
        File of the scenario.
    scenario : Scenario
        What is in it.
    start_time_s : float
        When all robots start on their paths, seconds since the epoch.
    parameters_file : path, optional
        ROS parameters for all nodes.
    checkpoint : path, optional
        Folder in which fusion keeps the map.
    """
    tasks = []
    for robot in scenario.robots:
        names = [transducer.name for transducer in robot.transducers]
        driver = {
            "scenario": str(scenario_path.resolve()),
            "robot": robot.name,
            "start_time_s": repr(float(start_time_s)),
        }
        reconstructor = {"transducers": f"[{', '.join(names)}]"} if len(names) > 1 else {}
        tasks += [
            _task("echo_driver", robot.name, driver, parameters_file),
            _task("cone_reconstructor", robot.name, reconstructor, parameters_file),
        ]
    fusion = {} if checkpoint is None else {"checkpoint_path": str(checkpoint.resolve())}
    return [*tasks, _task("map_fusion", "", fusion, parameters_file)]


def _task(
    node: str, namespace: str, parameters: dict[str, str], parameters_file: Path | None
) -> Task:
    command = [sys.executable, "-u", "-m", f"usmap_ros.nodes.{node}", "--ros-args"]
    if namespace:
        command += ["-r", f"__ns:=/{namespace}"]
    if parameters_file is not None:
        command += ["--params-file", str(parameters_file)]
    for name, value in parameters.items():
        command += ["-p", f"{name}:={value}"]
    return Task(f"{namespace} {node}".strip(), command)
