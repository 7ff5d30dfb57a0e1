"""Traces that belong together: those of transducers that ping at once, and who these are."""

from bisect import bisect_right
from collections.abc import Iterable, Iterator
from typing import Generic, TypeVar

from usmap_ros.pings.trace import EchoTrace
from usmap_ros.pings.transducer_array import TransducerArray

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
        frames = () if trace.array is None else trace.array.frame_ids
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


class TransducerArrays:
    """All arrays that are known, to complete traces with.

    Parameters
    ----------
    arrays : iterable of TransducerArray, optional
        Those that are known from the start, in any order.
    """

    def __init__(self, arrays: Iterable[TransducerArray] = ()) -> None:
        self._by_frame: dict[str, list[TransducerArray]] = {}
        for array in arrays:
            self.add(array)

    def add(self, array: TransducerArray) -> None:
        """Take an array up: it holds from its stamp on for each of its elements.

        Of two of one stamp the newer one holds.
        """
        for element in array.elements:
            frame_id = element.child_frame_id
            others = [
                one for one in self._by_frame.get(frame_id, []) if one.stamp_ns != array.stamp_ns
            ]
            # A list of its own, because another thread may be looking something up.
            self._by_frame[frame_id] = sorted([*others, array], key=lambda one: one.stamp_ns)

    def complete(self, trace: EchoTrace) -> EchoTrace:
        """Return the trace with the pulses that were in the air, as far as an array says so.

        Raises
        ------
        MalformedMessageError
            If the array says something else of the trace's pulse.
        """
        arrays = self._by_frame.get(trace.child_frame_id, [])
        stamps = [array.stamp_ns for array in arrays]
        place = bisect_right(stamps, trace.stamp_ns)
        return trace.in_array(arrays[place - 1]) if place else trace
