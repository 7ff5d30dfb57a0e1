"""Processes that are kept running, their output in one stream, and one way to end them all."""

import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

#: Waits before restarts of a process that keeps dying, s.
_FIRST_WAIT_S, _LONGEST_WAIT_S = 0.5, 30.0
#: A process that lived this long is healthy again: its next restart comes soon.
_HEALTHY_AFTER_S = 30.0
#: How long processes get to end, by the signal that asks them to.  Below 10 s in all; one that has
#: not listened to SIGINT by then has hung, and would not listen to SIGTERM either.
_PATIENCE_S = ((signal.SIGINT, 8.0), (signal.SIGKILL, 1.0))
#: For the last lines that processes have written.
_LAST_LINES_S = 0.5
_POLL_S = 0.1

#: Tells a process who keeps it running, so that it can end if that is killed.
PARENT_VARIABLE = "USMAP_PARENT"


class BackOff:
    """Waits before restarts of a process: the longer, the more often it has died in a row."""

    def __init__(self) -> None:
        self._wait_s = _FIRST_WAIT_S

    def after(self, lived_s: float) -> float:
        """How long to wait (s) before the restart of a process that lived so long."""
        if lived_s > _HEALTHY_AFTER_S:
            self._wait_s = _FIRST_WAIT_S
        wait_s = self._wait_s
        self._wait_s = min(2.0 * wait_s, _LONGEST_WAIT_S)
        return wait_s


@dataclass
class Task:
    """One process to keep running."""

    #: Stands before every line of its output.
    name: str
    command: Sequence[str]
    process: subprocess.Popen[str] | None = field(default=None, init=False)
    started_s: float = field(default=0.0, init=False)
    restart_at_s: float = field(default=0.0, init=False)
    back_off: BackOff = field(default_factory=BackOff, init=False)


class Supervisor:
    """Starts processes, restarts those that die, and ends all of them.

    Parameters
    ----------
    tasks : sequence of Task
        What to run.
    say : callable
        Gets each line of output, with the name of its process before it.
    """

    def __init__(self, tasks: Sequence[Task], say: Callable[[str], None]) -> None:
        self.tasks = list(tasks)
        self._say = say
        self._width = max((len(task.name) for task in self.tasks), default=0)
        # A plain flag: an Event, set by a handler while it is waited for, could lock up.
        self._is_stopping = False
        self._readers: list[threading.Thread] = []

    def stop(self) -> None:
        """Let `run` end; may be called from a signal handler or another thread."""
        self._is_stopping = True

    def run(self, duration_s: float | None = None) -> None:
        """Keep all processes running until `stop`, or for `duration_s`; then end them."""
        end_s = None if duration_s is None else time.monotonic() + duration_s
        try:
            for task in self.tasks:
                self._start(task)
            while not self._is_stopping and (end_s is None or time.monotonic() < end_s):
                time.sleep(_POLL_S)
                for task in self.tasks:
                    self._look_after(task)
        finally:
            self._end_all()

    def _start(self, task: Task) -> None:
        # In a session of its own, a process does not get the terminal's Ctrl-C: it is told once,
        # by the supervisor.
        task.process = subprocess.Popen(
            task.command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            start_new_session=True,
            env={**os.environ, PARENT_VARIABLE: str(os.getpid())},
        )
        task.started_s = time.monotonic()
        reader = threading.Thread(target=self._relay, args=(task.name, task.process), daemon=True)
        reader.start()
        self._readers.append(reader)

    def _relay(self, name: str, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None
        with process.stdout:
            for line in process.stdout:
                self._line(name, line.rstrip())

    def _line(self, name: str, text: str) -> None:
        self._say(f"[{name:{self._width}}] {text}")

    def _look_after(self, task: Task) -> None:
        """Notice that a process has died, and start it again when its time has come."""
        now_s = time.monotonic()
        if task.process is None:
            if now_s >= task.restart_at_s:
                self._start(task)
            return
        status = task.process.poll()
        if status is None:
            return
        wait_s = task.back_off.after(now_s - task.started_s)
        self._line(task.name, f"{_describe(status)}; starting it again in {wait_s:g} s")
        task.process = None
        task.restart_at_s = now_s + wait_s

    def _end_all(self) -> None:
        alive = [task for task in self.tasks if task.process is not None]
        for number, patience_s in _PATIENCE_S:
            alive = [task for task in alive if task.process and task.process.poll() is None]
            for task in alive:
                if number is not signal.SIGINT:
                    self._line(task.name, f"does not end; sending it {number.name}")
                assert task.process is not None
                task.process.send_signal(number)
            self._wait_for(alive, patience_s)
        end_s = time.monotonic() + _LAST_LINES_S
        for reader in self._readers:
            reader.join(max(0.0, end_s - time.monotonic()))

    def _wait_for(self, tasks: Sequence[Task], patience_s: float) -> None:
        end_s = time.monotonic() + patience_s
        for task in tasks:
            assert task.process is not None
            try:
                task.process.wait(max(0.0, end_s - time.monotonic()))
            except subprocess.TimeoutExpired:
                continue


def _describe(status: int) -> str:
    """What became of a process, from its exit status."""
    if status < 0:
        return f"was killed by {signal.Signals(-status).name}"
    return f"ended with exit status {status}"
