"""What the commands that need ROS 2 share."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib.util import find_spec
from typing import Any

from usmap_ros.errors import UsmapError


def require_ros() -> None:
    """Make sure that ROS 2 is there.

    Raises
    ------
    UsmapError
        If not, with what to do about it.
    """
    for package in ("rclpy", "usmap_msgs"):
        if find_spec(package) is None:
            raise UsmapError(
                f"this command needs ROS 2 Jazzy, and the Python package {package} is missing;"
                " see 'Install' in the README"
            )


def run_live_node(create: Callable[..., Any], parameters: Mapping[str, Any]) -> None:
    """Run a node in this process, with parameters from the command line.

    Parameters
    ----------
    create : callable
        Makes the node, of ``parameter_overrides``.
    parameters : mapping
        By name; None: the default.
    """
    from rclpy.parameter import Parameter

    from usmap_ros.nodes.plumbing.run import run_node

    overrides = [
        Parameter(name, value=value) for name, value in parameters.items() if value is not None
    ]
    # The command line has been read already; nothing of it is for ROS.
    run_node(lambda: create(parameter_overrides=overrides), arguments=[])
