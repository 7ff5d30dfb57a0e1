"""What the main functions of all nodes share."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

from usmap_ros.errors import UsmapError


def prepare_environment() -> None:
    """Set what ROS needs and an environment made by pip may lack."""
    # ament_index_python looks for packages there, and rclpy keeps its logs below HOME.
    os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)
    os.environ.setdefault("HOME", tempfile.gettempdir())


def run_node(create: Callable[[], Any], arguments: list[str] | None = None) -> None:
    """Run a node until it is interrupted; the main function of every executable.

    Its ``close`` finishes what must not be lost and destroys it.  Exit status 1: the node could
    not start; one line on standard error says why.

    Parameters
    ----------
    create : callable
        Makes the node.
    arguments : list of str, optional
        For ROS; by default those of the command line.
    """
    prepare_environment()
    rclpy.init(args=arguments)
    try:
        node = create()
    except UsmapError as error:
        print(f"{os.path.basename(sys.argv[0])}: error: {error}", file=sys.stderr)
        rclpy.try_shutdown()
        sys.exit(1)
    except Exception:
        # A context that ends while the node is being made breaks whatever was at hand.
        if rclpy.ok():
            raise
        return
    try:
        spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        # This is how a node is meant to end: rclpy turns SIGINT and SIGTERM into these.
        pass
    finally:
        node.close()
        rclpy.try_shutdown()


def spin(node: Any) -> None:
    """Handle a node's callbacks, in this thread, until the context ends."""
    # rclpy's other executors lose messages: see docs/nodes.md.
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    try:
        executor.spin()
    finally:
        executor.remove_node(node)
        executor.shutdown(timeout_sec=1.0)
