"""Processes are kept running, speak under their names, and end together."""

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from usmap_ros.live import supervisor as supervisor_module
from usmap_ros.live.supervisor import Supervisor, Task

FOREVER = "import time; print('up', flush=True); time.sleep(60)"
STUBBORN = (
    "import signal, time; signal.signal(signal.SIGINT, signal.SIG_IGN);"
    "print('up', flush=True); time.sleep(60)"
)


def task(name: str, code: str) -> Task:
    return Task(name, [sys.executable, "-c", code])


@pytest.fixture
def run() -> Iterator[object]:
    """Give a function that runs tasks in the background; it gives the supervisor and its lines."""
    running: list[tuple[Supervisor, threading.Thread]] = []

    def start(*tasks: Task) -> tuple[Supervisor, list[str]]:
        lines: list[str] = []
        supervisor = Supervisor(tasks, lines.append)
        thread = threading.Thread(target=supervisor.run)
        thread.start()
        running.append((supervisor, thread))
        return supervisor, lines

    yield start
    for supervisor, thread in running:
        supervisor.stop()
        thread.join(300.0)
        assert not thread.is_alive()
        for one in supervisor.tasks:
            assert one.process is None or one.process.poll() is not None


def until(condition: object, timeout_s: float = 300.0) -> None:
    end_s = time.monotonic() + timeout_s
    while not condition():  # type: ignore[operator]
        assert time.monotonic() < end_s
        time.sleep(0.02)


def test_lines_carry_the_names_of_their_processes(run) -> None:  # type: ignore[no-untyped-def]
    _, lines = run(task("a", FOREVER), task("robot1", FOREVER))
    until(lambda: len(lines) == 2)
    assert sorted(lines) == ["[a     ] up", "[robot1] up"]


def test_a_process_that_dies_is_reported_and_started_again(  # type: ignore[no-untyped-def]
    run,
) -> None:
    supervisor, lines = run(task("a", FOREVER))
    until(lambda: lines == ["[a] up"])
    process = supervisor.tasks[0].process
    process.send_signal(signal.SIGKILL)
    until(lambda: len(lines) == 3)
    assert lines[1:] == ["[a] was killed by SIGKILL; starting it again in 0.5 s", "[a] up"]


def test_a_process_that_keeps_dying_is_started_ever_more_slowly(  # type: ignore[no-untyped-def]
    run,
) -> None:
    _, lines = run(task("a", "raise SystemExit(3)"), task("b", FOREVER))
    until(lambda: sum("starting it again" in line for line in lines) == 3)
    waits = [line.split()[-2] for line in lines if "exit status 3" in line]
    assert waits == ["0.5", "1", "2"]


def test_a_process_that_does_not_end_is_told_more_firmly(  # type: ignore[no-untyped-def]
    run, monkeypatch: pytest.MonkeyPatch
) -> None:
    patience = ((signal.SIGINT, 0.5), (signal.SIGKILL, 300.0))
    monkeypatch.setattr("usmap_ros.live.supervisor._PATIENCE_S", patience)
    supervisor, lines = run(task("a", STUBBORN))
    until(lambda: lines == ["[a] up"])
    supervisor.stop()
    until(lambda: supervisor.tasks[0].process.poll() is not None)
    assert lines[1:] == ["[a] does not end; sending it SIGKILL"]


def test_all_processes_are_gone_within_ten_seconds() -> None:
    asked_s = sum(patience_s for _, patience_s in supervisor_module._PATIENCE_S)
    assert asked_s + supervisor_module._LAST_LINES_S < 10.0
    # Nothing gets away: the last signal cannot be ignored.
    assert supervisor_module._PATIENCE_S[-1][0] == signal.SIGKILL


def test_it_ends_by_itself_when_it_is_told_how_long() -> None:
    supervisor = Supervisor([task("a", "import time; time.sleep(3600)")], lambda line: None)
    supervisor.run(duration_s=0.5)
    assert supervisor.tasks[0].process is not None
    assert supervisor.tasks[0].process.poll() is not None


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells of a parent's death")
def test_a_process_may_end_with_a_supervisor_that_is_killed() -> None:
    child = (
        "import os, signal, time; from usmap_ros.live.supervisor import PARENT_VARIABLE;"
        "from usmap_ros.processes.parent import end_with_parent;"
        "end_with_parent(int(os.environ[PARENT_VARIABLE]), signal.SIGKILL);"
        "print(os.getpid(), flush=True); time.sleep(3600)"
    )
    code = (
        "import sys; from usmap_ros.live.supervisor import Supervisor, Task;"
        "task = Task('a', [sys.executable, '-c', sys.argv[1]]);"
        "Supervisor([task], lambda line: print(line, flush=True)).run()"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code, child], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    number = int(process.stdout.readline().removeprefix("[a] "))
    process.kill()
    process.wait()

    def is_gone() -> bool:
        try:
            status = Path(f"/proc/{number}/stat").read_text()
        except OSError:
            return True
        return status.rpartition(")")[2].split()[0] == "Z"

    until(is_gone)
    process.stdout.close()
