"""Reconstruction in several processes gives what one process gives, in the same order."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from usmap_ros.cone import EchoCone
from usmap_ros.errors import MalformedMessageError
from usmap_ros.io.bag_reader import BagReader
from usmap_ros.parallel import Outcome, available_cores, reconstructors
from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.trace import EchoTrace, Encoding

BAG = Path(__file__).parents[2] / "bags" / "yard"


@pytest.fixture(scope="module")
def traces() -> list[tuple[str, EchoTrace]]:
    with BagReader([BAG]) as bag:
        return [(topic, trace) for topic, trace in bag.traces()][:40]


def outcomes(traces: list[tuple[str, EchoTrace]], processes: int) -> list[Outcome]:
    with reconstructors(ReconstructionParameters(), processes) as workers:
        return list(workers.cones(traces))


def test_two_processes_give_the_cones_of_one(traces: list[tuple[str, EchoTrace]]) -> None:
    for (topic, stamp_ns, alone), (other_topic, other_stamp_ns, shared) in zip(
        outcomes(traces, 1), outcomes(traces, 2), strict=True
    ):
        assert (topic, stamp_ns) == (other_topic, other_stamp_ns)
        assert isinstance(alone, EchoCone)
        assert isinstance(shared, EchoCone)
        assert np.array_equal(alone.ranges_m, shared.ranges_m)
        assert np.array_equal(alone.detection_limits, shared.detection_limits)


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

    with reconstructors(ReconstructionParameters(), 2) as workers:
        next(workers.cones(counted()))
        assert taken < 100


def test_there_is_a_core_to_work_on() -> None:
    assert available_cores() >= 1
