"""Recordings as they were recorded: every topic, undecoded, in the order of recording."""

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from usmap_ros.errors import BagError
from usmap_ros.io.storage import MessageIndex, RecordedTopic, Storage, open_storage
from usmap_ros.io.yaml_text import parse_yaml


class _Everything:
    """Contains every message type."""

    def __contains__(self, message_type: object) -> bool:
        return True


class RawBagReader:
    """Serialized messages of one recording, whole or damaged, of all topics.

    Parameters
    ----------
    path : path
        A rosbag2 folder, an ``.mcap`` or a ``.db3`` file.

    Raises
    ------
    BagError
        If it is no recording, or holds no messages.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._scratch = TemporaryDirectory(prefix="usmap_")
        self._storages: list[Storage] = []
        self._indexes: list[MessageIndex] = []
        try:
            self._scan()
        except BaseException:
            self.close()
            raise

    def _scan(self) -> None:
        """Index every file, and put the messages into order."""
        self._storages = open_storage(self.path, self._scratch)
        for storage in self._storages:
            self._indexes.append(storage.scan(_Everything()))
            storage.close()
        times = [np.asarray(index.recorded_ns, dtype=np.int64) for index in self._indexes]
        self._files = np.concatenate([np.full(len(t), n) for n, t in enumerate(times)])
        self._rows = np.concatenate([np.arange(len(t)) for t in times])
        self._times_ns = np.concatenate(times)
        if len(self._times_ns) == 0:
            raise BagError(self.path, "holds no messages")
        self._order = np.argsort(self._times_ns, kind="stable")

    def __len__(self) -> int:
        """Count the messages."""
        return len(self._order)

    @property
    def topics(self) -> list[RecordedTopic]:
        """One of each topic."""
        return list(
            {topic.name: topic for index in self._indexes for topic in index.topics}.values()
        )

    @property
    def start_ns(self) -> int:
        """When the first message was recorded."""
        return int(self._times_ns[self._order[0]])

    @property
    def end_ns(self) -> int:
        """When the last message was recorded."""
        return int(self._times_ns[self._order[-1]])

    def messages(self) -> Iterator[tuple[str, int, bytes]]:
        """Topic, time of recording and content of every message."""
        for place in self._order:
            number, row = int(self._files[place]), int(self._rows[place])
            index = self._indexes[number]
            payload = self._storages[number].payload(
                index.block[row], index.offset[row], index.size[row]
            )
            topic = index.topics[index.topic[row]].name
            yield topic, int(self._times_ns[place]), bytes(payload)

    def close(self) -> None:
        """Close all files."""
        for storage in self._storages:
            storage.close()
        self._scratch.cleanup()


def recorded_qos(recorded: RecordedTopic) -> tuple[int, bool, bool] | None:
    """Depth, and whether reliable and latched, of a topic's publishers; None if unknown.

    Where they differed, what every subscriber of theirs could be content with is given: reliable
    if one was, latched if one was.
    """
    try:
        profiles = parse_yaml(recorded.offered_qos) or []
        depths = [int(profile["depth"]) for profile in profiles]
        # Older versions of rosbag2 write the numbers of rmw's enumerations.
        reliable = [profile["reliability"] in ("reliable", 1) for profile in profiles]
        latched = [profile["durability"] in ("transient_local", 1) for profile in profiles]
    except (LookupError, TypeError, ValueError):
        return None
    # Publishers do not tell others of their depth: it is then recorded as 0.
    return (max([10, *depths]), any(reliable), any(latched)) if profiles else None
