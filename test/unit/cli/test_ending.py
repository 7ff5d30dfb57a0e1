"""Commands that are asked to end leave neither processes nor half-made files behind."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from usmap_ros.io.bag_writer import new_bag
from usmap_ros.simulation import Scenario, simulate

DEADLINE_S = 300.0

#: Maps as 'usmap map' does, but stays at its first ping.  In naps: Python answers a signal that
#: comes on the threshold of a system call after that call, and would sleep an hour first.
STUCK = """
import multiprocessing, sys, time
from usmap_ros.cli import main
from usmap_ros.runs.pipeline import Pipeline

def stuck(self, cone, source=""):
    print(*(child.pid for child in multiprocessing.active_children()), flush=True)
    while True:
        time.sleep(0.05)

Pipeline.fuse = stuck
sys.argv = ["usmap", "map", "bag", "-o", "map", "-j", "2"]
main()
"""


@pytest.fixture(scope="module")
def folder(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give a folder with a recording of 40 pings in it."""
    folder = tmp_path_factory.mktemp("ending")
    scenario = Scenario.load(request.config.rootpath / "config/scenarios/poles.yaml")
    pings = simulate(scenario)
    with new_bag(folder / "bag") as writer:
        for _ in range(40):
            writer.write_trace(*next(pings))
    return folder


@pytest.fixture
def start(folder: Path) -> Iterator[Callable[[], tuple[Any, list[int]]]]:
    """Give a function that starts a mapping; it gives the process and its workers' numbers."""
    started: list[Any] = []

    def begin() -> tuple[Any, list[int]]:
        process = subprocess.Popen(
            [sys.executable, "-c", STUCK],
            cwd=folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        started.append(process)
        assert process.stdout is not None
        workers = [int(number) for number in process.stdout.readline().split()]
        assert len(workers) == 2, workers or process.communicate()[1]
        return process, workers

    yield begin
    for process in started:
        process.kill()
        process.communicate()


def ended(number: int) -> bool:
    """Whether a process is gone, or only waits for somebody to ask what became of it."""
    try:
        status = Path(f"/proc/{number}/stat").read_text()
    except OSError:
        return True
    return status.rpartition(")")[2].split()[0] == "Z"


def until_all_ended(numbers: list[int]) -> None:
    end_s = time.monotonic() + DEADLINE_S
    while not all(ended(number) for number in numbers):
        assert time.monotonic() < end_s, "a worker is left"
        time.sleep(0.05)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has workers")
@pytest.mark.parametrize(
    ("number", "status"), [(signal.SIGTERM, 143), (signal.SIGINT, 130), (signal.SIGKILL, -9)]
)
def test_no_worker_outlives_a_mapping(
    start: Any, folder: Path, number: signal.Signals, status: int
) -> None:
    process, workers = start()
    process.send_signal(number)
    _, said = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == status
    assert "Traceback" not in said
    until_all_ended(workers)
    if number != signal.SIGKILL:
        assert not (folder / "map").exists()


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has workers")
def test_ctrl_c_in_a_terminal_prints_no_traceback(start: Any) -> None:
    process, workers = start()
    # To the whole group, as a terminal does.
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=DEADLINE_S)
    assert "Traceback" not in said
    until_all_ended(workers)


def test_a_simulation_that_is_ended_leaves_nothing_behind(folder: Path, tmp_path: Path) -> None:
    code = """
import sys, time
from usmap_ros.io.bag_writer import BagWriter
from usmap_ros.cli import main

def stuck(self, topic, trace):
    print("writing", flush=True)
    while True:
        time.sleep(0.05)

BagWriter.write_trace = stuck
sys.argv = ["usmap", "simulate", sys.argv[1], "-o", "bag"]
main()
"""
    scenario = Path(__file__).parents[3] / "config/scenarios/poles.yaml"
    process = subprocess.Popen(
        [sys.executable, "-c", code, str(scenario)],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "writing\n"
    process.terminate()
    _, said = process.communicate(timeout=DEADLINE_S)
    assert (process.returncode, said) == (143, "")
    assert list(tmp_path.iterdir()) == []


def answers_ctrl_c(process: Any) -> bool:
    """Whether a process has a handler of SIGINT, which Python has from its start."""
    status = Path(f"/proc/{process.pid}/status").read_text()
    return bool(int(status.partition("SigCgt:")[2].split()[0], 16) >> (signal.SIGINT - 1) & 1)


@pytest.mark.skipif(sys.platform != "linux", reason="asks Linux how far the process is")
def test_ctrl_c_while_the_program_is_loaded_prints_nothing(tmp_path: Path) -> None:
    # As the executable that pip makes of the entry point.
    program = tmp_path / "usmap"
    program.write_text("from usmap_ros.cli import main\nmain()\n")
    process = subprocess.Popen(
        [sys.executable, str(program), "--help"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    end_s = time.monotonic() + DEADLINE_S
    for has_begun in (True, False):
        while answers_ctrl_c(process) is not has_begun:
            assert time.monotonic() < end_s
            time.sleep(0.001)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=DEADLINE_S)
    assert (process.returncode, said) == (-signal.SIGINT, "")
