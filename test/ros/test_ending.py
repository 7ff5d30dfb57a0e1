"""However a node is asked to end: no traceback, nothing lost, no hang."""

import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from usmap_ros.io.conversions import cone_to_cdr
from usmap_ros.io.map_files import load_map
from usmap_ros.live import supervisor
from usmap_ros.nodes.plumbing import run
from usmap_ros.nodes.plumbing.ros_types import RosMessageTypes
from usmap_ros.pings.cone import EchoCone

TYPES = RosMessageTypes()
DEADLINE_S = 300.0

#: A fusion whose checkpoint takes its time, and says when it begins.
SLOW_TO_KEEP = """
import time
from usmap_ros.live import checkpoint
from usmap_ros.nodes import map_fusion

save = checkpoint.save_map

def slowly(*arguments):
    print("keeping", flush=True)
    time.sleep(1.0)
    save(*arguments)

checkpoint.save_map = slowly
map_fusion.main()
"""
#: A reconstructor that hangs as its node is destroyed, where no Python can be run any more.
HANGS = """
import re
from usmap_ros.nodes import cone_reconstructor
from usmap_ros.nodes.plumbing import run

run._PATIENCE_S = 1

def spin_for_ever(self):
    re.match(r"(a|a)*b", "a" * 100)

cone_reconstructor.ConeReconstructor.destroy_node = spin_for_ever
cone_reconstructor.main()
"""


def log_of(process: Any) -> str:
    return str(process.log.read_text(errors="replace"))


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda n: n.name)
def test_the_map_is_kept_however_often_fusion_is_asked_to_end(
    live: Any,
    processes: Any,
    cones: list[tuple[str, EchoCone]],
    tmp_path: Path,
    number: signal.Signals,
) -> None:
    command = [sys.executable, "-c", SLOW_TO_KEEP, "--ros-args"]
    command += ["-p", f"checkpoint_path:={tmp_path / 'map'}", "-p", "checkpoint_period_s:=3600.0"]
    grids = live.listen("nav_msgs/msg/OccupancyGrid", "/map", 1)
    fusion = processes.run(command, "fusion")
    publisher = live.publisher("usmap_msgs/msg/EchoCone", "/robot1/cone", 50)
    publisher.publish(cone_to_cdr(cones[0][1]))
    live.until(lambda: grids, DEADLINE_S)
    fusion.send_signal(number)
    live.until(lambda: "keeping" in log_of(fusion), DEADLINE_S)
    for again in (number, signal.SIGINT, signal.SIGTERM):
        fusion.send_signal(again)
    assert fusion.wait(DEADLINE_S) == 0
    assert load_map(tmp_path / "map")[0].stamp_ns == cones[0][1].stamp_ns
    assert "Traceback" not in log_of(fusion)


def answers_ctrl_c(process: Any) -> bool:
    """Whether a process has a handler of SIGINT: Python's own at first, the node's at last."""
    status = Path(f"/proc/{process.pid}/status").read_text()
    caught = int(status.partition("SigCgt:")[2].split()[0], 16)
    return bool(caught >> (signal.SIGINT - 1) & 1)


def has_loaded(process: Any, library: str) -> bool:
    return library in Path(f"/proc/{process.pid}/maps").read_text()


#: How far a node is when it is asked to end: conditions that come true one after the other.
STAGES: dict[str, list[Callable[[Any], bool]]] = {
    "our first line": [],
    "NumPy": [lambda process: has_loaded(process, "_multiarray_umath")],
    "ROS": [lambda process: has_loaded(process, "librcl.so")],
    "the node's handlers": [answers_ctrl_c],
    "DDS": [answers_ctrl_c, lambda process: has_loaded(process, "libfastrtps")],
}


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="asks Linux how far the process is")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda n: n.name)
@pytest.mark.parametrize("stage", STAGES)
@pytest.mark.usefixtures("domain")
def test_a_node_that_is_asked_to_end_as_it_starts_ends_without_a_word(
    number: signal.Signals, stage: str
) -> None:
    command = [sys.executable, "-m", "usmap_ros.nodes.map_fusion"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    # Before, it is Python that starts.
    begun: list[Callable[[Any], bool]] = [answers_ctrl_c, lambda p: not answers_ctrl_c(p)]
    end_s = time.monotonic() + DEADLINE_S
    try:
        for condition in (*begun, *STAGES[stage]):
            while not condition(process):
                assert time.monotonic() < end_s
                time.sleep(0.002)
        process.send_signal(number)
        _, said = process.communicate(timeout=DEADLINE_S)
    finally:
        process.kill()
    assert "Traceback" not in said
    assert process.returncode in (0, -number)


def test_a_node_that_hangs_is_ended_before_its_supervisor_loses_patience() -> None:
    assert supervisor._PATIENCE_S[0][1] > run._PATIENCE_S


@pytest.mark.usefixtures("domain")
def test_a_node_that_hangs_as_it_is_taken_down_is_ended(processes: Any, live: Any) -> None:
    process = processes.run([sys.executable, "-c", HANGS], "hangs")
    live.until(lambda: live.peer.count_subscribers("/echo"), DEADLINE_S)
    process.send_signal(signal.SIGINT)
    assert process.wait(DEADLINE_S) == -signal.SIGALRM
