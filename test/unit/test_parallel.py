"""Reconstruction in several processes gives what one process gives, in the same order."""

import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from usmap_ros.errors import MalformedMessageError
from usmap_ros.io.bag_reader import BagReader
from usmap_ros.parallel import Outcome, available_cores, reconstructors
from usmap_ros.pipeline import Pipeline
from usmap_ros.trace import EchoTrace, Encoding

BAG = Path(__file__).parents[2] / "bags" / "yard"


@pytest.fixture(scope="module")
def traces() -> list[tuple[str, EchoTrace]]:
    with BagReader([BAG]) as bag:
        return [(topic, trace) for topic, trace in bag.traces()][:40]


def outcomes(traces: list[tuple[str, EchoTrace]], processes: int) -> list[Outcome]:
    with reconstructors(Pipeline(), processes) as workers:
        return list(workers.cones(traces))


#: In a process of its own: this one may have threads, and then does not fork.
COMPARE = """
from pathlib import Path
import numpy as np
from usmap_ros.io.bag_reader import BagReader
from usmap_ros.parallel import reconstructors
from usmap_ros.pipeline import Pipeline

def cones(processes):
    with reconstructors(Pipeline(), processes) as workers:
        assert workers.processes == processes
        with BagReader([Path({bag!r})]) as bag:
            return list(workers.cones(bag.traces()))

for alone, shared in zip(cones(1), cones(2), strict=True):
    assert alone[:2] == shared[:2]
    assert np.array_equal(alone[2].ranges_m, shared[2].ranges_m)
    assert np.array_equal(alone[2].detection_limits, shared[2].detection_limits)
print("the same")
"""


def test_two_processes_give_the_cones_of_one() -> None:
    script = COMPARE.format(bag=str(BAG))
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert done.stdout == "the same\n", done.stderr


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
def test_a_trace_that_cannot_be_reconstructed_is_named(
    traces: list[tuple[str, EchoTrace]], processes: int
) -> None:
    topic, trace = traces[3]
    # Real samples at half the rate that the carrier needs.
    aliased = replace(trace, encoding=Encoding.RAW, sample_rate_hz=50_000.0)
    found = outcomes([*traces[:3], (topic, aliased), *traces[4:6]], processes)
    (error,) = [outcome for _, _, outcome in found if isinstance(outcome, MalformedMessageError)]
    assert error.field == "sample_rate"
    assert found[3][2] is error
    assert found[3][:2] == (topic, trace.stamp_ns)


def test_traces_are_not_all_taken_in_at_once(traces: list[tuple[str, EchoTrace]]) -> None:
    taken = 0

    def counted() -> Iterator[tuple[str, EchoTrace]]:
        nonlocal taken
        for _ in range(10):
            for recorded in traces:
                taken += 1
                yield recorded

    with reconstructors(Pipeline(), 2) as workers:
        next(workers.cones(counted()))
        assert taken < 100


def test_there_is_a_core_to_work_on() -> None:
    assert available_cores() >= 1
