"""The beginning of a node that is a program of its own, before ROS is imported."""

import os
import signal
import sys
from collections.abc import Sequence
from pathlib import PurePath

from usmap_ros.errors import UsmapError
from usmap_ros.live.requirements import require_ros
from usmap_ros.live.supervisor import PARENT_VARIABLE
from usmap_ros.processes.memory import look_for_garbage_rarely
from usmap_ros.processes.parent import end_with_parent
from usmap_ros.processes.workers import start_helpers

#: Each has an executable and a module of its name; here, because their declarations take long.
NODE_NAMES = (
    "bag_recorder",
    "bag_replay",
    "cone_reconstructor",
    "echo_driver",
    "map_fusion",
    "serial_driver",
)

#: Processes beside those nodes that have what takes seconds: the map of all pings and robots that
#: are judged, and receivers that are.
HELPERS = {"map_fusion": 2, "cone_reconstructor": 1}


def begin_program() -> None:
    """If Python was started to run a node, see to what its ``main`` would be too late for.

    Where ROS is missing, one line says so.  Importing takes seconds, in which Python would answer
    Ctrl-C with pages: until the node listens to it, it ends the program without a word.
    """
    name = node_name(sys.argv[0], sys.orig_argv)
    if name is None:
        return
    look_for_garbage_rarely()
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if PARENT_VARIABLE in os.environ:
        # Later on it makes the node end in good order, its map kept.
        end_with_parent(int(os.environ[PARENT_VARIABLE]), signal.SIGINT)
    try:
        require_ros()
    except UsmapError as error:
        sys.exit(f"{name}: error: {error}")
    if name in HELPERS:
        # Before ROS starts threads: what they hold at a fork, a helper would wait for in vain.
        start_helpers(HELPERS[name])


def node_name(program: str, arguments: Sequence[str]) -> str | None:
    """Name the node that Python was started to run; None if it was for something else.

    Parameters
    ----------
    program : str
        What ``sys.argv`` begins with: the executable, or "-m" while a module is looked for.
    arguments : sequence of str
        All that Python was started with.
    """
    if program == "-m":
        package, _, name = arguments[list(arguments).index("-m") + 1].rpartition(".")
        return name if package == __package__ and name in NODE_NAMES else None
    name = PurePath(program).name
    return name if name in NODE_NAMES else None
