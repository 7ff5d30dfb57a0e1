"""SIGINT and SIGTERM, as something that an executor can wait for."""

from __future__ import annotations

import signal
import socket
import threading

from rclpy.task import Future

_ASKED_TO_END = (signal.SIGINT, signal.SIGTERM)


class EndRequest:
    """Done as soon as the process is asked to end; asking again changes nothing.

    A handler in Python runs between two of the main thread's steps, and that thread waits inside
    ROS most of the time; one that raises may interrupt anything, such as the last checkpoint.
    So the handlers do nothing: Python writes each signal's number into a socket at once, and a
    thread that waits there tells the executor.

    Attributes
    ----------
    future : Future
        What an executor can spin until.
    """

    def __init__(self) -> None:
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
