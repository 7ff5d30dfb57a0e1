"""Memory does not grow with a recording's size, and little with its pings."""

import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from usmap_ros.io.bag_reader import BagReader
from usmap_ros.io.bag_writer import new_bag
from usmap_ros.pings.fields_of_view import Beam
from usmap_ros.pings.robot_paths import RobotPaths
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.runs.parallel import Reconstructors
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.runs.recorded import recorded_cones
from usmap_ros.simulation import Scenario, simulate

MEGABYTE = 1e6


@pytest.fixture(scope="module")
def trace(pytestconfig: pytest.Config) -> EchoTrace:
    return next(simulate(Scenario.load(pytestconfig.rootpath / "config/scenarios/poles.yaml")))[1]


def peak_bytes(bag: Path, *, with_cones: bool) -> int:
    """Most memory that reading a bag, and perhaps reconstructing it, takes."""
    reconstructors = Reconstructors(Pipeline())
    tracemalloc.start()
    try:
        with BagReader([bag]) as reader:
            count = sum(
                1
                for _ in (recorded_cones(reader, reconstructors) if with_cones else reader.traces())
            )
        assert count == reader.trace_count
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("compression", ["none", "zstd"])
def test_reading_takes_no_more_memory_for_a_longer_bag(
    trace: EchoTrace, tmp_path: Path, compression: str
) -> None:
    # A megabyte each.
    samples = np.tile(trace.samples, 250_000 // len(trace.samples)).astype(np.float32)
    peaks = []
    for name, count in (("short", 8), ("long", 32)):
        with new_bag(tmp_path / name, compression=compression) as writer:
            for number in range(count):
                stamp_ns = trace.stamp_ns + number * 10**8
                writer.write_trace("/echo", replace(trace, samples=samples, stamp_ns=stamp_ns))
        peaks.append(peak_bytes(tmp_path / name, with_cones=False))
    # Of compressed ones, a few are kept unpacked, 16 MB at the most.
    assert peaks[1] < (8 * MEGABYTE if compression == "none" else 80 * MEGABYTE)
    assert compression != "none" or peaks[1] < 1.2 * peaks[0]


def test_reconstructing_takes_no_more_memory_for_a_longer_bag(
    trace: EchoTrace, tmp_path: Path
) -> None:
    peaks = []
    for name, count in (("warm", 20), ("short", 50), ("long", 200)):
        with new_bag(tmp_path / name) as writer:
            for number in range(count):
                writer.write_trace("/echo", replace(trace, stamp_ns=trace.stamp_ns + number))
        peaks.append(peak_bytes(tmp_path / name, with_cones=True))
    # 150 traces are 0.9 MB; what is known of where they lie is 20 kB, and what waits for Python
    # 3.10's collector 0.1 to 0.2 MB.
    assert peaks[2] < peaks[1] + 0.3 * MEGABYTE


def test_a_robots_path_takes_few_bytes_a_ping() -> None:
    paths, beam = RobotPaths(), Beam(0.1, 0.5, 5.0)
    paths.add("/echo", 0.0, 0.0, beam)
    tracemalloc.start()
    try:
        for number in range(20_000):
            paths.add("/echo", 0.5 * number, 0.0, beam)
        taken = tracemalloc.get_traced_memory()[0]
    finally:
        tracemalloc.stop()
    # And the room that a growing array has to spare.
    assert taken < 20_000 * 56
    np.testing.assert_array_equal(paths.positions_m["/echo"][7], (3.0, 0.0))
    np.testing.assert_array_equal(paths.beams["/echo"][7], beam)
