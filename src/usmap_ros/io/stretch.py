"""Messages of recordings by the places where they lie, to be read here or in another process."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from usmap_ros.errors import MalformedMessageError
from usmap_ros.io.conversions import noise_from_cdr, trace_from_cdr
from usmap_ros.io.storage import MessageIndex, Storage
from usmap_ros.numerics.arrays import IntArray
from usmap_ros.pings.soundings import TransducerArrays
from usmap_ros.pings.trace import EchoTrace

#: Where a message lies: number of its file and of its topic, stamp of its header, and what
#: `Storage.payload` takes.
PLACE = np.dtype(
    [
        ("storage", np.int32),
        ("topic", np.int32),
        ("stamp_ns", np.int64),
        ("block", np.int64),
        ("offset", np.int64),
        ("size", np.int64),
    ]
)

#: Called with the source of a malformed message and what is wrong with it.
Skip = Callable[[str, MalformedMessageError], None]
_Content = TypeVar("_Content")

_MAX_OPEN_FILES = 64
#: Places that are made Python's numbers at once.
_AT_ONCE = 256


class Files:
    """Files of recordings, no more of them open than the operating system lets a process have.

    Parameters
    ----------
    storages : list of Storage
        Files of the recordings, in the order in which places count them.
    """

    def __init__(self, storages: list[Storage]) -> None:
        self._storages = storages
        self._open: list[Storage] = []

    def __getitem__(self, number: int) -> Storage:
        """Return a file, which may be opened from now on."""
        storage = self._storages[number]
        if not (self._open and self._open[-1] is storage):
            if storage in self._open:
                self._open.remove(storage)
            self._open.append(storage)
            if len(self._open) > _MAX_OPEN_FILES:
                self._open.pop(0).close()
        return storage

    def close(self) -> None:
        """Close all files."""
        for storage in self._storages:
            storage.close()
        self._open = []


@dataclass(frozen=True, eq=False)
class Stretch:
    """Messages of one type that follow one another in the order of stamps.

    A cut of it can be sent to another process, which then reads these messages and no others.
    """

    #: Such as ``usmap_msgs/msg/EchoTrace``.
    message_type: str
    #: Those that the messages lie in.
    files: Files
    #: Names of topics.
    topics: Sequence[str]
    #: (n,) array of PLACE: where each message lies.
    places: NDArray[Any]

    def __len__(self) -> int:
        """Count the messages."""
        return len(self.places)

    def topic_counts(self) -> dict[str, int]:
        """Number of messages of each topic that has any."""
        counts = np.bincount(self.places["topic"], minlength=len(self.topics))
        return {topic: int(n) for topic, n in zip(self.topics, counts, strict=True) if n}

    def first_of_each(self, count: int) -> Stretch:
        """The first messages of each topic, `count` at most."""
        numbers = self.places["topic"]
        first = [np.flatnonzero(numbers == topic)[:count] for topic in range(len(self.topics))]
        chosen = np.sort(np.concatenate([np.zeros(0, np.int64), *first]))
        return Stretch(self.message_type, self.files, self.topics, self.places[chosen])

    def ends(self, length: int) -> list[int]:
        """Where stretches of about a length end, so that no stamp is in two of them."""
        stamps_ns, ends = self.places["stamp_ns"], [0]
        while ends[-1] < len(self):
            last_ns = stamps_ns[min(ends[-1] + length, len(self)) - 1]
            ends.append(int(np.searchsorted(stamps_ns, last_ns, side="right")))
        return ends[1:]

    def cut(self, first: int, stop: int) -> Stretch:
        """Messages from `first` to before `stop`, with files of their own."""
        places = self.places[first:stop].copy()
        used, numbers = np.unique(places["storage"], return_inverse=True)
        blocks = [set(places["block"][numbers == number].tolist()) for number in range(len(used))]
        storages = [self.files[int(n)].part(own) for n, own in zip(used, blocks, strict=True)]
        places["storage"] = numbers
        return Stretch(self.message_type, Files(storages), self.topics, places)

    def contents(
        self, convert: Callable[[memoryview], _Content], skip: Skip
    ) -> Iterator[tuple[str, _Content]]:
        """Yield topic and content of every well-formed message.

        Parameters
        ----------
        convert : callable
            Makes content of a serialized message.
        skip : callable
            Told of malformed messages.
        """
        for first in range(0, len(self), _AT_ONCE):
            for number, topic, stamp_ns, *place in self.places[first : first + _AT_ONCE].tolist():
                name = self.topics[topic]
                try:
                    yield name, convert(self.files[number].payload(*place))
                except MalformedMessageError as error:
                    skip(f"{self.files[number].path}: {name} at {stamp_ns / 1e9:.6f} s", error)

    def close(self) -> None:
        """Close its files."""
        self.files.close()


@dataclass(frozen=True)
class TraceStretch:
    """Echo traces that follow one another in a recording, and what completes them."""

    messages: Stretch
    #: Of the whole recording.
    arrays: TransducerArrays

    def __len__(self) -> int:
        """Count the traces, malformed ones included."""
        return len(self.messages)

    def traces(self, skip: Skip) -> Iterator[tuple[str, EchoTrace]]:
        """Yield topic and content of every well-formed trace, and tell `skip` of the others."""
        return self.messages.contents(self._completed, skip)

    def traces_without_noise(self) -> Iterator[EchoTrace]:
        """Yield the well-formed ones of those traces that do not state their noise."""

        def completed(payload: memoryview) -> EchoTrace | None:
            return None if noise_from_cdr(payload) > 0.0 else self._completed(payload)

        for _, trace in self.messages.contents(completed, lambda source, error: None):
            if trace is not None:
                yield trace

    def cuts(self, length: int) -> Iterator[TraceStretch]:
        """Cut it into stretches of about a length, with those of one stamp in the same."""
        first = 0
        for stop in self.messages.ends(length):
            yield TraceStretch(self.messages.cut(first, stop), self.arrays)
            first = stop

    def _completed(self, payload: memoryview) -> EchoTrace:
        return self.arrays.complete(trace_from_cdr(payload))


def merged(indexes: Sequence[MessageIndex], files: Files, message_type: str) -> Stretch:
    """All messages of a type, in the order of stamp, then topic, then file and place in it."""
    names = sorted({recorded.name for index in indexes for recorded in index.topics})
    rank = {name: number for number, name in enumerate(names)}
    rows, storages, topics = [], [], []
    for number, index in enumerate(indexes):
        is_wanted = np.array([topic.message_type == message_type for topic in index.topics], bool)
        ranks = np.array([rank[topic.name] for topic in index.topics], dtype=np.int32)
        of_topic: IntArray = np.asarray(index.topic)
        own = np.flatnonzero(is_wanted[of_topic]) if len(of_topic) else np.zeros(0, np.intp)
        rows.append(own)
        storages.append(np.full(len(own), number, np.int32))
        topics.append(ranks[of_topic[own]] if len(own) else np.zeros(0, np.int32))

    def column(name: str) -> IntArray:
        pairs = zip(indexes, rows, strict=True)
        return np.concatenate([np.asarray(getattr(index, name))[own] for index, own in pairs])

    # lexsort is stable, and its last key counts most.
    order = np.lexsort((np.concatenate(topics), column("stamp_ns")))
    # One column after the other: recordings may have millions of messages.
    places = np.zeros(len(order), PLACE)
    places["storage"] = np.concatenate(storages)[order]
    places["topic"] = np.concatenate(topics)[order]
    for name in ("stamp_ns", "block", "offset", "size"):
        places[name] = column(name)[order]
    return Stretch(message_type, files, names, places)
