"""Messages that come often, as bytes, for callbacks in a thread of their own."""

from collections import deque
from collections.abc import Callable
from functools import partial
from threading import Lock
from typing import Any, NamedTuple

from rclpy.node import Node

from usmap_ros.live.interfaces import Topic
from usmap_ros.nodes.plumbing.endpoints import QUEUE_DEPTH_FACTOR, subscribe
from usmap_ros.nodes.plumbing.worker import Worker

Callback = Callable[[bytes], None]


class _Queue(NamedTuple):
    """A subscription, who gets its messages, and those that wait for that."""

    subscription: Any
    callback: Callback
    waiting: deque[bytes]


class Inbox:
    """Subscriptions whose messages the node's executor takes, and a thread hands over.

    Messages are handed over as bytes, in CDR.  Where more of a topic wait than its queue is deep
    the oldest are lost, as the middleware does it.

    Parameters
    ----------
    node : Node
        Whose subscriptions they are.
    after : callable, optional
        Called whenever messages were taken; returns after how many seconds it wants to be called
        though none may have come, None: never.
    """

    def __init__(self, node: Node, after: Callable[[], float | None] = lambda: None) -> None:
        self._node, self._after = node, after
        self._lock = Lock()
        self._queues: dict[str, _Queue] = {}
        self._worker = Worker(node, self._step, self._interrupt)

    @property
    def topics(self) -> set[str]:
        """Names as they were given to `add`."""
        return set(self._queues)

    def add(self, topic: Topic, callback: Callback, name: str) -> None:
        """Subscribe to a topic under a name, for a callback that is called in the thread."""
        waiting: deque[bytes] = deque(maxlen=QUEUE_DEPTH_FACTOR * topic.qos.depth)
        subscription = subscribe(self._node, topic, partial(self._keep, waiting), name, raw=True)
        with self._lock:
            self._queues[name] = _Queue(subscription, callback, waiting)

    def remove(self, name: str) -> None:
        """Let go of a topic."""
        with self._lock:
            queue = self._queues.pop(name)
        self._node.destroy_subscription(queue.subscription)

    def close(self) -> None:
        """End the thread, and let go of all topics."""
        self._worker.stop()
        for name in self.topics:
            self.remove(name)

    def _keep(self, waiting: deque[bytes], payload: bytes) -> None:
        waiting.append(payload)
        self._worker.wake()

    def _interrupt(self) -> None:
        """End a wait within a step."""

    def _step(self) -> float | None:
        """Hand over what waits; runs in the thread."""
        with self._lock:
            queues = list(self._queues.values())
        for queue in queues:
            for _ in range(len(queue.waiting)):
                queue.callback(queue.waiting.popleft())
        return self._after()
