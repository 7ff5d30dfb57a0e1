"""Traces that belong together: those of transducers that ping at once."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Generic, TypeVar

from usmap_ros.trace import EchoTrace

#: What a trace is carried around with, such as its topic.
_Label = TypeVar("_Label")


class SoundingCollector(Generic[_Label]):
    """Puts traces together that an array of transducers received at one stamp.

    A trace of a transducer that pings alone is a sounding by itself.  The traces of an array are
    released together as soon as all of them are there, or when a later ping shows that one is
    missing.
    """

    def __init__(self) -> None:
        self._waiting: dict[tuple[str, ...], list[tuple[_Label, EchoTrace]]] = {}

    def add(self, label: _Label, trace: EchoTrace) -> list[list[tuple[_Label, EchoTrace]]]:
        """Take a trace up, and return the soundings that are complete, earlier ones first."""
        released = [
            self._waiting.pop(frames)
            for frames, group in list(self._waiting.items())
            if group[0][1].stamp_ns < trace.stamp_ns
        ]
        frames = trace.array_frame_ids
        if len(frames) < 2:
            return [*released, [(label, trace)]]
        group = self._waiting.setdefault(frames, [])
        group.append((label, trace))
        if len(group) == len(frames):
            released.append(self._waiting.pop(frames))
        return released

    def flush(self) -> list[list[tuple[_Label, EchoTrace]]]:
        """Return what still waits for others."""
        released = list(self._waiting.values())
        self._waiting = {}
        return released


def soundings(
    traces: Iterable[tuple[_Label, EchoTrace]],
) -> Iterator[list[tuple[_Label, EchoTrace]]]:
    """Group traces, which come in the order of their stamps, into soundings."""
    collector: SoundingCollector[_Label] = SoundingCollector()
    for label, trace in traces:
        yield from collector.add(label, trace)
    yield from collector.flush()
