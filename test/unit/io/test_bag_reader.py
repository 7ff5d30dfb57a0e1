import shutil
import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import get_types_from_msg

from usmap_ros.errors import BagError, FileError
from usmap_ros.io.bag_reader import BagReader
from usmap_ros.io.bag_writer import new_bag
from usmap_ros.io.conversions import trace_to_cdr
from usmap_ros.io.message_types import ECHO_TRACE, typestore
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.pings.transducer_array import TransducerArray

MakeTrace = Callable[..., EchoTrace]
WriteBag = Callable[..., Path]
Warnings = Callable[[], list[str]]

EPOCH_S = 1_700_000_000


def read(*paths: Path) -> list[tuple[str, float]]:
    """Topic and seconds of every trace."""
    with BagReader(paths) as bag:
        return [(topic, trace.stamp_ns / 1e9 - EPOCH_S) for topic, trace in bag.traces()]


def write_with_rosbags(
    path: Path,
    traces: list[EchoTrace],
    storage: StoragePlugin,
    mode: CompressionMode = CompressionMode.NONE,
) -> None:
    writer = Writer(path, version=9, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/echo", ECHO_TRACE, typestore=typestore())
        for trace in traces:
            writer.write(connection, trace.stamp_ns, trace_to_cdr(trace))


@pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
def test_messages_come_in_the_order_of_their_stamps(
    make_trace: MakeTrace, write_bag: WriteBag, compression: str
) -> None:
    # One robot's messages after the other's, and a tie at 1 s.
    messages = [("/b", make_trace(t)) for t in range(3)] + [("/a", make_trace(t)) for t in (1, 5)]
    bag = write_bag("bag", messages, compression)
    assert read(bag) == [("/b", 0), ("/a", 1), ("/b", 1), ("/b", 2), ("/a", 5)]


def test_several_bags_are_merged(make_trace: MakeTrace, write_bag: WriteBag) -> None:
    one = write_bag("one", [("/a", make_trace(t)) for t in (0, 2, 4)])
    two = write_bag("two", [("/b", make_trace(t)) for t in (1, 2, 3)])
    expected = [("/a", 0), ("/b", 1), ("/a", 2), ("/b", 2), ("/b", 3), ("/a", 4)]
    assert read(one, two) == read(two, one) == expected


def test_a_bare_file_is_read(make_trace: MakeTrace, write_bag: WriteBag) -> None:
    bag = write_bag("bag", [("/a", make_trace(0))])
    assert read(bag / "bag.mcap") == [("/a", 0)]


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
@pytest.mark.parametrize(
    "mode", [CompressionMode.NONE, CompressionMode.MESSAGE, CompressionMode.FILE]
)
def test_what_rosbag2_writes_is_read(
    make_trace: MakeTrace, tmp_path: Path, storage: StoragePlugin, mode: CompressionMode
) -> None:
    traces = [make_trace(t) for t in range(5)]
    write_with_rosbags(tmp_path / "bag", traces, storage, mode)
    with BagReader([tmp_path / "bag"]) as bag:
        assert bag.trace_count == 5
        for (topic, found), trace in zip(bag.traces(), traces, strict=True):
            assert topic == "/echo"
            assert found.stamp_ns == trace.stamp_ns
            np.testing.assert_array_equal(found.samples, trace.samples)


def test_samples_are_views_of_what_was_read(make_trace: MakeTrace, write_bag: WriteBag) -> None:
    bag = write_bag("bag", [("/a", make_trace(0))])
    with BagReader([bag]) as reader:
        ((_, trace),) = reader.traces()
    assert not trace.samples.flags.owndata


def test_cones_are_read(cone: EchoCone, tmp_path: Path) -> None:
    with new_bag(tmp_path / "bag") as writer:
        writer.write_cone("/cone", cone)
    with BagReader([tmp_path / "bag"]) as bag:
        assert (bag.trace_count, bag.cone_count) == (0, 1)
        ((topic, found),) = bag.cones()
    assert topic == "/cone"
    np.testing.assert_array_equal(found.detection_limits, cone.detection_limits)


def test_traces_are_completed_by_the_arrays_beside_them(
    make_trace: MakeTrace, array: TransducerArray, tmp_path: Path
) -> None:
    left, right = array.elements
    with new_bag(tmp_path / "bag") as writer:
        for element in array.elements * 2:
            trace = make_trace(child_frame_id=element.child_frame_id, transducer=element.transducer)
            writer.write_trace(f"/{element.child_frame_id}/echo", trace.in_array(array))
    with BagReader([tmp_path / "bag"]) as bag:
        traces = [trace for _, trace in bag.traces()]

    assert [trace.transducer.pulse.sweep_hz for trace in traces] == [20e3, 20e3, -20e3, -20e3]
    for trace in traces:
        senders = [emission.child_frame_id for emission in trace.sent]
        assert set(senders) == {left.child_frame_id, right.child_frame_id}
    metadata = yaml.safe_load((tmp_path / "bag" / "metadata.yaml").read_text())
    topics = metadata["rosbag2_bagfile_information"]["topics_with_message_count"]
    (topic,) = [one for one in topics if one["topic_metadata"]["name"] == "/robot1/transducers"]
    assert topic["topic_metadata"]["offered_qos_profiles"][0]["durability"] == "transient_local"
    # However many traces there are, it is written once.
    assert topic["message_count"] == 1


def test_a_lone_chirp_keeps_its_sweep(
    make_trace: MakeTrace, array: TransducerArray, tmp_path: Path
) -> None:
    sonar = array.elements[0].transducer
    other = replace(sonar, pulse=replace(sonar.pulse, sweep_hz=9e3))
    with new_bag(tmp_path / "bag") as writer:
        writer.write_trace("/echo", make_trace(transducer=sonar))
        writer.write_trace("/echo", make_trace(1.0, transducer=other))
    with BagReader([tmp_path / "bag"]) as bag:
        sweeps = [trace.transducer.pulse.sweep_hz for _, trace in bag.traces()]

    assert sweeps == [20e3, 9e3]


def test_a_split_recording_is_read_in_its_order(
    make_trace: MakeTrace, write_bag: WriteBag, tmp_path: Path, warnings_of: Warnings
) -> None:
    (tmp_path / "split").mkdir()
    for number in (2, 10):
        part = write_bag(f"part{number}", [("/a", make_trace(0, noise_std=float(number)))])
        shutil.copy(part / f"part{number}.mcap", tmp_path / "split" / f"split_{number}.mcap")
    with BagReader([tmp_path / "split"]) as bag:
        assert [trace.noise_std for _, trace in bag.traces()] == [2.0, 10.0]
    assert warnings_of() == [
        f"{tmp_path / 'split'}: has no metadata.yaml, so its recorder was not closed properly"
    ]


def test_a_missing_part_is_told(
    make_trace: MakeTrace, write_bag: WriteBag, warnings_of: Warnings
) -> None:
    bag = write_bag("bag", [("/a", make_trace(0))])
    metadata = (bag / "metadata.yaml").read_text()
    listed = metadata.replace("  - bag.mcap", "  - bag.mcap\n  - bag_1.mcap")
    (bag / "metadata.yaml").write_text(listed)
    assert read(bag) == [("/a", 0)]
    assert warnings_of() == [f"{bag / 'bag_1.mcap'}: is missing, though metadata.yaml names it"]


def test_bytes_that_are_no_message_are_skipped(make_trace: MakeTrace, tmp_path: Path) -> None:
    whole = trace_to_cdr(make_trace(0))
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/echo", ECHO_TRACE, typestore=typestore())
        for raw in (b"", b"\0\1\0\0", whole[:100], whole[:-1], b"\xff" * 200, whole):
            writer.write(connection, 1, raw)
    with BagReader([tmp_path / "bag"]) as bag:
        assert len(list(bag.traces())) == 1
        assert bag.skipped.by_field == {"message": 5}


def test_a_missing_file_of_the_package_is_not_said_to_be_the_recording(
    make_trace: MakeTrace, write_bag: WriteBag, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = write_bag("bag", [("/a", make_trace(0))])
    typestore.cache_clear()
    monkeypatch.setattr("usmap_ros.io.message_types.files", lambda package: tmp_path)
    with pytest.raises(FileError, match="installed anew") as raised:
        BagReader([bag])
    assert raised.value.path == tmp_path / "msg" / "Transducer.msg"


def test_big_endian_messages_are_read(make_trace: MakeTrace, tmp_path: Path) -> None:
    trace = make_trace(3)
    message = typestore().deserialize_cdr(trace_to_cdr(trace), ECHO_TRACE)
    raw = typestore().serialize_cdr(message, ECHO_TRACE, little_endian=False)
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        writer.write(writer.add_connection("/e", ECHO_TRACE, typestore=typestore()), 0, raw)
    assert read(tmp_path / "bag") == [("/e", 3)]
    with BagReader([tmp_path / "bag"]) as bag:
        ((_, found),) = bag.traces()
    np.testing.assert_array_equal(found.samples, trace.samples)


class TestUnusable:
    """What is no recording, or holds nothing to map, is refused in one line."""

    def refusal(self, *paths: Path) -> str:
        with pytest.raises(BagError) as raised:
            BagReader(paths)
        assert "\n" not in str(raised.value)
        return raised.value.cause

    @pytest.mark.parametrize("name", ["bag.mcap", "bag.db3"])
    def test_empty(self, tmp_path: Path, name: str) -> None:
        (tmp_path / name).touch()
        assert self.refusal(tmp_path / name) == "is empty"

    @pytest.mark.parametrize(("name", "kind"), [("t.mcap", "an MCAP"), ("t.db3", "an sqlite3")])
    def test_text(self, tmp_path: Path, name: str, kind: str) -> None:
        (tmp_path / name).write_text("This is the way the world ends.")
        assert self.refusal(tmp_path / name) == f"is not {kind} file"

    def test_other_suffix(self, tmp_path: Path) -> None:
        (tmp_path / "bag.txt").touch()
        cause = "is no recording: neither a rosbag2 folder nor .mcap nor .db3"
        assert self.refusal(tmp_path / "bag.txt") == cause

    def test_empty_folder(self, tmp_path: Path) -> None:
        assert self.refusal(tmp_path) == "is not a recording: it holds no .mcap or .db3 file"

    def test_broken_metadata(self, tmp_path: Path) -> None:
        (tmp_path / "metadata.yaml").write_text("rosbag2: [")
        assert self.refusal(tmp_path) == "is not a rosbag2 metadata file"

    def test_a_database_of_something_else(self, tmp_path: Path) -> None:
        import sqlite3

        database = sqlite3.connect(tmp_path / "other.db3")
        database.execute("CREATE TABLE cats (name TEXT)")
        database.close()
        cause = "is not a rosbag2 recording: it has no topics and messages"
        assert self.refusal(tmp_path / "other.db3") == cause

    @pytest.mark.parametrize(
        ("definition", "difference"),
        [
            ("float64 loudness", "field 'loudness' stands where 'header' is expected"),
            ("std_msgs/Header header", "field 'child_frame_id' is missing"),
            (
                "std_msgs/Header header\nint8 child_frame_id",
                "field 'child_frame_id' has another type",
            ),
        ],
    )
    def test_another_definition(self, tmp_path: Path, definition: str, difference: str) -> None:
        from rosbags.typesys import Stores, get_typestore

        store = get_typestore(Stores.ROS2_JAZZY)
        store.register(get_types_from_msg(definition, ECHO_TRACE))
        with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            writer.add_connection("/echo", ECHO_TRACE, typestore=store)
        expected = f"topic /echo has another definition of {ECHO_TRACE}: {difference}"
        assert self.refusal(tmp_path / "bag") == expected


class TestDamaged:
    """A damaged recording is read up to the damage."""

    @pytest.fixture
    def bag(self, make_trace: MakeTrace, write_bag: WriteBag) -> Path:
        return write_bag("bag", [("/a", make_trace(t / 10)) for t in range(200)])

    @pytest.mark.parametrize("compression", ["lz4", "zstd"])
    def test_a_cut_in_compressed_chunks(
        self, make_trace: MakeTrace, write_bag: WriteBag, tmp_path: Path, compression: str
    ) -> None:
        bag = write_bag("packed", [("/a", make_trace(t)) for t in range(500)], compression)
        content = (bag / "packed.mcap").read_bytes()
        (tmp_path / "cut.mcap").write_bytes(content[: len(content) // 2])
        kept = read(tmp_path / "cut.mcap")
        assert len(kept) > 150
        assert kept == read(bag)[: len(kept)]

    def test_a_flipped_bit_is_noticed(self, bag: Path, warnings_of: Warnings) -> None:
        file = bag / "bag.mcap"
        content = bytearray(file.read_bytes())
        content[len(content) // 2] ^= 1
        file.write_bytes(content)
        kept = read(bag)
        assert 0 < len(kept) < 150
        (warning,) = warnings_of()
        assert "has a chunk that fails its checksum; kept" in warning

    def test_without_its_summary_nothing_is_lost(self, bag: Path, warnings_of: Warnings) -> None:
        file = bag / "bag.mcap"
        file.write_bytes(file.read_bytes()[:-100])
        assert len(read(bag)) == 200
        (warning,) = warnings_of()
        assert "is cut off behind its last message; kept 200 messages over 19.9 s" in warning

    def test_a_length_that_cannot_be(self, bag: Path) -> None:
        file = bag / "bag.mcap"
        content = bytearray(file.read_bytes())
        # The first record behind the magic is the header: its length now exceeds any file.
        struct.pack_into("<Q", content, 9, 2**62)
        file.write_bytes(content)
        with pytest.raises(BagError, match=r"is cut off before its first echo trace$"):
            BagReader([bag])

    def test_a_cut_database(
        self, make_trace: MakeTrace, tmp_path: Path, warnings_of: Warnings
    ) -> None:
        traces = [make_trace(t) for t in range(300)]
        write_with_rosbags(tmp_path / "bag", traces, StoragePlugin.SQLITE3)
        file = tmp_path / "bag" / "bag.db3"
        file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
        kept = read(tmp_path / "bag")
        assert 100 < len(kept) < 300
        assert kept == [("/echo", t) for t in range(len(kept))]
        (warning,) = warnings_of()
        assert "is damaged (" in warning

    def test_a_cut_file_that_was_compressed_as_a_whole(
        self, make_trace: MakeTrace, tmp_path: Path
    ) -> None:
        noise = np.random.default_rng(0)
        traces = [
            make_trace(t, samples=noise.standard_normal(4000).astype(np.float32))
            for t in range(100)
        ]
        write_with_rosbags(tmp_path / "b", traces, StoragePlugin.MCAP, CompressionMode.FILE)
        file = tmp_path / "b" / "b.mcap.zstd"
        file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
        kept = read(tmp_path / "b")
        assert 20 < len(kept) < 80
