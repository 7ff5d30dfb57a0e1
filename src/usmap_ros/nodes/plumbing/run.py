"""What the main functions of all nodes share, and how they are asked to end."""

import os
import re
import signal
import socket
import sys
import tempfile
import threading
from collections.abc import Callable
from pathlib import PurePath
from typing import Any, NoReturn

import rclpy
from rclpy.exceptions import NameValidationException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.utilities import remove_ros_args

from usmap_ros.errors import UsmapError
from usmap_ros.processes.threads import take_short_turns

#: By what Fast DDS reaches other processes.
TRANSPORTS_VARIABLE = "FASTDDS_BUILTIN_TRANSPORTS"
_ASKED_TO_END = (signal.SIGINT, signal.SIGTERM)
#: Time for ROS to let go of a node, s; it takes a twentieth of one, and with a supervisor's 8 there
#: is time enough for the map to be kept before.
_PATIENCE_S = 5
_INIT_FAILED = "failed to initialize rcl: "


class EndRequest:
    """Done as soon as the process is asked to end; asking again changes nothing.

    A handler in Python runs between two of the main thread's steps, and that thread waits inside
    ROS most of the time; one that raises may interrupt anything, such as the last checkpoint.
    So the handlers do nothing: Python writes each signal's number into a socket at once, and a
    thread that waits there tells the executor.
    """

    def __init__(self) -> None:
        #: What an executor can spin until.
        self.future = Future()
        self._receiver, self._sender = socket.socketpair()
        self._sender.setblocking(False)
        signal.set_wakeup_fd(self._sender.fileno(), warn_on_full_buffer=False)
        for number in _ASKED_TO_END:
            signal.signal(number, lambda *_: None)
        threading.Thread(target=self._wait, name="signals", daemon=True).start()

    def ignore_more(self) -> None:
        """Let the process end in its own time: it has been asked."""
        for number in _ASKED_TO_END:
            signal.signal(number, signal.SIG_IGN)
        signal.set_wakeup_fd(-1)

    def _wait(self) -> None:
        while received := self._receiver.recv(1):
            if received[0] in _ASKED_TO_END:
                self.future.set_result(None)
                return


def prepare_environment() -> None:
    """Set what ROS needs and an environment made by pip may lack."""
    # ament_index_python looks for packages there, and rclpy keeps its logs below HOME.
    os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)
    os.environ.setdefault("HOME", tempfile.gettempdir())
    # What Fast DDS shares in memory stays half written where a process is killed in the middle, and
    # takes down who opens it next (eProsima/Fast-DDS#6501); loopback costs no more.
    os.environ.setdefault(TRANSPORTS_VARIABLE, "UDPv4")


def run_node(
    create: Callable[[], Any],
    arguments: list[str] | None = None,
    *,
    program: str | None = None,
    has_loops: bool = False,
    looks_for_topics: bool = False,
) -> NoReturn:
    """Run a node until SIGINT or SIGTERM, and end the process; the main function of executables.

    Its ``close`` finishes what must not be lost, however often the process is asked to end
    meanwhile.  Exit status 1: the node could not start, or not finish what it had begun; one line
    on standard error says why.

    Parameters
    ----------
    create : callable
        Makes the node.
    arguments : list of str, optional
        For ROS; by default those of the command line.
    program : str, optional
        What it is called in messages; by default as it was started.
    has_loops : bool
        Whether it needs inner loops compiled, and waits for that before it listens to anything.
    looks_for_topics : bool
        Whether it looks for topics that it was not told of.
    """
    prepare_environment()
    take_short_turns()
    name = program or PurePath(sys.argv[0]).stem
    if has_loops:
        # Here, because it takes half as long to load as all that a node without loops does.
        from usmap_ros.runs.compilation import compile_if_needed

        compile_if_needed(lambda line: print(f"{name}: {line}", file=sys.stderr, flush=True))
    if looks_for_topics:
        # A discovery server tells others only of those whose topics they have already.
        os.environ.setdefault("ROS_SUPER_CLIENT", "TRUE")
    end = EndRequest()
    try:
        _begin_ros(arguments)
        node = create()
    except (UsmapError, NameValidationException) as error:
        _tell(name, error)
        end.ignore_more()
        _end_soon()
        rclpy.try_shutdown()
        _leave(1)
    status = 0
    try:
        _spin(node, end)
    finally:
        end.ignore_more()
        try:
            node.close()
        except UsmapError as error:
            _tell(name, error)
            status = 1
        _end_soon()
        node.destroy_node()
        rclpy.try_shutdown()
    _leave(status)


def _tell(name: str, error: Exception) -> None:
    """Say what is wrong, in one line."""
    print(f"{name}: error: {' '.join(str(error).split())}", file=sys.stderr)


def _begin_ros(arguments: list[str] | None) -> None:
    """Start ROS; raise `UsmapError` if it cannot read the command line, or leaves any of it."""
    try:
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        # Where in the sources of ROS it was noticed helps nobody here.
        cause = re.sub(r",? at /\S+:\d+", "", str(error))
        raise UsmapError(f"ROS arguments: {cause.removeprefix(_INIT_FAILED)}") from error
    _, *others = remove_ros_args(sys.argv if arguments is None else ["", *arguments])
    if others:
        raise UsmapError(
            f"takes no argument '{others[0]}', but parameters: --ros-args -p NAME:=VALUE"
        )


def _end_soon() -> None:
    """Let the kernel end this process if it does not end by itself.

    Once in some hundred times Fast DDS hangs as it is taken down, and takes a whole core.  There
    is nothing left to lose then, and no Python that could notice.
    """
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.alarm(_PATIENCE_S)


def _leave(status: int) -> NoReturn:
    """End this process at once: others have been told that its node is gone.

    To take Python and all libraries apart takes 0.4 s of a core, ten times what came before, and
    the processes of a fleet all end at the same time.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)


def _spin(node: Any, end: EndRequest) -> None:
    """Handle a node's callbacks, in this thread, until the process is asked to end."""
    # rclpy's other executors lose messages: see docs/nodes.md.
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    try:
        executor.spin_until_future_complete(end.future)
    except ExternalShutdownException:
        pass  # The node ended itself, as a replay does.
    finally:
        executor.remove_node(node)
        executor.shutdown(timeout_sec=1.0)
