"""Where a driver's traces go: as they are, and as ranges of their first echoes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any

from rclpy.node import Node

from usmap_ros.errors import MalformedMessageError
from usmap_ros.io.conversions import range_to_message, trace_to_cdr
from usmap_ros.live.health import Health
from usmap_ros.live.interfaces import ECHO, RANGE
from usmap_ros.nodes.plumbing.endpoints import advertise, within
from usmap_ros.nodes.plumbing.ros_types import RosMessageTypes
from usmap_ros.pings.trace import EchoTrace

if TYPE_CHECKING:
    from usmap_ros.runs.pipeline import Pipeline


class EchoOutputs:
    """Publishes the traces of a driver's transducers.

    Parameters
    ----------
    node : Node
        The node on whose topics traces and ranges are published.
    health : Health
        Counts what was published.
    namespaces : mapping
        Of each transducer, by its frame: what its topics begin with; empty: nothing.
    """

    def __init__(self, node: Node, health: Health, namespaces: Mapping[str, str]) -> None:
        self._health = health
        self._types = RosMessageTypes()
        self._publishers: dict[str, tuple[Any, Any]] = {
            frame_id: tuple(
                advertise(node, topic, within(namespace, topic)) for topic in (ECHO, RANGE)
            )
            for frame_id, namespace in namespaces.items()
        }

    def publish(self, traces: Iterable[EchoTrace], *, with_ranges: bool) -> None:
        """Publish traces, each where its transducer's go, and perhaps ranges."""
        for trace in traces:
            echo, first_range = self._publishers[trace.child_frame_id]
            echo.publish(trace_to_cdr(trace))
            self._health.work("published")
            # Finding the first echo takes time: only if somebody listens.
            if with_ranges and first_range.get_subscription_count():
                self._publish_range(trace, first_range)

    @cached_property
    def _pipeline(self) -> Pipeline:
        """What finds first echoes; it takes as long to load as all else, and few listen to them."""
        from usmap_ros.runs.pipeline import Pipeline

        return Pipeline()

    def _publish_range(self, trace: EchoTrace, publisher: Any) -> None:
        try:
            cone = self._pipeline.reconstruct(trace)
        except MalformedMessageError as error:
            self._health.problem("malformed", f"its own trace: {error}")
        else:
            publisher.publish(range_to_message(cone, self._types))
