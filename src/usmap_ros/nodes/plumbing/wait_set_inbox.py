"""Messages that come often, taken without rclpy's executor.

This is the one file that uses what rclpy does not document: its wait sets, and handles to put into
them.  rclpy has no other way to wait for some of a node's subscriptions and to take what has come;
where it lacks any of this, `usmap_ros.nodes.plumbing.open_inbox.open_inbox` does without.
"""

from collections.abc import Callable, Iterable
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.exceptions import InvalidHandle
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node

from usmap_ros.live.interfaces import Topic
from usmap_ros.nodes.plumbing.endpoints import subscribe
from usmap_ros.nodes.plumbing.inbox import Callback, Inbox

#: For how long messages gather before they are taken together, for each topic and at the most.
#: Where many come, that spares a quarter of the processor: who works on several in a row finds
#: its code and data in the caches, of which others have taken possession after each pause.
_GATHER_S, _LONGEST_GATHER_S = 0.0004, 0.012
#: What a subscription's handle must have.
_OF_SUBSCRIPTIONS = ("pointer", "take_message", "__enter__", "__exit__")


class _Apart(MutuallyExclusiveCallbackGroup):
    """Keeps the executor from waiting for anything of this group.

    Not even for events: they share a condition with the messages, each of which would wake it.
    """

    def can_execute(self, entity: Any) -> bool:
        return False


@dataclass(frozen=True)
class _Slot:
    """A subscription and who gets its messages."""

    subscription: Any
    callback: Callback
    pointer: int


class WaitSetInbox(Inbox):
    """Subscriptions whose messages are taken in a thread of their own, all that wait at a time.

    rclpy's executor lists all that a node waits for anew after each message, some forty things for
    one subscription, and makes a task of each callback: a millisecond of a core or more.  Here,
    the subscriptions alone are listed, once for all messages that wait.

    Parameters
    ----------
    node, after
        As of `Inbox`.

    Raises
    ------
    AttributeError, TypeError
        If this rclpy lacks what it takes.
    """

    def __init__(self, node: Node, after: Callable[[], float | None] = lambda: None) -> None:
        self._group = _Apart()
        self._slots: dict[str, _Slot] = {}
        # What was let go of, and may still be waited for.
        self._gone: list[_Slot] = []
        self._patience_s: float | None = 0.0
        # Of a group that the node's executor does not answer.
        self._bell = node.create_guard_condition(lambda: None, callback_group=self._group)
        self._context = node.context
        try:
            self._wait({})
            attrgetter(*_OF_SUBSCRIPTIONS)(rclpy_implementation.Subscription)
        except Exception:  # Whatever it is: what was made goes, and it is raised on.
            node.destroy_guard_condition(self._bell)
            raise
        self._patience_s = None
        super().__init__(node, after)

    @property
    def topics(self) -> set[str]:
        """Names as they were given to `add`."""
        return set(self._slots)

    def add(self, topic: Topic, callback: Callback, name: str) -> None:
        """Subscribe to a topic under a name, for a callback that is called in the thread."""
        subscription = subscribe(self._node, topic, callback, name, raw=True, group=self._group)
        # In use from now on, rather than anew for each wait: destroyed when it is not any more.
        subscription.handle.__enter__()
        with self._lock:
            self._slots[name] = _Slot(subscription, callback, subscription.handle.pointer)
        self._worker.wake()

    def remove(self, name: str) -> None:
        """Let go of a topic."""
        with self._lock:
            slot = self._slots.pop(name)
            self._gone.append(slot)
        self._node.destroy_subscription(slot.subscription)
        self._worker.wake()

    def close(self) -> None:
        """End the thread, and let go of all topics."""
        super().close()
        self._forget()
        self._node.destroy_guard_condition(self._bell)

    def _interrupt(self) -> None:
        self._bell.trigger()

    def _step(self) -> float:
        """Wait for messages, and hand over all that there are; runs in the thread."""
        held = self._forget()
        ready = self._wait(held)
        for pointer in ready:
            _empty(held[pointer])
        if not ready:
            self._answer_events(held.values())
        self._patience_s = self._after()
        return min(_GATHER_S * len(held), _LONGEST_GATHER_S)

    def _forget(self) -> dict[int, _Slot]:
        """Let go of what nobody waits for now; gives the others, by the address of each."""
        with self._lock:
            gone, self._gone = self._gone, []
            held = {slot.pointer: slot for slot in self._slots.values()}
        for slot in gone:
            slot.subscription.handle.__exit__(None, None, None)
        return held

    def _wait(self, held: dict[int, _Slot]) -> list[int]:
        """Which of the subscriptions have messages, once any has."""
        wait_set = self._wait_set(len(held), 1, 0, 0, 0, 0)
        for slot in held.values():
            wait_set.add_subscription(slot.subscription.handle)
        wait_set.add_guard_condition(self._bell.handle)
        wait_set.wait(-1 if self._patience_s is None else round(self._patience_s * 1e9))
        return list(wait_set.get_ready_entities("subscription"))

    def _wait_set(self, *sizes: int) -> Any:
        """Room for subscriptions, guard conditions, timers, clients, services and events."""
        wait_set = rclpy_implementation.WaitSet(*sizes, self._context.handle)
        wait_set.clear_entities()
        return wait_set

    def _answer_events(self, held: Iterable[_Slot]) -> None:
        """Let rclpy say what is wrong with a subscription: what woke us may have been that."""
        events = [event for slot in held for event in slot.subscription.event_handlers]
        if not events:
            return
        wait_set = self._wait_set(0, 0, 0, 0, 0, len(events))
        waited_for = []
        with ExitStack() as in_use:
            for event in events:
                with suppress(InvalidHandle):
                    in_use.enter_context(event)
                    event.add_to_wait_set(wait_set)
                    waited_for.append(event)
            wait_set.wait(0)
            for event in waited_for:
                with suppress(InvalidHandle):
                    if event.is_ready(wait_set):
                        event.callback(event.take_data())


def _empty(slot: _Slot) -> None:
    """Hand over what waits on a subscription, a queue full at most."""
    subscription = slot.subscription
    for _ in range(subscription.qos_profile.depth):
        taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
        if taken is None:
            return
        slot.callback(taken[0])
