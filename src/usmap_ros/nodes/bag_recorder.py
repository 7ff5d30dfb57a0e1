"""Node that records live topics so that what is written outlives a kill."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rosbags.typesys import get_types_from_msg

from usmap_ros.errors import BagError, UsmapError, file_errors
from usmap_ros.io.bag_writer import BagWriter, qos_to_record
from usmap_ros.io.message_types import learn_standard, typestore
from usmap_ros.live.interfaces import BAG_RECORDER, Qos
from usmap_ros.nodes.plumbing.diagnostics import NodeHealth
from usmap_ros.nodes.plumbing.endpoints import every, qos_profile
from usmap_ros.nodes.plumbing.parameter_server import ParameterServer
from usmap_ros.nodes.plumbing.ros_types import interface_class
from usmap_ros.nodes.plumbing.run import run_node
from usmap_ros.parameters.nodes import BagRecorderParameters
from usmap_ros.parameters.nodes.common import is_one_of

#: What a kill can cost: a few pings.
_CHUNK_BYTES = 32 * 2**10
#: Messages of one topic that may wait to be written.
_DEPTH = 100


class UnknownTypeError(UsmapError):
    """A message type of which there is no definition."""


def definition_of(message_type: str) -> tuple[str, str]:
    """Definition of a type, with those of all types in it, and its RIHS01 hash.

    Types that are neither standard nor ours are looked up in the installed packages.

    Raises
    ------
    UnknownTypeError
        If there is no definition.
    """
    store = typestore()
    _learn(message_type)
    definition, _ = store.generate_msgdef(message_type, ros_version=2)
    return definition, store.hash_rihs01(message_type)


def _learn(message_type: str) -> None:
    """Make a type, and all types in it, known to rosbags."""
    store = typestore()
    learn_standard(message_type)
    if message_type in store.types:
        return
    package, _, name = message_type.split("/")
    try:
        path = Path(get_package_share_directory(package), "msg", f"{name}.msg")
        text = path.read_text(encoding="utf-8")
    except (PackageNotFoundError, OSError) as error:
        raise UnknownTypeError(f"there is no definition of {message_type}") from error
    learnt = get_types_from_msg(text, message_type)
    store.register(learnt)
    for _, fields in learnt.values():
        for _, (_, description) in fields:
            for part in _names_in(description):
                _learn(part)


def _names_in(description: object) -> list[str]:
    """Names of the message types in rosbags' description of a field."""
    if isinstance(description, str):
        return [description] if description.count("/") == 2 else []
    if isinstance(description, tuple):
        return [name for part in description for name in _names_in(part)]
    return []


class BagRecorder(Node):
    """Writes every topic there is, undecoded, into a rosbag2 folder with an MCAP file.

    Keyword arguments are those of `rclpy.node.Node`.

    Raises
    ------
    UsmapError
        If the recording cannot be written.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(
            BAG_RECORDER.name, automatically_declare_parameters_from_overrides=True, **options
        )
        self.parameters = ParameterServer(self, BagRecorderParameters)
        parameters = self.parameters.value
        if not parameters.bag:
            raise self.parameters.refused("bag", "is missing")
        self.health = NodeHealth(self, parameters.diagnostics_period_s, ("received", "failed"))
        self._writer = _start_recording(Path(parameters.bag).expanduser())
        self._known: set[str] = set()
        every(self, parameters.discovery_period_s, self._look_for_topics)
        self._look_for_topics()

    def close(self) -> None:
        """Complete the recording.

        Raises
        ------
        BagError
            If that cannot be written.
        """
        try:
            self._writer.finish()
        except OSError as error:
            self._writer.abandon()
            raise BagError(
                self.parameters.value.bag,
                f"cannot be completed: {error.strerror}; what was written before can be read",
            ) from error

    def _look_for_topics(self) -> None:
        with self._disk_may_be_full():
            self._writer.flush()
        for topic, (message_type, *_) in self.get_topic_names_and_types():
            is_new = topic not in self._known and self.count_publishers(topic) > 0
            if is_new and is_one_of(topic, self.parameters.value.topic_pattern):
                self._known.add(topic)
                try:
                    self._record(topic, message_type)
                except (ImportError, UnknownTypeError) as error:
                    self.get_logger().warning(f"{topic} is not recorded: {error}")

    def _record(self, topic: str, message_type: str) -> None:
        message_class = interface_class(message_type)
        definition, type_hash = definition_of(message_type)
        offered = [info.qos_profile for info in self.get_publishers_info_by_topic(topic)]
        is_reliable = [p.reliability == ReliabilityPolicy.RELIABLE for p in offered]
        is_latched = [p.durability == DurabilityPolicy.TRANSIENT_LOCAL for p in offered]
        profiles = [
            qos_to_record(profile.depth, is_reliable=reliable, is_latched=latched)
            for profile, reliable, latched in zip(offered, is_reliable, is_latched, strict=True)
        ]
        self._writer.add_topic(topic, message_type, definition, type_hash, profiles)
        # What every one of the publishers can serve; otherwise some would go unheard.
        qos = Qos(_DEPTH, all(is_reliable), all(is_latched))
        write = partial(self._write, topic, message_type)
        self.create_subscription(message_class, topic, write, qos_profile(qos), raw=True)
        self.get_logger().info(f"recording {topic}")

    def _write(self, topic: str, message_type: str, payload: bytes) -> None:
        self.health.work("received")
        now_ns = self.get_clock().now().nanoseconds
        with self._disk_may_be_full():
            self._writer.write_serialized(topic, message_type, now_ns, payload)
            self._writer.flush()

    @contextmanager
    def _disk_may_be_full(self) -> Iterator[None]:
        """Say what cannot be written: a full disk may be cleared, what comes until then is lost."""
        try:
            yield
        except OSError as error:
            self.health.problem("failed", f"cannot be written: {error.strerror}", is_error=True)


def _start_recording(folder: Path) -> BagWriter:
    """Recording in a new folder, in place: one that only appears when complete dies with a kill.

    Raises
    ------
    BagError
        If there is something already, or it cannot be written.
    """
    with file_errors(BagError, folder):
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise BagError(folder, "exists already and is not empty")
        return BagWriter(folder, folder.resolve().name, chunk_bytes=_CHUNK_BYTES)


def main() -> None:
    """Run the node."""
    run_node(BagRecorder, looks_for_topics=True)


if __name__ == "__main__":
    main()
