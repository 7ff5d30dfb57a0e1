"""A fleet of simulated robots, and the fusion of what they hear.

    ros2 launch usmap_ros fleet.launch.py scenario:=my.yaml robots:=robot1,robot2 rviz:=true

It needs a full installation of ROS 2; where launch is missing, ``usmap fleet`` does the same: both
take robots and transducers from the scenario, leave the rest to parameter files, and start a node
that dies again, more slowly each time.
"""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    LogInfo,
    OpaqueFunction,
    RegisterEventHandler,
    TimerAction,
)
from launch.conditions import IfCondition
from launch.event_handlers import OnProcessExit
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from usmap_ros.live.fleet_processes import FleetNode, fleet_nodes
from usmap_ros.live.supervisor import BackOff

PACKAGE = "usmap_ros"
SHARE = get_package_share_directory(PACKAGE)
SCENARIO = os.path.join(SHARE, "config", "scenarios", "poles.yaml")
RVIZ_FILE = os.path.join(SHARE, "config", "rviz", "usmap.rviz")

ARGUMENTS = {
    "scenario": (SCENARIO, "Scenario file with the world and the robots."),
    "robots": ("", "Names of robots in it, with commas between; empty: all of them."),
    "parameters": ("", "ROS parameter file for all nodes; empty: their defaults."),
    "checkpoint": ("", "Folder in which the map is kept; empty: as the parameters say."),
    "pose_source": ("", "Where robots are: path, tf or odometry; empty: as the parameters say."),
    "use_sim_time": ("false", "Whether time is that of /clock."),
    "discovery_server": ("", "Address and port of a Fast DDS discovery server; empty: multicast."),
    "rviz": ("false", "Whether to start RViz."),
}
#: Time that the nodes get to start before the robots set off, s.
HEAD_START_S = 3.0


def generate_launch_description() -> LaunchDescription:
    """Arguments, the nodes, and RViz if it is wanted."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, (default, description) in ARGUMENTS.items()
    ]
    rviz = Node(
        package="rviz2",
        executable="rviz2",
        arguments=["-d", RVIZ_FILE],
        parameters=[{"use_sim_time": LaunchConfiguration("use_sim_time")}],
        condition=IfCondition(LaunchConfiguration("rviz")),
    )
    return LaunchDescription([*declared, OpaqueFunction(function=make_nodes), rviz])


def make_nodes(context: LaunchContext) -> list[Any]:
    """A driver and a reconstructor for each robot, and one fusion for all."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    use_sim_time = given["use_sim_time"].lower() == "true"
    nodes = fleet_nodes(
        Path(given["scenario"]),
        # The same for all, so that they share moving objects; simulated time starts when it starts.
        start_time_s=None if use_sim_time else time.time() + HEAD_START_S,
        robots=[name.strip() for name in given["robots"].split(",") if name.strip()],
        checkpoint=Path(given["checkpoint"]) if given["checkpoint"] else None,
    )
    if given["discovery_server"]:
        context.environment["ROS_DISCOVERY_SERVER"] = given["discovery_server"]
    common = {"use_sim_time": True} if use_sim_time else {}
    files = [given["parameters"]] if given["parameters"] else []
    actions = []
    for node in nodes:
        parameters = {**node.parameters, **common}
        if node.name == "echo_driver" and given["pose_source"]:
            parameters["pose_source"] = given["pose_source"]
        actions += keep_running(node, [*files, parameters] if parameters else files, BackOff())
    return actions


def keep_running(node: FleetNode, parameters: list[Any], back_off: BackOff) -> list[Any]:
    """One node, in its robot's namespace, and what starts it again if it dies."""
    action = Node(
        package=PACKAGE,
        executable=node.name,
        namespace=node.namespace,
        parameters=parameters,
        output="screen",
    )
    started_s = time.monotonic()

    def start_again(event: Any, context: LaunchContext) -> list[Any] | None:
        if context.is_shutdown:
            return None
        wait_s = back_off.after(time.monotonic() - started_s)
        text = f"{event.process_name} ended with {event.returncode}; starting it again in"
        again = OpaqueFunction(function=lambda _: keep_running(node, parameters, back_off))
        return [LogInfo(msg=f"{text} {wait_s:g} s"), TimerAction(period=wait_s, actions=[again])]

    on_exit = OnProcessExit(target_action=action, on_exit=start_again, handle_once=True)
    return [RegisterEventHandler(on_exit), action]
