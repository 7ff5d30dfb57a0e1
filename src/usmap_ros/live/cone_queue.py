"""Cones that wait to be fused, in the order of their stamps; no robot takes the others' time."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import NamedTuple

from usmap_ros.live.fair_shares import FairShares
from usmap_ros.live.ordering import StampOrder
from usmap_ros.pings.cone import EchoCone

#: Beyond the wait for order: when cones wait for so long, those of robots that take more than their
#: share of the time let the others' pass.
_LATE_S = 1.0


class Waiting(NamedTuple):
    """A cone, where it came from, and when."""

    topic: str
    cone: EchoCone
    came_s: float


class ConeQueue:
    """Cones by their stamps, each once those before it came; for several threads.

    Parameters
    ----------
    wait_s : float
        How long a cone waits for older ones of other sources.
    capacity : int
        Cones that may wait.
    clock : callable
        Seconds of a clock that never runs backwards.
    """

    def __init__(self, wait_s: float, capacity: int, clock: Callable[[], float]) -> None:
        self._order: StampOrder[Waiting] = StampOrder(wait_s, capacity)
        self._shares, self._clock, self._lock = FairShares(), clock, threading.Lock()

    def __len__(self) -> int:
        """Count the cones that wait."""
        return len(self._order)

    @property
    def dropped(self) -> int:
        """Cones dropped because too many waited."""
        return self._order.dropped

    @property
    def late(self) -> int:
        """Cones that came after a newer one had been taken out."""
        return self._order.late

    @property
    def last_late(self) -> str:
        """Topic of the last of them, and how far behind it was."""
        return self._order.last_late

    def set_limits(self, wait_s: float, capacity: int) -> None:
        """Change how long and how many cones may wait."""
        with self._lock:
            self._order.wait_s, self._order.capacity = wait_s, capacity

    def set_sources(self, present: dict[str, bool]) -> None:
        """Wait for the sources that are present, and not for those that are gone."""
        with self._lock:
            for source, is_present in present.items():
                if is_present:
                    self._order.add_source(source)
                else:
                    self._order.remove_source(source)

    def push(self, topic: str, cone: EchoCone) -> None:
        """Take a cone in."""
        now_s = self._clock()
        with self._lock:
            self._order.push(topic, cone.stamp_ns, Waiting(topic, cone, now_s), now_s)

    def pop(self) -> Waiting | None:
        """Take the next cone out, if its turn has come."""
        now_s = self._clock()
        with self._lock:
            is_late = self._order.longest_wait_s(now_s) > self._order.wait_s + _LATE_S
            yielding = self._shares.greedy(now_s) if is_late else frozenset[str]()
            released = self._order.pop(now_s, yielding)
        return released[1] if released else None

    def spend(self, topic: str, cone: EchoCone) -> None:
        """Put the time that a cone takes down to its source."""
        with self._lock:
            self._shares.spend(topic, cone, self._clock())

    def due_in_s(self) -> float | None:
        """How long until `pop` gives a cone even if no more come; None: none waits."""
        with self._lock:
            return self._order.due_in_s(self._clock())

    def clear(self) -> None:
        """Forget the cones; sources stay."""
        with self._lock:
            self._order.clear()
