"""A description of what is in a recording."""

from collections.abc import Callable, Iterator
from itertools import chain
from typing import Any

import numpy as np

from usmap_ros.io.bag_reader import BagReader
from usmap_ros.io.message_types import ECHO_CONE, ECHO_TRACE
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.preparation.valid_part import valid_part
from usmap_ros.pings.trace import EchoTrace

#: Called with topic and ping.
PingCallback = Callable[[str, EchoTrace | EchoCone], None]


class _Topic:
    """What the pings of one topic have in common, and when they were."""

    def __init__(self, name: str, first: EchoTrace | EchoCone) -> None:
        self.name = name
        self.first = first
        self.pings = 0
        self.last_ns = 0
        self.saturated = 0
        self.encodings: set[str] = set()

    def add(self, ping: EchoTrace | EchoCone) -> None:
        """Take a ping into account."""
        self.pings += 1
        self.last_ns = ping.stamp_ns
        self.saturated += isinstance(ping, EchoTrace) and valid_part(ping).is_saturated
        self.encodings.add(ping.encoding.name if isinstance(ping, EchoTrace) else "CONE")

    def describe(self) -> dict[str, Any]:
        """Its row in the description; the hardware is that of the first ping."""
        transducer = self.first.transducer
        seconds = (self.last_ns - self.first.stamp_ns) / 1e9
        return {
            "topic": self.name,
            "sensor": self.first.child_frame_id,
            "pings": self.pings,
            "saturated_pings": self.saturated,
            "rate_hz": (self.pings - 1) / seconds if seconds > 0.0 else None,
            "encoding": ", ".join(sorted(self.encodings)),
            "sample_rate_hz": getattr(self.first, "sample_rate_hz", None),
            "pulse": transducer.pulse.shape.name.lower().replace("_", " "),
            "carrier_hz": transducer.pulse.carrier_hz,
            "pulse_duration_s": transducer.pulse.duration_s,
            "beam_half_angle_rad": transducer.beam.half_angle_rad,
            "min_range_m": transducer.min_range_m,
            "max_range_m": transducer.max_range_m,
        }


def describe_bag(bag: BagReader, on_ping: PingCallback) -> dict[str, Any]:
    """Read an open recording through and describe it, ready to become JSON.

    Parameters
    ----------
    bag : BagReader
        An open recording, of which every message is read once.
    on_ping : callable
        Called with topic and ping after each ping.
    """
    topics: dict[str, _Topic] = {}
    frames: set[str] = set()
    lowest, highest = np.full(2, np.inf), np.full(2, -np.inf)
    pings: Iterator[tuple[str, EchoTrace | EchoCone]] = chain(
        bag.traces(), bag.cones(), bag.range_cones()
    )
    for topic, ping in pings:
        if topic not in topics:
            topics[topic] = _Topic(topic, ping)
        topics[topic].add(ping)
        frames.add(ping.frame_id)
        lowest = np.minimum(lowest, ping.pose.position_m[:2])
        highest = np.maximum(highest, ping.pose.position_m[:2])
        on_ping(topic, ping)
    firsts = [entry.first.stamp_ns for entry in topics.values()]
    lasts = [entry.last_ns for entry in topics.values()]
    return {
        "pings": sum(entry.pings for entry in topics.values()),
        "seconds": (max(lasts) - min(firsts)) / 1e9 if topics else 0.0,
        "frames": sorted(frames),
        "extent_m": [lowest[0], highest[0], lowest[1], highest[1]] if topics else [0.0] * 4,
        "topics": [topics[name].describe() for name in sorted(topics)],
        "other_topics": sorted(
            {
                topic.name
                for topic in bag.topics
                if topic.message_type not in (ECHO_TRACE, ECHO_CONE)
            }
        ),
        "skipped": dict(bag.skipped.by_field),
    }
