"""Reconstruction in several processes gives what one process gives, in the same order."""

import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import pytest

from usmap_ros.io.bag_reader import BagReader
from usmap_ros.io.bag_writer import new_bag
from usmap_ros.io.bags import write_bag
from usmap_ros.io.stretch import TraceStretch
from usmap_ros.pings.trace import EchoTrace, Encoding
from usmap_ros.processes.cores import available_cores
from usmap_ros.runs.parallel import BATCH, reconstructors
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.simulation import Scenario, simulate

BAG = Path(__file__).parents[3] / "bags" / "yard"


@pytest.fixture(scope="module")
def traces() -> list[tuple[str, EchoTrace]]:
    with BagReader([BAG]) as bag:
        return list(bag.traces())[:120]


#: In a process of its own: this one may have threads, and then does not fork.
COMPARE = """
from pathlib import Path
import numpy as np
from usmap_ros.io.bag_reader import BagReader
from usmap_ros.runs.parallel import reconstructors
from usmap_ros.runs.pipeline import Pipeline

def cones(processes):
    with reconstructors(Pipeline(), processes) as workers:
        assert workers.processes == processes
        with BagReader([Path({bag!r})]) as bag:
            found = list(workers.cones(bag))
            return found, dict(bag.skipped.by_field)

(alone, alone_skipped), (shared, shared_skipped) = cones(1), cones(2)
assert alone_skipped == shared_skipped
for (topic, one), (other_topic, other) in zip(alone, shared, strict=True):
    assert topic == other_topic
    assert one.stamp_ns == other.stamp_ns
    assert np.array_equal(one.ranges_m, other.ranges_m)
    assert np.array_equal(one.detection_limits, other.detection_limits)
    assert one.bearings_rad is other.bearings_rad or np.array_equal(
        one.bearings_rad, other.bearings_rad, equal_nan=True)
print("the same,", len(shared))
"""
#: Before the above: each worker is killed at its second stretch.
KILL = """
import os, signal
from usmap_ros.runs import parallel

cones_here, home, done_here = parallel.stretch_cones, os.getpid(), []

def killed_elsewhere(*given):
    done_here.append(1)
    if os.getpid() != home and len(done_here) == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return cones_here(*given)

parallel.stretch_cones = killed_elsewhere
"""
SCENARIOS = Path(__file__).parents[3] / "config" / "scenarios"


@pytest.fixture(scope="module")
def without_noise(
    traces: list[tuple[str, EchoTrace]], tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """Pings of which most do not state their noise, and some cannot be used."""
    bag = tmp_path_factory.mktemp("noise") / "bag"
    with new_bag(bag) as writer:
        for number, (topic, trace) in enumerate(traces):
            # Real samples at half the rate that the carrier needs.
            aliased = {"encoding": Encoding.RAW, "sample_rate_hz": 50_000.0}
            changed: dict[str, Any] = {} if number % 7 == 0 else {"noise_std": 0.0}
            writer.write_trace(
                topic, replace(trace, **changed, **(aliased if number % 13 == 0 else {}))
            )
    return bag


@pytest.fixture(scope="module")
def simultaneous(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Pings of transducers that belong together."""
    bag = tmp_path_factory.mktemp("simultaneous") / "bag"
    scenario = Scenario.load(SCENARIOS / "two_transducers.yaml")
    write_bag(bag, islice(simulate(scenario), 90))
    return bag


@pytest.mark.parametrize("name", ["yard", "without_noise", "simultaneous"])
def test_two_processes_give_the_cones_of_one(name: str, request: pytest.FixtureRequest) -> None:
    bag = BAG if name == "yard" else request.getfixturevalue(name)
    script = COMPARE.format(bag=str(bag))
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert done.stdout.startswith("the same"), done.stderr
    assert int(done.stdout.split()[-1]) > BATCH


def test_what_killed_processes_left_is_reconstructed_here() -> None:
    script = KILL + COMPARE.format(bag=str(BAG)) + "assert len(done_here) > 1"
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("the same")
    assert "was killed" in done.stderr


def test_a_process_with_threads_works_alone() -> None:
    ended = threading.Event()
    thread = threading.Thread(target=ended.wait)
    thread.start()
    try:
        with reconstructors(Pipeline(), 2) as workers:
            assert workers.processes == 1
    finally:
        ended.set()
        thread.join()


@pytest.mark.parametrize("processes", [1, 2])
def test_a_trace_that_cannot_be_reconstructed_is_accounted_for(
    without_noise: Path, traces: list[tuple[str, EchoTrace]], processes: int
) -> None:
    with reconstructors(Pipeline(), processes) as workers, BagReader([without_noise]) as bag:
        found = list(workers.cones(bag))
        assert bag.skipped.by_field == {"sample_rate": len(traces[::13])}
    stamps_ns = [trace.stamp_ns for number, (_, trace) in enumerate(traces) if number % 13]
    assert [cone.stamp_ns for _, cone in found] == stamps_ns


def test_a_recording_is_not_taken_in_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    cuts, taken = TraceStretch.cuts, 0

    def counted(stretch: TraceStretch, length: int) -> Iterator[TraceStretch]:
        nonlocal taken
        for cut in cuts(stretch, 5):
            taken += 1
            yield cut

    monkeypatch.setattr(TraceStretch, "cuts", counted)
    with reconstructors(Pipeline(), 2) as workers, BagReader([BAG]) as bag:
        next(workers.cones(bag))
        assert taken <= 4 < bag.trace_count // 5


def test_there_is_a_core_to_work_on() -> None:
    assert available_cores() >= 1
