"""Node that publishes a recording, with its own QoS and its own time."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.time import Time

from usmap_ros.errors import BagError
from usmap_ros.io.message_types import ECHO_CONE, ECHO_TRACE
from usmap_ros.io.raw_reader import RawBagReader, recorded_qos
from usmap_ros.io.storage import RecordedTopic
from usmap_ros.io.storage.index import header_stamp_ns
from usmap_ros.live.attendance import Attendance
from usmap_ros.live.backlog import Backlog
from usmap_ros.live.interfaces import BAG_REPLAY, CLOCK, CONE, DIAGNOSTICS, ECHO, NODES, PAUSE, Qos
from usmap_ros.live.readers import LAG_S, Readers
from usmap_ros.nodes.plumbing.audience import Audience
from usmap_ros.nodes.plumbing.diagnostics import NodeHealth
from usmap_ros.nodes.plumbing.endpoints import advertise, every, qos_profile, serve, subscribe
from usmap_ros.nodes.plumbing.parameter_server import ParameterServer
from usmap_ros.nodes.plumbing.ros_types import interface_class
from usmap_ros.nodes.plumbing.run import run_node
from usmap_ros.nodes.plumbing.status import report_of
from usmap_ros.parameters.nodes import BagReplayParameters
from usmap_ros.parameters.nodes.common import is_one_of

#: Longest wait for subscribers to have what was published; one that hangs must not stop all.
_ACKNOWLEDGEMENT = Duration(seconds=1.0)
#: Longest wait, once all are there, for who fuses cones: it reports every second how many wait.
_FIRST_REPORT_S = 2.0
_USUAL_QOS = {
    topic.message_type: topic.qos for node in NODES for topic in (*node.publishes, *node.subscribes)
}


@dataclass
class _Output:
    """A publisher, and how many more messages its queue has room for."""

    publisher: Any
    depth: int
    room: int
    is_of_cones: bool


class BagReplay(Node):
    """Publishes every topic of a recording, and ``/clock``.

    Where traces are reconstructed while they are played, the cones tell how far their readers are,
    and diagnostics tell how many cones wait to be fused: time stands still for the slowest of
    them, whatever rate is asked for.

    Other keyword arguments are those of `rclpy.node.Node`.

    Parameters
    ----------
    on_end : callable
        Called when all has been published.

    Raises
    ------
    UsmapError
        If there is no such recording, or nothing in it that could be published.
    """

    def __init__(self, on_end: Callable[[], None] = lambda: None, **options: Any) -> None:
        super().__init__(
            BAG_REPLAY.name, automatically_declare_parameters_from_overrides=True, **options
        )
        self.parameters = ParameterServer(self, BagReplayParameters)
        parameters = self.parameters.value
        if not parameters.bag:
            raise self.parameters.refused("bag", "is missing")
        self._on_end = on_end
        self.health = NodeHealth(self, parameters.diagnostics_period_s, ("published", "loops"))
        self._bag = RawBagReader(Path(parameters.bag).expanduser())
        try:
            self._outputs = self._advertise_all()
        except BagError:
            self._bag.close()
            raise
        self._readers, self._backlog = Readers(), Backlog()
        self._attendance = Attendance(time.monotonic() + parameters.wait_s)
        publishers = {topic: output.publisher for topic, output in self._outputs.items()}
        self._audience = Audience(self, publishers, self._listen_to_readers())
        subscribe(self, DIAGNOSTICS, self._hear_reports)
        self._clock_publisher = advertise(self, CLOCK) if parameters.clock else None
        serve(self, PAUSE, self._pause)
        self._is_paused = parameters.start_paused
        self._has_begun = False
        self._report_due_s: float | None = None
        self._rewind()
        self._timer = every(self, 1.0 / parameters.clock_rate_hz, self._tick)

    def close(self) -> None:
        """Close the recording."""
        self._bag.close()

    def _advertise_all(self) -> dict[str, _Output]:
        parameters = self.parameters.value
        outputs = {}
        for recorded in self._bag.topics:
            # The recorded clock would contradict the replayed one.
            is_clock = recorded.name == CLOCK.name and parameters.clock
            if is_clock or not is_one_of(recorded.name, parameters.topic_pattern):
                continue
            try:
                message_class = interface_class(recorded.message_type)
            except (ImportError, ValueError) as error:
                self.get_logger().warning(f"{recorded.name} is not published: {error}")
                continue
            qos = _qos_of(recorded)
            publisher = self.create_publisher(message_class, recorded.name, qos_profile(qos))
            is_of_cones = recorded.message_type == ECHO_CONE
            outputs[recorded.name] = _Output(publisher, qos.depth, qos.depth, is_of_cones)
        if not outputs:
            raise BagError(self._bag.path, "holds no topic that could be published")
        return outputs

    def _listen_to_readers(self) -> dict[str, str]:
        """Topics of the cones that will be made of recorded traces, by those of the traces."""
        cone_topics = {}
        for recorded in self._bag.topics:
            namespace, _, name = recorded.name.rpartition("/")
            cones = f"{namespace}/{CONE.name}"
            is_read = recorded.message_type == ECHO_TRACE and name == ECHO.name
            if is_read and recorded.name in self._outputs and cones not in self._outputs:
                cone_topics[recorded.name] = cones
                subscribe(self, CONE, partial(self._answered, recorded.name), cones, raw=True)
        return cone_topics

    def _answered(self, topic: str, payload: bytes) -> None:
        stamp_ns = header_stamp_ns(memoryview(payload), 0)
        # One who came after the start is waited for as soon as he answers.
        self._readers.add(topic)
        self._readers.answered(topic, stamp_ns, time.monotonic())
        self._backlog.sent()

    def _hear_reports(self, message: Any) -> None:
        for status in message.status:
            facts = report_of(status).facts
            self._backlog.reported(status.name, facts, time.monotonic())
            self._attendance.reported(status.name, facts)

    def _rewind(self) -> None:
        self._readers.forget()
        self._messages: Iterator[tuple[str, int, bytes]] = self._bag.messages()
        self._next = next(self._messages)
        self._now_ns = float(self._bag.start_ns)
        self._last_tick_s = time.monotonic()

    def _tick(self) -> None:
        """Let the recording's time pass, and publish what is due."""
        now_s = time.monotonic()
        passed_s, self._last_tick_s = now_s - self._last_tick_s, now_s
        if not self._has_begun:
            self._has_begun = self._may_begin(now_s)
            return
        if not self._is_held(now_s):
            self._pass_time(passed_s)
        if self._clock_publisher is not None:
            stamp = Time(nanoseconds=min(round(self._now_ns), self._bag.end_ns)).to_msg()
            self._clock_publisher.publish(interface_class(CLOCK.message_type)(clock=stamp))
        while not self._is_held(now_s) and self._next[1] <= self._now_ns:
            topic, _, payload = self._next
            if topic in self._outputs:
                self._publish(self._outputs[topic], payload)
                self._readers.sent(topic, header_stamp_ns(memoryview(payload), 0), now_s)
            try:
                self._next = next(self._messages)
            except StopIteration:
                self._end()
                return

    def _is_held(self, now_s: float) -> bool:
        """Whether nothing is published for now."""
        return self._is_paused or self._backlog.is_full(now_s)

    def _pass_time(self, passed_s: float) -> None:
        """Let the recording's time pass, but no farther than its readers have come."""
        now_ns = self._now_ns + passed_s * self.parameters.value.rate * 1e9
        if len(self._readers) or len(self._backlog):
            # A long step would be over before anybody could ask for a pause.
            now_ns = min(now_ns, self._now_ns + LAG_S * 1e9)
        limit_ns = self._readers.limit_ns(self._last_tick_s)
        self._now_ns = max(self._now_ns, min(now_ns, limit_ns))

    def _may_begin(self, now_s: float) -> bool:
        """Whether a subscriber is on every topic, and all of them know of each other.

        If nobody comes, the wait that was asked for is enough.
        """
        missing = self._audience.missing()
        if not self._attendance.is_complete(now_s, missing, self._audience.makers()):
            return False
        read = self._audience.read()
        if self._report_due_s is None:
            self._report_due_s = now_s + (_FIRST_REPORT_S if self._has_cones(read) else 0.0)
        if not self._backlog and now_s < self._report_due_s:
            return False
        for topic in read:
            self._readers.add(topic)
        if missing:
            self.get_logger().info(f"nobody listens to {', '.join(missing)}")
        return True

    def _has_cones(self, read: dict[str, str]) -> bool:
        """Whether somebody hears cones of the recording, or cones made of its traces."""
        return bool(read) or any(
            output.is_of_cones and output.publisher.get_subscription_count()
            for output in self._outputs.values()
        )

    def _publish(self, output: _Output, payload: bytes) -> None:
        # Whatever does not fit a queue is lost in silence, reliable or not: wait for subscribers
        # to have what is in it before it is full.
        if output.room == 0:
            output.publisher.wait_for_all_acked(_ACKNOWLEDGEMENT)
            output.room = output.depth
        output.publisher.publish(payload)
        output.room -= 1
        self.health.work("published")
        if output.is_of_cones:
            self._backlog.sent()

    def _end(self) -> None:
        for output in self._outputs.values():
            output.publisher.wait_for_all_acked(_ACKNOWLEDGEMENT)
        if self.parameters.value.loop:
            self.health.count("loops")
            self._rewind()
            return
        self.destroy_timer(self._timer)
        if self._clock_publisher is not None:
            # Time that stands still for ever would have others wait for it.
            self.destroy_publisher(self._clock_publisher)
        self.get_logger().info(f"published {self.health.total('published')} messages")
        self._on_end()

    def _pause(self, request: Any, response: Any) -> Any:
        self._is_paused = bool(request.data)
        response.success = True
        response.message = "paused" if self._is_paused else "playing"
        return response


def _qos_of(recorded: RecordedTopic) -> Qos:
    """QoS of a topic as recorded, or else as the nodes here publish its type."""
    qos = recorded_qos(recorded)
    if qos is None:
        return _USUAL_QOS.get(recorded.message_type, Qos(depth=10))
    depth, is_reliable, is_latched = qos
    return Qos(depth, is_reliable, is_latched)


def main() -> None:
    """Run the node until all is published."""
    run_node(lambda: BagReplay(on_end=rclpy.try_shutdown))


if __name__ == "__main__":
    main()
