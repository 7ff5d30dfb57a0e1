"""Transducers that ping at once, and what their echo traces do not say of themselves."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.errors import MalformedMessageError
from usmap_ros.geometry import Pose
from usmap_ros.trace import EchoTrace, Emission


@dataclass(frozen=True)
class ArrayElement:
    """One transducer of an array (``usmap_msgs/ArrayElement``).

    Parameters
    ----------
    child_frame_id : str
        Its frame, as in the traces that it hears.
    mount : Pose
        Of its frame in the array's.
    emits : bool
        Whether it sends its pulse when the array pings; it listens in any case.
    transducer : Transducer
        Hardware and pulse, a chirp's sweep included.
    """

    child_frame_id: str
    mount: Pose
    emits: bool
    transducer: Transducer


@dataclass(frozen=True)
class TransducerArray:
    """Transducers that ping at once (``usmap_msgs/TransducerArray``).

    Parameters
    ----------
    stamp_ns : int
        From when on it holds, nanoseconds since the epoch.
    frame_id : str
        Frame of the mounts, such as the robot's base.
    elements : tuple of ArrayElement
        One transducer, or several.
    """

    stamp_ns: int
    frame_id: str
    elements: tuple[ArrayElement, ...]

    def element(self, child_frame_id: str) -> ArrayElement | None:
        """Return the element of that frame; None if there is none."""
        return next((one for one in self.elements if one.child_frame_id == child_frame_id), None)

    def complete(self, trace: EchoTrace) -> EchoTrace:
        """Return a trace of one of its elements with all pulses that were in the air.

        Raises
        ------
        MalformedMessageError
            If the trace says something else of its pulse.
        """
        listener = self.element(trace.child_frame_id)
        if listener is None:
            return trace
        trace = trace.with_sweep(listener.transducer.pulse.sweep_hz)
        if trace.transducer.pulse != listener.transducer.pulse:
            raise MalformedMessageError(
                "transducer.pulse_shape",
                f"or another number of the pulse is not what the TransducerArray says of"
                f" {trace.child_frame_id!r}",
            )
        trace = replace(
            trace, array_frame_ids=tuple(element.child_frame_id for element in self.elements)
        )
        senders = [element for element in self.elements if element.emits]
        if senders == [listener]:
            return trace
        towards = listener.mount.inverse()
        return replace(
            trace,
            emissions=tuple(
                Emission(one.child_frame_id, towards.compose(one.mount), one.transducer)
                for one in senders
            ),
        )

    def validate(self) -> None:
        """Raise `MalformedMessageError` naming the first field that cannot be true."""
        if not self.elements:
            raise MalformedMessageError("elements", "is empty")
        if not any(element.emits for element in self.elements):
            raise MalformedMessageError("elements", "has none that emits")
        names = [element.child_frame_id for element in self.elements]
        if len(set(names)) < len(names):
            raise MalformedMessageError("elements.child_frame_id", "stands twice")
        for element in self.elements:
            element.mount.validate()
            element.transducer.validate()


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
        place = int(np.searchsorted(stamps, trace.stamp_ns, side="right"))
        return arrays[place - 1].complete(trace) if place else trace
