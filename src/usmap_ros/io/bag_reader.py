"""Reading echo traces and cones from recordings, in the order of their stamps."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import Any, TypeVar

from usmap_ros.errors import BagError, MalformedMessageError, UsmapError, file_errors
from usmap_ros.io.conversions import array_from_cdr, cone_from_cdr, range_from_message
from usmap_ros.io.message_types import (
    ECHO_CONE,
    ECHO_TRACE,
    ODOMETRY,
    RANGE,
    TRANSDUCER_ARRAY,
    TRANSFORMS,
    check_definition,
    decoded,
)
from usmap_ros.io.recorded_poses import RecordedPoses
from usmap_ros.io.skipped import SkippedMessages
from usmap_ros.io.storage import MessageIndex, RecordedTopic, Storage, open_storage
from usmap_ros.io.stretch import Files, TraceStretch, merged
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.soundings import TransducerArrays
from usmap_ros.pings.trace import EchoTrace

logger = logging.getLogger(__name__)

#: Types of messages that mapping reads.
MAPPED_TYPES = (ECHO_TRACE, ECHO_CONE, TRANSDUCER_ARRAY)
#: Types of messages that are read where robots measure ranges only.
RANGE_TYPES = (RANGE, ODOMETRY, TRANSFORMS)

_Content = TypeVar("_Content")


class BagReader:
    """Echo traces and cones of one or several recordings, merged.

    All messages of a recording are indexed first, by stamp (see `usmap_ros.io.storage`), which
    takes one pass over the files.  Messages then come in the order of their header's stamp;
    those with the same stamp, in the order of their topics; those of the same topic too, in the
    order of `paths` and then of recording.

    Damaged files are read up to the damage, with a warning in the log.  Malformed messages are
    left out and accounted for in `skipped`.

    Parameters
    ----------
    paths : sequence of path-like
        rosbag2 folders, ``.mcap`` or ``.db3`` files.

    Raises
    ------
    BagError
        If a file is not a recording, holds other definitions of the messages, or if nothing that
        could be mapped is in any of them.

    Examples
    --------
    >>> with BagReader(["bags/poles"]) as bag:  # doctest: +SKIP
    ...     for topic, trace in bag.traces():
    ...         print(topic, trace.stamp_ns, len(trace.samples))
    """

    def __init__(self, paths: Sequence[str | Path]) -> None:
        self.paths = _each_once(paths)
        #: Malformed messages met so far.
        self.skipped = SkippedMessages()
        self._read_count = 0
        #: Every topic of every file, whatever its type.
        self.topics: list[RecordedTopic] = []
        self._storages: list[Storage] = []
        self._files = Files(self._storages)
        self._scratch = TemporaryDirectory(prefix="usmap_")
        try:
            indexes = self._scan()
        except BaseException:
            self.close()
            raise
        self._messages = {
            message_type: merged(indexes, self._files, message_type)
            for message_type in MAPPED_TYPES + RANGE_TYPES
        }
        if not self.trace_count and not self.cone_count and not self.range_count:
            self.close()
            raise BagError(", ".join(map(str, self.paths)), self._why_nothing(indexes))
        self._warn_of_damage(indexes)

    def __enter__(self) -> BagReader:
        """Return the reader itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close all files, and say how many messages could not be used."""
        self.close()
        if kind is None or issubclass(kind, UsmapError):
            self.skipped.log_total(self._read_count)

    def close(self) -> None:
        """Close all files."""
        self._files.close()
        self._scratch.cleanup()

    @property
    def trace_count(self) -> int:
        """Number of echo traces, malformed ones included."""
        return len(self._messages[ECHO_TRACE])

    @property
    def cone_count(self) -> int:
        """Number of echo cones, malformed ones included."""
        return len(self._messages[ECHO_CONE])

    @property
    def range_count(self) -> int:
        """Number of readings of robots that measure ranges only, malformed ones included."""
        counts = self._messages[RANGE].topic_counts()
        return sum(count for topic, count in counts.items() if self._is_alone(topic))

    @property
    def is_unpacked(self) -> bool:
        """Whether a file was unpacked, so that only who has this reader can read it."""
        return any(Path(self._scratch.name).iterdir())

    def ping_topics(self) -> list[str]:
        """Names of the topics with traces, cones, or ranges, each once."""
        types = (ECHO_TRACE, ECHO_CONE, RANGE)
        return sorted({one.name for one in self.topics if one.message_type in types and one.count})

    def traces(self) -> Iterator[tuple[str, EchoTrace]]:
        """Yield topic and content of every well-formed echo trace.

        What it lacks of its pulse, and the other pulses in the air, come from the recording's
        `TransducerArray` messages.
        """
        self._read_count += self.trace_count
        return self.trace_stretch.traces(self.skipped.add)

    @cached_property
    def trace_stretch(self) -> TraceStretch:
        """All echo traces, to be read elsewhere; who does tells `skipped` of malformed ones."""
        arrays = self._contents(TRANSDUCER_ARRAY, array_from_cdr)
        return TraceStretch(
            self._messages[ECHO_TRACE], TransducerArrays(array for _, array in arrays)
        )

    def first_traces(self, count: int) -> Iterator[tuple[str, EchoTrace]]:
        """Yield topic and content of the first `count` traces of each topic, as far as they are."""
        if not self.trace_count:
            return iter(())
        first = self._messages[ECHO_TRACE].first_of_each(count)
        arrays = self.trace_stretch.arrays
        return TraceStretch(first, arrays).traces(lambda source, error: None)

    def cones(self) -> Iterator[tuple[str, EchoCone]]:
        """Yield topic and content of every well-formed echo cone."""
        return self._contents(ECHO_CONE, cone_from_cdr)

    def range_cones(self) -> Iterator[tuple[str, EchoCone]]:
        """Yield topic and cone of every reading of robots that measure ranges only.

        Where they were, odometry and TF of the recording say.  Ranges of robots that have traces
        or cones, too, are left out: they come of the same echoes.
        """
        if not self.range_count:
            return
        poses = RecordedPoses()
        for topic, message in self._standard(ODOMETRY, lambda message: message):
            poses.add_odometry(topic, message)
        for topic, message in self._standard(TRANSFORMS, lambda message: message):
            poses.add_transforms(message, is_static=topic.endswith("tf_static"))
        for topic, reading in self._standard(RANGE, range_from_message):
            if not self._is_alone(topic):
                continue
            try:
                place = poses.locate(topic, reading.frame_id, reading.stamp_ns)
                yield topic, reading.on(place.robot).cone(place.pose, place.world)
            except MalformedMessageError as error:
                self.skipped.add(f"{topic} at {reading.stamp_ns / 1e9:.6f} s", error)
        for robot, frames in poses.unplaced.items():
            if len(frames) > 1:
                logger.warning(
                    "%s: the recording's TF does not say where its sensors %s sit: all are taken"
                    " to look straight ahead; record /tf_static, too", robot, sorted(frames),
                )  # fmt: skip

    def _is_alone(self, topic: str) -> bool:
        """Whether a topic's robot, or transducer, has no traces or cones beside it."""
        return topic.rpartition("/")[0] not in self._told_namespaces

    @cached_property
    def _told_namespaces(self) -> frozenset[str]:
        return frozenset(
            recorded.name.rpartition("/")[0]
            for recorded in self.topics
            if recorded.message_type in (ECHO_TRACE, ECHO_CONE) and recorded.count
        )

    def _standard(
        self, message_type: str, convert: Callable[[Any], _Content]
    ) -> Iterator[tuple[str, _Content]]:
        """Contents of a type that is not ours."""
        return self._contents(message_type, lambda payload: convert(decoded(payload, message_type)))

    def _contents(
        self, message_type: str, convert: Callable[[memoryview], _Content]
    ) -> Iterator[tuple[str, _Content]]:
        self._read_count += len(self._messages[message_type])
        return self._messages[message_type].contents(convert, self.skipped.add)

    def _scan(self) -> list[MessageIndex]:
        """Index every file; fills `_storages` and `topics`."""
        indexes = []
        for path in self.paths:
            with file_errors(BagError, path, "read"):
                storages = open_storage(path, self._scratch)
                for storage in storages:
                    self._storages.append(storage)
                    index = storage.scan(MAPPED_TYPES + RANGE_TYPES)
                    storage.close()
                    self._check(storage, index)
                    indexes.append(index)
        return indexes

    def _check(self, storage: Storage, index: MessageIndex) -> None:
        self.topics += index.topics
        for recorded in index.topics:
            if recorded.message_type in MAPPED_TYPES:
                check_definition(storage.path, recorded)

    def _warn_of_damage(self, indexes: Sequence[MessageIndex]) -> None:
        for storage, index in zip(self._storages, indexes, strict=True):
            if index.damage is not None:
                stamps = index.stamp_ns
                seconds = (max(stamps) - min(stamps)) / 1e9 if stamps else 0.0
                logger.warning(
                    "%s: %s; kept %d messages over %.1f s (%d of %d bytes)",
                    storage.path, index.damage.cause, len(index), seconds,
                    index.damage.kept_bytes, index.damage.total_bytes,
                )  # fmt: skip

    def _why_nothing(self, indexes: Sequence[MessageIndex]) -> str:
        for index in indexes:
            if index.damage is not None:
                return f"{index.damage.cause} before its first echo trace"
        types = sorted({recorded.message_type for recorded in self.topics})
        others = f", only {', '.join(types)}" if types else ""
        return f"holds no {ECHO_TRACE} messages{others}"


def _each_once(paths: Sequence[str | Path]) -> list[Path]:
    """Give recordings as they were named, those left out that were named before."""
    once: dict[Path, Path] = {}
    for path in map(Path, paths):
        if path.resolve() in once:
            logger.warning("%s: is given more than once, and read once", path)
        once.setdefault(path.resolve(), path)
    return list(once.values())
