"""A thread for the heavy work of a node, so that its executor goes on receiving."""

import threading
from collections.abc import Callable

from rclpy.node import Node

from usmap_ros.processes.threads import give_way


class Worker:
    """Calls `step` in a thread of its own whenever there may be something to do.

    An error in `step` is raised again in the executor's thread: it ends the node, or the test.

    Parameters
    ----------
    node : Node
        Whose executor is told of errors.
    step : callable
        Does one piece of work. Returns the seconds after which it wants to be called again,
        0 for at once, or None if only when woken.
    interrupt : callable, optional
        Ends a wait within `step`.
    patience : int
        By how much the thread is to give way to all others, as `give_way` has it.
    """

    def __init__(
        self,
        node: Node,
        step: Callable[[], float | None],
        interrupt: Callable[[], None] = lambda: None,
        patience: int = 0,
    ) -> None:
        self._step = step
        self._patience = patience
        self._interrupt = interrupt
        self._node = node
        self._awake = threading.Event()
        self._is_stopping = False
        self._error: BaseException | None = None
        self._alarm = node.create_guard_condition(self._raise)
        self._thread = threading.Thread(target=self._run, name=node.get_name(), daemon=True)
        self._thread.start()

    def wake(self) -> None:
        """Have `step` called."""
        self._awake.set()
        self._interrupt()

    def stop(self) -> None:
        """End the thread after the piece of work that it is at."""
        self._is_stopping = True
        self.wake()
        self._thread.join()
        self._node.destroy_guard_condition(self._alarm)

    def _run(self) -> None:
        try:
            if self._patience:
                give_way(self._patience)
            while not self._is_stopping:
                self._awake.clear()
                pause_s = self._step()
                if pause_s != 0.0:
                    self._awake.wait(pause_s)
        except BaseException as error:
            self._error = error
            self._alarm.trigger()

    def _raise(self) -> None:
        if self._error is not None:
            raise self._error
