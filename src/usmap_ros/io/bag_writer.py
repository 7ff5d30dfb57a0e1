"""Writing echo traces and cones to rosbag2 folders with MCAP files in them."""

import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from mcap.writer import CompressionType, Writer

from usmap_ros.errors import BagError, file_errors
from usmap_ros.io.atomic import new_folder, write_atomically
from usmap_ros.io.conversions import array_to_cdr, cone_to_cdr, trace_to_cdr
from usmap_ros.io.message_types import ECHO_CONE, ECHO_TRACE, TRANSDUCER_ARRAY, typestore
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.pings.transducer_array import TransducerArray

COMPRESSIONS = {name: CompressionType[name.upper()] for name in ("none", "lz4", "zstd")}

#: Length of the header of a serialized message and of the stamp that follows it.
_STAMP_BYTES = 12
#: A chunk is what a crash while recording can cost: this is about 20 pings of I/Q.
_CHUNK_BYTES = 128 * 2**10
_METADATA_VERSION = 9
_FOREVER = {"sec": 9223372036, "nsec": 854775807}
#: Depth of the queues that the nodes offer these messages with; a player does the same.
_QUEUE_DEPTHS = {ECHO_TRACE: 10, ECHO_CONE: 50, TRANSDUCER_ARRAY: 64}

QosProfiles = list[dict[str, Any]]


@dataclass
class _Topic:
    """A topic that was written to."""

    name: str
    message_type: str
    channel_id: int
    type_hash: str
    qos: QosProfiles
    count: int = 0


class BagWriter:
    """Writes one recording, the same bytes for the same messages.

    mcap writes the file, because rosbags leaves chunks without a checksum.  Every trace and cone
    is written with its stamp as the time of recording: nothing depends on when it runs.

    Parameters
    ----------
    folder : path
        An existing empty folder, which becomes a rosbag2 one when the writer is closed.
    name : str
        Name of the MCAP file in it, without suffix.
    compression : str
        Of chunks; one of `COMPRESSIONS`.
    chunk_bytes : int
        Size of a chunk: what a crash while recording can cost.
    """

    def __init__(
        self, folder: Path, name: str, compression: str = "none", chunk_bytes: int = _CHUNK_BYTES
    ) -> None:
        self._folder = folder
        self._file_name = f"{name}.mcap"
        self._file = (folder / self._file_name).open("wb")
        self._writer = Writer(
            self._file, chunk_size=chunk_bytes, compression=COMPRESSIONS[compression]
        )
        # mcap's default library string holds its version, which would make files differ.
        self._writer.start(profile="ros2", library="usmap_ros")
        self._schemas: dict[str, int] = {}
        self._topics: dict[tuple[str, str], _Topic] = {}
        self._arrays: dict[tuple[str, ...], bytes] = {}
        self._first_ns: int | None = None
        self._last_ns = 0

    def write_trace(self, topic: str, trace: EchoTrace) -> None:
        """Append an echo trace, and before it what its message does not say of the transducers."""
        array = trace.array
        if array is None and trace.transducer.pulse.sweep_hz != 0.0:
            array = TransducerArray.alone(trace.stamp_ns, trace.child_frame_id, trace.transducer)
        if array is not None:
            self._write_array(array)
        self._write(topic, ECHO_TRACE, trace.stamp_ns, trace_to_cdr(trace))

    def write_cone(self, topic: str, cone: EchoCone) -> None:
        """Append an echo cone."""
        self._write(topic, ECHO_CONE, cone.stamp_ns, cone_to_cdr(cone))

    def _write_array(self, array: TransducerArray) -> None:
        """Append an array of transducers, unless it says nothing new."""
        payload = array_to_cdr(array)
        content = payload[_STAMP_BYTES:]
        if self._arrays.get(array.frame_ids) != content:
            self._arrays[array.frame_ids] = content
            self._write(_array_topic(array), TRANSDUCER_ARRAY, array.stamp_ns, payload)

    def add_topic(
        self, topic: str, message_type: str, definition: str, type_hash: str, qos: QosProfiles
    ) -> None:
        """Announce a topic of any type, for `write_serialized`.

        Parameters
        ----------
        topic, message_type : str
            Name, and type such as ``sensor_msgs/msg/Range``.
        definition : str
            Of the type and all those in it, in the form that rosbag2 records.
        type_hash : str
            Its RIHS01 hash.
        qos : list of dict
            Profiles of its publishers.
        """
        if message_type not in self._schemas:
            self._schemas[message_type] = self._writer.register_schema(
                name=message_type, encoding="ros2msg", data=definition.encode()
            )
        channel_id = self._writer.register_channel(
            topic=topic,
            message_encoding="cdr",
            schema_id=self._schemas[message_type],
            metadata={
                "offered_qos_profiles": yaml.dump(qos, Dumper=_PlainDumper).strip(),
                "topic_type_hash": type_hash,
            },
        )
        self._topics[topic, message_type] = _Topic(topic, message_type, channel_id, type_hash, qos)

    def write_serialized(
        self, topic: str, message_type: str, recorded_ns: int, payload: bytes
    ) -> None:
        """Append a message as it came, to a topic that `add_topic` announced."""
        self._append(self._topics[topic, message_type], recorded_ns, payload)

    def flush(self) -> None:
        """Hand all complete chunks to the operating system, where a kill cannot reach them."""
        self._file.flush()

    def finish(self) -> None:
        """Complete the file and write ``metadata.yaml``."""
        self._writer.finish()  # type: ignore[no-untyped-call]  # mcap gives it no types
        self._file.close()
        text = yaml.dump(self._metadata(), Dumper=_PlainDumper, sort_keys=False)
        write_atomically(self._folder / "metadata.yaml", text.encode())

    def abandon(self) -> None:
        """Close the file as it is."""
        # What a full disk has no room for is lost.
        with suppress(OSError):
            self._file.close()

    def _write(self, topic: str, message_type: str, stamp_ns: int, payload: bytes) -> None:
        if (topic, message_type) not in self._topics:
            definition, _ = typestore().generate_msgdef(message_type, ros_version=2)
            type_hash = typestore().hash_rihs01(message_type)
            is_latched = message_type == TRANSDUCER_ARRAY
            qos = [qos_to_record(_QUEUE_DEPTHS[message_type], is_latched=is_latched)]
            self.add_topic(topic, message_type, definition, type_hash, qos)
        self._append(self._topics[topic, message_type], stamp_ns, payload)

    def _append(self, entry: _Topic, recorded_ns: int, payload: bytes) -> None:
        self._writer.add_message(
            entry.channel_id,
            log_time=recorded_ns,
            publish_time=recorded_ns,
            sequence=entry.count,
            data=payload,
        )
        entry.count += 1
        self._first_ns = recorded_ns if self._first_ns is None else min(self._first_ns, recorded_ns)
        self._last_ns = max(self._last_ns, recorded_ns)

    def _metadata(self) -> dict[str, Any]:
        first_ns = self._first_ns or 0
        span = {
            "duration": {"nanoseconds": self._last_ns - first_ns},
            "starting_time": {"nanoseconds_since_epoch": first_ns},
            "message_count": sum(topic.count for topic in self._topics.values()),
        }
        topics = [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.message_type,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": topic.qos,
                    "type_description_hash": topic.type_hash,
                },
                "message_count": topic.count,
            }
            for topic in self._topics.values()
        ]
        return {
            "rosbag2_bagfile_information": {
                "version": _METADATA_VERSION,
                "storage_identifier": "mcap",
                **span,
                "topics_with_message_count": topics,
                "compression_format": "",
                "compression_mode": "",
                "relative_file_paths": [self._file_name],
                "files": [{"path": self._file_name, **span}],
                "custom_data": None,
                "ros_distro": "jazzy",
            }
        }


def qos_to_record(
    depth: int, *, is_reliable: bool = True, is_latched: bool = False
) -> dict[str, Any]:
    """QoS of a publisher, in the form that Jazzy's rosbag2 records."""
    return {
        "history": "keep_last",
        "depth": depth,
        "reliability": "reliable" if is_reliable else "best_effort",
        "durability": "transient_local" if is_latched else "volatile",
        "deadline": _FOREVER,
        "lifespan": _FOREVER,
        "liveliness": "automatic",
        "liveliness_lease_duration": _FOREVER,
        "avoid_ros_namespace_conventions": False,
    }


def _array_topic(array: TransducerArray) -> str:
    """Topic of an array: beside those of its robot, whose name its frames begin with."""
    robot = array.elements[0].child_frame_id.rpartition("/")[0]
    return "/" + re.sub(r"[^A-Za-z0-9_/]", "_", f"{robot}/transducers").lstrip("/")


class _PlainDumper(yaml.SafeDumper):
    """YAML without anchors, which rosbag2's parser for QoS profiles does not expect."""

    def ignore_aliases(self, data: Any) -> bool:
        """Write equal values out each time."""
        return True


@contextmanager
def new_bag(path: Path, *, replace: bool = False, compression: str = "none") -> Iterator[BagWriter]:
    """Record into a folder that appears, complete, when the block ends without an error.

    Parameters
    ----------
    path : path
        The rosbag2 folder to make.
    replace : bool
        Whether a recording that is there may be replaced; nothing else ever is.
    compression : str
        Of chunks; one of `COMPRESSIONS`.

    Raises
    ------
    BagError
        If there is something at `path` that may not be replaced, or it cannot be written.
    """
    with file_errors(BagError, path):
        _check_target(path, replace)
        with new_folder(path) as folder:
            writer = BagWriter(folder, path.name, compression)
            try:
                yield writer
                writer.finish()
            finally:
                writer.abandon()


def _check_target(path: Path, replace: bool) -> None:
    """Refuse to overwrite what is not a recording, and a recording unless that is wanted."""
    if not path.exists() or (path.is_dir() and not any(path.iterdir())):
        return
    if not _is_recording(path):
        raise BagError(path, "is in the way and no recording, so it is not replaced")
    if not replace:
        raise BagError(path, "exists already; --force replaces it")


def _is_recording(path: Path) -> bool:
    """Whether a folder holds the files of a recording and nothing else."""
    return path.is_dir() and all(
        entry.name == "metadata.yaml" or entry.suffix in (".mcap", ".db3")
        for entry in path.iterdir()
    )
