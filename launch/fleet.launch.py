"""A fleet of simulated robots, and the fusion of what they hear.

    ros2 launch usmap_ros fleet.launch.py robots:=robot1,robot2 rviz:=true

It needs a full installation of ROS 2; where launch is missing, ``usmap fleet`` does the same.
"""

from __future__ import annotations

import os
import time
from typing import Any

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

PACKAGE = "usmap_ros"
SHARE = get_package_share_directory(PACKAGE)
SCENARIO = os.path.join(SHARE, "config", "scenarios", "poles.yaml")
RVIZ_FILE = os.path.join(SHARE, "config", "rviz", "usmap.rviz")

ARGUMENTS = {
    "robots": ("robot1,robot2,robot3", "Names of robots in the scenario, with commas between."),
    "scenario": (SCENARIO, "Scenario file with the world and the robots."),
    "transducers": ("", "Names of each robot's transducers, if it has several."),
    "parameters": ("", "ROS parameter file for all nodes; empty: their defaults."),
    "checkpoint": ("", "Folder in which the map is kept; empty: none."),
    "pose_source": ("path", "Where robots are: path, tf or odometry."),
    "use_sim_time": ("false", "Whether time is that of /clock."),
    "rviz": ("false", "Whether to start RViz."),
}


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
    # The same for all, so that they share moving objects; simulated time starts when it starts.
    start_time_s = 0.0 if use_sim_time else time.time()
    nodes = []
    for robot in filter(None, given["robots"].split(",")):
        driver = {
            "scenario": given["scenario"],
            "robot": robot,
            "pose_source": given["pose_source"],
            "start_time_s": start_time_s,
        }
        transducers = [name for name in given["transducers"].split(",") if name]
        reconstructor = {"transducers": transducers} if transducers else {}
        nodes += [
            make_node("echo_driver", robot, driver, given),
            make_node("cone_reconstructor", robot, reconstructor, given),
        ]
    fusion = {"checkpoint_path": given["checkpoint"]}
    return [*nodes, make_node("map_fusion", "", fusion, given)]


def make_node(name: str, robot: str, parameters: dict[str, Any], given: dict[str, str]) -> Node:
    """One node, in its robot's namespace, started again if it dies."""
    files = [given["parameters"]] if given["parameters"] else []
    common = {"use_sim_time": given["use_sim_time"].lower() == "true"}
    return Node(
        package=PACKAGE,
        executable=name,
        namespace=robot,
        parameters=[*files, {**common, **parameters}],
        respawn=True,
        respawn_delay=1.0,
        output="screen",
    )
