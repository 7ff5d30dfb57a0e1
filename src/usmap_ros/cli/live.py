"""What the commands that need ROS 2 share."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import typer

from usmap_ros.errors import ConfigurationError, UsmapError

if TYPE_CHECKING:
    from usmap_ros.parameters.nodes import NodeParameters


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


def run_live_node(
    create: Callable[..., Any], group: type[NodeParameters], given: Mapping[str, Any]
) -> None:
    """Run a node in this process, with parameters from the command line.

    Parameters
    ----------
    create : callable
        Makes the node, of ``parameter_overrides``.
    group : type
        The model of its parameters, which has their defaults and bounds.
    given : mapping
        By name; None: not given.

    Raises
    ------
    typer.BadParameter
        If a value is out of bounds: that is wrong usage.
    """
    from rclpy.parameter import Parameter

    from usmap_ros.io.yaml_files import validated
    from usmap_ros.nodes.plumbing.run import run_node

    chosen = {name: value for name, value in given.items() if value is not None}
    try:
        validated("command line", group, chosen)
    except ConfigurationError as error:
        raise typer.BadParameter(error.cause) from error
    overrides = [Parameter(name, value=value) for name, value in chosen.items()]
    # The command line has been read already; nothing of it is for ROS.
    run_node(lambda: create(parameter_overrides=overrides), arguments=[])
