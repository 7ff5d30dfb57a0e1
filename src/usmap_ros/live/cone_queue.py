"""Cones that wait to be fused, in the order of their stamps; no robot takes the others' time."""

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from usmap_ros.live.ordering import StampOrder
from usmap_ros.pings.cone import EchoCone

#: How fast what was spent is forgotten, and times a fair share from which on it is too much.
_MEMORY_S, _TOO_MUCH = 10.0, 1.5
#: What a ping costs besides what it reaches, m².
_BESIDES_M2 = 4.0
#: Beyond the wait for order: when cones wait for so long, those of robots that take more than their
#: share of the time let the others' pass.
_LATE_S = 1.0


@dataclass
class _Spent:
    cost: float
    at_s: float


class FairShares:
    """Accounts of what the pings of each source cost, of late.

    A ping costs what it reaches: time goes with the cells in its beam, now and whenever it is
    weighed again, for which nobody else is to blame.  The same pings always cost the same.
    """

    def __init__(self) -> None:
        self._spent: dict[str, _Spent] = {}

    def spend(self, source: str, cone: EchoCone, now_s: float) -> None:
        """Note that a ping was fused."""
        reach_m, half_angle_rad = cone.transducer.max_range_m, cone.transducer.beam.half_angle_rad
        before = self._of(source, now_s)
        cost = _BESIDES_M2 + half_angle_rad * reach_m**2
        self._spent[source] = _Spent(before + cost, now_s)

    def greedy(self, now_s: float) -> frozenset[str]:
        """Sources that took far more than the others, which are to wait while others do."""
        spent = {source: self._of(source, now_s) for source in self._spent}
        self._spent = {source: self._spent[source] for source, cost in spent.items() if cost > 1e-3}
        too_much = _TOO_MUCH * sum(spent.values()) / max(len(self._spent), 1)
        return frozenset(source for source, cost in spent.items() if cost > too_much)

    def _of(self, source: str, now_s: float) -> float:
        spent = self._spent.get(source)
        return spent.cost * math.exp((spent.at_s - now_s) / _MEMORY_S) if spent else 0.0


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

    def stand_still(self) -> None:
        """Note that the cones' time stands still, so that none can be expected."""
        with self._lock:
            self._order.stand_still(self._clock())

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
