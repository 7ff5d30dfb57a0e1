"""What a pass over a recorded file finds out, and the interface of such files."""

from __future__ import annotations

import struct
from array import array
from collections.abc import Container, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from usmap_ros.errors import shortened

_LITTLE_ENDIAN_STAMP = struct.Struct("<iI")
_BIG_ENDIAN_STAMP = struct.Struct(">iI")
_ENCAPSULATION_SIZE = 4


@dataclass
class RecordedTopic:
    """One topic of a recording."""

    #: Such as ``/robot1/echo``.
    name: str
    #: Such as ``usmap_msgs/msg/EchoTrace``.
    message_type: str
    #: The recording's own definition of that type; empty if it carries none.
    definition: str = ""
    #: ``ros2msg`` or ``ros2idl``.
    definition_format: str = "ros2msg"
    #: Serialization of the messages; ``cdr`` is the only one that is understood.
    encoding: str = "cdr"
    count: int = 0
    #: QoS profiles of its publishers, in the YAML that rosbag2 records; empty if unknown.
    offered_qos: str = ""


@dataclass(frozen=True)
class Damage:
    """Where a file stops being readable."""

    #: What is wrong, as a clause.
    cause: str
    #: Size of what could be read.
    kept_bytes: int
    total_bytes: int


@dataclass
class MessageIndex:
    """Where the wanted messages of one file lie, as columns of equal length."""

    #: Every topic of the file, wanted or not.
    topics: list[RecordedTopic] = field(default_factory=list)
    #: Set if the file could not be read to its end.
    damage: Damage | None = None
    #: Per message: position in `topics`, stamp of its header, time of recording, and what
    #: `Storage.payload` takes.  The stamp means something only where the type has a header.
    topic: array[int] = field(default_factory=lambda: array("q"))
    stamp_ns: array[int] = field(default_factory=lambda: array("q"))
    recorded_ns: array[int] = field(default_factory=lambda: array("q"))
    block: array[int] = field(default_factory=lambda: array("q"))
    offset: array[int] = field(default_factory=lambda: array("q"))
    size: array[int] = field(default_factory=lambda: array("q"))

    def append(
        self, topic: int, stamp_ns: int, recorded_ns: int, block: int, offset: int, size: int
    ) -> None:
        """Note one message.

        Raises
        ------
        ValueError
            If one of the numbers is none that fits 64 bits: then nothing of it is noted.
        """
        numbers: tuple[object, ...] = (topic, stamp_ns, recorded_ns, block, offset, size)
        for number in numbers:
            if not isinstance(number, int) or not -(2**63) <= number < 2**63:
                raise ValueError(f"{shortened(repr(number), 40)} is no time or place of a message")
        self.topic.append(topic)
        self.stamp_ns.append(stamp_ns)
        self.recorded_ns.append(recorded_ns)
        self.block.append(block)
        self.offset.append(offset)
        self.size.append(size)

    def __len__(self) -> int:
        """Count the messages."""
        return len(self.topic)


class Storage(Protocol):
    """A recorded file."""

    @property
    def path(self) -> Path:
        """The file, as the user knows it."""

    def scan(self, wanted: Container[str]) -> MessageIndex:
        """Walk through the file, noting messages of the types in `wanted`.

        Damage ends the walk and is noted.

        Raises
        ------
        BagError
            If it is not a file of this format at all.
        """

    def payload(self, block: int, offset: int, size: int) -> memoryview:
        """Fetch the serialized message at a place that `scan` noted."""

    def part(self, blocks: Iterable[int]) -> Storage:
        """The same file as `payload` needs it for some blocks, to be sent to another process."""

    def close(self) -> None:
        """Let go of the file and of cached content; `payload` opens it again."""


class FileOfRecording:
    """What storages of a file have in common.

    Parameters
    ----------
    path : path
        The file to read.
    shown_path : path, optional
        What to call it in messages, if it is a temporary copy.
    compression : str
        Compression of each single message, as rosbag2's ``compression_mode: message`` makes it.
    """

    def __init__(self, path: Path, shown_path: Path | None = None, compression: str = "") -> None:
        self.path = shown_path or path
        self._file_path = path
        self._compression = compression


def header_stamp_ns(payload: memoryview, otherwise: int) -> int:
    """Stamp of a CDR message that begins with a header, without deserializing it.

    A message too short to have one gets the stamp `otherwise`; decoding will refuse it.
    """
    if len(payload) < _ENCAPSULATION_SIZE + _LITTLE_ENDIAN_STAMP.size:
        return otherwise
    layout = _LITTLE_ENDIAN_STAMP if payload[1] & 1 else _BIG_ENDIAN_STAMP
    seconds, nanoseconds = layout.unpack_from(payload, _ENCAPSULATION_SIZE)
    return int(seconds) * 1_000_000_000 + int(nanoseconds)
