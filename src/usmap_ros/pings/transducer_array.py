"""Transducers that ping at once, and what their echo traces do not say of themselves."""

from __future__ import annotations

from dataclasses import dataclass, replace

from usmap_ros import bounds
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.errors import MalformedMessageError
from usmap_ros.numerics.geometry import Pose


@dataclass(frozen=True)
class ArrayElement:
    """One transducer of an array (``usmap_msgs/ArrayElement``)."""

    #: Its frame, as in the traces that it hears.
    child_frame_id: str
    #: Of its frame in the array's.
    mount: Pose
    #: Whether it sends its pulse when the array pings; it listens in any case.
    emits: bool
    #: Hardware and pulse, a chirp's sweep included.
    transducer: Transducer


@dataclass(frozen=True)
class TransducerArray:
    """Transducers that ping at once (``usmap_msgs/TransducerArray``)."""

    #: From when on it holds, nanoseconds since the epoch.
    stamp_ns: int
    #: Frame of the mounts, such as the robot's base.
    frame_id: str
    #: One transducer, or several.
    elements: tuple[ArrayElement, ...]

    @classmethod
    def alone(cls, stamp_ns: int, child_frame_id: str, transducer: Transducer) -> TransducerArray:
        """Array of one transducer that pings alone, in its own frame."""
        own = Pose.planar(0.0, 0.0, 0.0)
        return cls(stamp_ns, child_frame_id, (ArrayElement(child_frame_id, own, True, transducer),))

    @property
    def stated(self) -> TransducerArray:
        """The array as messages state it."""
        told = (replace(one, transducer=one.transducer.stated) for one in self.elements)
        return replace(self, elements=tuple(told))

    def element(self, child_frame_id: str) -> ArrayElement | None:
        """Return the element of that frame; None if there is none."""
        return next((one for one in self.elements if one.child_frame_id == child_frame_id), None)

    @property
    def frame_ids(self) -> tuple[str, ...]:
        """Frames of all elements."""
        return tuple(element.child_frame_id for element in self.elements)

    def validate(self) -> None:
        """Raise `MalformedMessageError` naming the first field that cannot be true."""
        if not self.elements:
            raise MalformedMessageError("elements", "is empty")
        bounds.check_count("elements", len(self.elements), bounds.MAX_ELEMENTS)
        if not any(element.emits for element in self.elements):
            raise MalformedMessageError("elements", "has none that emits")
        names = [element.child_frame_id for element in self.elements]
        if len(set(names)) < len(names):
            raise MalformedMessageError("elements.child_frame_id", "stands twice")
        for element in self.elements:
            bounds.check_name("elements.child_frame_id", element.child_frame_id)
            element.mount.validate()
            element.transducer.validate()
