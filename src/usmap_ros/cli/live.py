"""What the commands that need ROS 2 share."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import typer

from usmap_ros.errors import ConfigurationError

if TYPE_CHECKING:
    from usmap_ros.parameters.nodes import NodeParameters


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
    run_node(
        lambda: create(parameter_overrides=overrides),
        arguments=[],
        program="usmap",
        looks_for_topics=True,
    )
