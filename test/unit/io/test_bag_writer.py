from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from mcap.reader import make_reader
from rosbags.interfaces import QosDurability, QosHistory, QosReliability
from rosbags.rosbag2 import Reader

from usmap_ros.errors import BagError, MalformedMessageError
from usmap_ros.io.bag_writer import new_bag
from usmap_ros.pings.trace import EchoTrace

MakeTrace = Callable[..., EchoTrace]
WriteBag = Callable[..., Path]


@pytest.fixture
def messages(make_trace: MakeTrace) -> list[tuple[str, EchoTrace]]:
    return [(f"/robot{n % 3}/echo", make_trace(n / 10)) for n in range(200)]


def content(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.iterdir()}


@pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
def test_the_same_messages_give_the_same_bytes(
    messages: list[tuple[str, EchoTrace]], tmp_path: Path, compression: str
) -> None:
    for folder in ("one", "two"):
        with new_bag(tmp_path / folder / "bag", compression=compression) as writer:
            for topic, trace in messages:
                writer.write_trace(topic, trace)
    assert content(tmp_path / "one" / "bag") == content(tmp_path / "two" / "bag")


def test_rosbag2s_metadata(messages: list[tuple[str, EchoTrace]], write_bag: WriteBag) -> None:
    bag = write_bag("bag", messages)
    assert sorted(content(bag)) == ["bag.mcap", "metadata.yaml"]
    with Reader(bag) as reader:
        assert reader.message_count == len(list(reader.messages())) == 200
        assert {connection.topic for connection in reader.connections} == {
            "/robot0/echo",
            "/robot1/echo",
            "/robot2/echo",
        }
        for connection in reader.connections:
            assert connection.digest.startswith("RIHS01_")
            (qos,) = connection.ext.offered_qos_profiles
            assert (qos.history, qos.depth) == (QosHistory.KEEP_LAST, 10)
            assert qos.reliability is QosReliability.RELIABLE
            assert qos.durability is QosDurability.VOLATILE


def test_metadata_is_plain_yaml(messages: list[tuple[str, EchoTrace]], write_bag: WriteBag) -> None:
    text = (write_bag("bag", messages) / "metadata.yaml").read_text()
    assert "&" not in text
    information = yaml.safe_load(text)["rosbag2_bagfile_information"]
    assert information["version"] == 9
    assert information["duration"]["nanoseconds"] == 19_900_000_000


def test_checksums_are_written_and_right(
    messages: list[tuple[str, EchoTrace]], write_bag: WriteBag
) -> None:
    bag = write_bag("bag", messages)
    with (bag / "bag.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert len(list(reader.iter_messages())) == 200
        summary = reader.get_summary()
    # Small chunks: a crash while recording costs little.
    assert summary is not None
    assert len(summary.chunk_indexes) > 2


def test_an_empty_folder_is_filled(messages: list[tuple[str, EchoTrace]], tmp_path: Path) -> None:
    (tmp_path / "bag").mkdir()
    with new_bag(tmp_path / "bag") as writer:
        writer.write_trace(*messages[0])
    assert (tmp_path / "bag" / "metadata.yaml").exists()


def test_nothing_is_left_of_a_recording_that_failed(
    messages: list[tuple[str, EchoTrace]], make_trace: MakeTrace, tmp_path: Path
) -> None:
    def fail() -> None:
        with new_bag(tmp_path / "bag") as writer:
            writer.write_trace(*messages[0])
            writer.write_trace("/echo", make_trace(stamp_ns=2**62))

    with pytest.raises(MalformedMessageError):
        fail()
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_made_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(BagError, match=r"cannot be written: "), new_bag(tmp_path / "file" / "bag"):
        pass
