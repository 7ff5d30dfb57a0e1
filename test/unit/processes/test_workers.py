"""Processes beside this one."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from usmap_ros.processes.workers import Beside

KILLED = "a process beside this one was killed; its work is done here\n"

#: Run by itself, since it forks before there are any threads.
PROGRAM = """
import os, signal, threading, time
from usmap_ros.processes.workers import Beside, start_helpers

start_helpers(1)
helper = Beside(os.getpid).result()
assert helper != os.getpid()
assert os.getpriority(os.PRIO_PROCESS, helper) > os.getpriority(os.PRIO_PROCESS, 0)
calls = []
Beside(time.sleep, 0.3).result(lambda: calls.append(1))
assert calls
try:
    Beside(int, "none").result()
except ValueError as error:
    print(error)
os.kill(helper, signal.SIGTERM)
assert Beside(os.getpid).result() == helper
os.kill(helper, signal.SIGKILL)
assert Beside(os.getpid).result() == os.getpid()
# A pool that ends with its process, and not before, may say so where errors are said.
for thread in threading.enumerate()[1:]:
    thread.join()
print("done")
"""

#: The same of workers.
WORKERS = """
import os, signal, threading
from usmap_ros.processes.workers import Beside, worker_processes

def killed_elsewhere(home):
    if os.getpid() != home:
        os.kill(os.getpid(), signal.SIGKILL)
    return os.getpid()

own = os.getpriority(os.PRIO_PROCESS, 0)
with worker_processes(2) as executor:
    worker = Beside(os.getpid, executor=executor).result()
    assert worker != os.getpid()
    assert os.getpriority(os.PRIO_PROCESS, worker) == own
    worker = Beside(os.getpid, executor=executor, patience=5).result()
    assert os.getpriority(os.PRIO_PROCESS, worker) == own + 5
    # It dies at its work, and so do the others; none does what comes after.
    assert Beside(killed_elsewhere, os.getpid(), executor=executor).result() == os.getpid()
    assert Beside(os.getpid, executor=executor, patience=5).result() == os.getpid()
    assert os.getpriority(os.PRIO_PROCESS, 0) == own
# A pool that ends with its process, and not before, may say so where errors are said.
for thread in threading.enumerate()[1:]:
    thread.join()
print("done")
"""


def run(program: str, temporary: Path) -> subprocess.CompletedProcess[str]:
    """Run a program whose temporary files have a folder of their own."""
    return subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False,
        timeout=120.0, env=os.environ | {"TMPDIR": str(temporary)},
    )  # fmt: skip


def test_a_helper_works_beside_and_its_work_is_done_here_when_it_is_killed(tmp_path: Path) -> None:
    done = run(PROGRAM, tmp_path)
    # Once: what comes after is not tried there.
    assert done.stderr == KILLED
    assert done.stdout.endswith("done\n")
    assert "none" in done.stdout


def test_workers_are_helpers_whose_patience_is_their_own(tmp_path: Path) -> None:
    done = run(WORKERS, tmp_path)
    assert (done.stderr, done.stdout) == (KILLED, "done\n")


#: One is killed as soon as a part of its result has come in, which takes memory.
KILLED_AS_IT_SENDS = """
import os, resource, signal, tempfile, time
from pathlib import Path
from usmap_ros.processes.workers import Beside, worker_processes

def large(told):
    told.write_text(str(os.getpid()))
    return bytes(300_000_000)

def most_kb():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

def kill_as_it_comes(begun_kb, told):
    if not killed and most_kb() > begun_kb + 50_000:
        os.kill(int(told.read_text()), signal.SIGKILL)
        killed.append(True)

told, killed = Path(tempfile.gettempdir(), "worker"), []
with worker_processes(2) as executor:
    beside, begun_kb = Beside(large, told, executor=executor), most_kb()
    while not beside.is_done:
        kill_as_it_comes(begun_kb, told)
        time.sleep(0.001)
    assert len(beside.result()) == 300_000_000
assert [path.name for path in told.parent.iterdir()] == ["worker"]
print("done")
"""


def test_nobody_waits_for_ever_for_one_that_is_killed_as_it_sends(tmp_path: Path) -> None:
    """Who read the pipe that all of them share waited for the rest."""
    done = run(KILLED_AS_IT_SENDS, tmp_path)
    assert done.stdout == "done\n"
    assert done.stderr in {"", KILLED}


#: No file may have anything in it, as on a disk that is full.
WITHOUT_FILES = """
import resource, tempfile
from pathlib import Path
from usmap_ros.processes.workers import Beside, worker_processes

def work():
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, resource.RLIM_INFINITY))
    return bytes(1_000_000)

with worker_processes(2) as executor:
    assert Beside(work, executor=executor).result() == bytes(1_000_000)
assert not list(Path(tempfile.gettempdir()).iterdir())
print("done")
"""


def test_work_is_handed_over_where_files_cannot_be_written(tmp_path: Path) -> None:
    done = run(WITHOUT_FILES, tmp_path)
    assert (done.stderr, done.stdout) == ("", "done\n")


def test_without_helpers_work_is_done_here() -> None:
    work = Beside(os.getpid)
    assert work.is_done
    assert work.result() == os.getpid()


def test_what_work_raises_is_raised() -> None:
    with pytest.raises(ValueError, match="none"):
        Beside(int, "none").result()


def test_helpers_end_with_the_process_that_started_them() -> None:
    program = (
        "import os, signal\n"
        "from usmap_ros.processes.workers import Beside, start_helpers\n"
        "start_helpers(1)\n"
        "print(Beside(os.getpid).result(), flush=True)\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    # Its output ends when nobody is left who could write there.
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=60.0
    )
    assert done.returncode == -signal.SIGKILL
    assert int(done.stdout) > 0
