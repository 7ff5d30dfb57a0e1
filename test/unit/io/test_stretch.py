"""A stretch of a recording holds the same traces wherever it is read."""

import pickle
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer

from usmap_ros.io.bag_reader import BagReader
from usmap_ros.io.bag_writer import new_bag
from usmap_ros.io.conversions import trace_to_cdr
from usmap_ros.io.message_types import ECHO_TRACE, typestore
from usmap_ros.io.stretch import TraceStretch
from usmap_ros.pings.trace import EchoTrace

BAG = Path(__file__).parents[3] / "bags" / "yard"


@pytest.fixture(params=["none", "zstd", "lz4", "db3"])
def bag(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    path, traces = tmp_path / "bag", read(BAG)
    if request.param == "db3":
        write_sqlite(path, traces)
        return path
    with new_bag(path, compression=request.param) as writer:
        for topic, trace in traces:
            writer.write_trace(topic, trace)
    return path


def write_sqlite(path: Path, traces: list[tuple[str, EchoTrace]]) -> None:
    with Writer(path, version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connections = {
            topic: writer.add_connection(topic, ECHO_TRACE, typestore=typestore())
            for topic in {topic for topic, _ in traces}
        }
        for topic, trace in traces:
            writer.write(connections[topic], trace.stamp_ns, trace_to_cdr(trace))


def read(bag: Path) -> list[tuple[str, EchoTrace]]:
    with BagReader([bag]) as reader:
        return list(reader.traces())


def read_cut(stretch: TraceStretch) -> list[tuple[str, EchoTrace]]:
    with closing(stretch.messages):
        return list(stretch.traces(refuse))


def refuse(source: str, error: Exception) -> None:
    raise error


@pytest.mark.parametrize("length", [1, 7, 50, 1000])
def test_stretches_that_were_sent_hold_all_traces_in_their_order(bag: Path, length: int) -> None:
    with BagReader([bag]) as reader:
        sent = [pickle.dumps(stretch) for stretch in reader.trace_stretch.cuts(length)]
    # Whoever gets them has no reader.
    stretches = [pickle.loads(one) for one in sent]
    found = [entry for stretch in stretches for entry in read_cut(stretch)]
    for (topic, trace), (other_topic, other) in zip(found, read(bag), strict=True):
        assert (topic, trace.stamp_ns) == (other_topic, other.stamp_ns)
        np.testing.assert_array_equal(trace.samples, other.samples)


def test_traces_of_one_stamp_stay_together(bag: Path) -> None:
    with BagReader([bag]) as reader:
        stamps_ns = [
            {trace.stamp_ns for _, trace in read_cut(stretch)}
            for stretch in reader.trace_stretch.cuts(4)
        ]
    assert sum(map(len, stamps_ns)) == len(set().union(*stamps_ns))


def test_what_is_sent_does_not_grow_with_the_recording(bag: Path) -> None:
    with BagReader([bag]) as reader:
        first = next(reader.trace_stretch.cuts(10))
    assert len(pickle.dumps(first)) < 3000


def test_the_first_traces_of_each_topic(bag: Path) -> None:
    with BagReader([bag]) as reader:
        found = list(reader.first_traces(5))
    expected = [entry for number, entry in enumerate(read(bag)) if number < 15]
    assert sorted(topic for topic, _ in found) == sorted(topic for topic, _ in expected)
    assert [trace.stamp_ns for _, trace in found] == [trace.stamp_ns for _, trace in expected]
