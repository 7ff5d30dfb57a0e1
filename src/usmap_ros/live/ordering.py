"""Messages of several sources in the order of their stamps, within a bounded wait."""

import heapq
import itertools
from collections import Counter, deque
from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Generic, TypeVar

#: A source whose stamps lie so far behind the newest ones, s, has another clock, or is gone.
OTHER_TIME_S = 60.0
#: Without any item from anybody for so many times the wait, and for so long, nobody is waited for
#: any more.  It is long, because all may be busy at once; only the last items ever wait for it.
QUIET_WAITS, QUIET_S = 4.0, 5.0
#: Nor is that time counted while the stamps' time stands still, as a replay's does that waits for a
#: slow reader: for so long after the last item.
STANDSTILL_S = 60.0

_Item = TypeVar("_Item")


@dataclass(order=True)
class _Entry(Generic[_Item]):
    """An item in the heap; those with the same stamp come in the order of their sources."""

    stamp_ns: int
    source: str
    number: int
    item: _Item = field(compare=False)
    received_s: float = field(compare=False)
    is_out: bool = field(compare=False, default=False)


@dataclass
class _Source:
    """What is known of a source: its latest stamp, and whether others wait for it."""

    latest_ns: int | None = None
    is_waited_for: bool = True


class StampOrder(Generic[_Item]):
    """Releases items in the order of their stamps, ties in the order of their sources' names.

    An item is released as soon as every source that is waited for has sent one at least as new,
    since each source sends in order.  A source that stays silent holds the others up once; it is
    waited for again when it speaks.  It counts as silent when an item has waited for it for
    `wait_s`, and another source has sent one that is newer by as much: a receiver that has been
    busy, or a recording that is played fast, makes nobody silent.  If nothing comes from any
    source for some seconds, in which time has not stood still, what is held goes out as well.

    Nothing here asks for the time: callers pass a clock reading that never runs backwards.

    Parameters
    ----------
    wait_s : float
        How long an item is held back, in real time and in that of the stamps.
    capacity : int
        Items held at most; beyond it the oldest is dropped of the source that has most of them, so
        that one which floods takes the room of nobody else.
    """

    def __init__(self, wait_s: float, capacity: int) -> None:
        self.wait_s = wait_s
        self.capacity = capacity
        #: Items dropped because too many were held.
        self.dropped = 0
        #: Items older than one that had been released before they came; they are released all the
        #: same.
        self.late = 0
        #: Source of the last of them, and how far behind it was.
        self.last_late = ""
        self._heap: list[_Entry[_Item]] = []
        # Of each source: its items in the heap, oldest stamp first, and how many are not out yet.
        self._held: dict[str, list[_Entry[_Item]]] = {}
        self._counts: Counter[str] = Counter()
        self._arrivals: deque[_Entry[_Item]] = deque()
        self._sources: dict[str, _Source] = {}
        self._released_ns: int | None = None
        self._newest_ns = 0
        # When an item last came, and since when nothing has come although time passed.
        self._last_push_s = self._quiet_since_s = 0.0
        self._numbers = itertools.count()

    def __len__(self) -> int:
        """Count the items held."""
        return self._counts.total()

    def add_source(self, source: str) -> None:
        """Wait for a source from now on, even before it has sent anything."""
        self._sources.setdefault(source, _Source())

    def remove_source(self, source: str) -> None:
        """Wait for a source no longer; its items stay."""
        self._sources.pop(source, None)

    def stand_still(self, now_s: float) -> None:
        """Note that the stamps' time stands still: nobody is silent who sends nothing meanwhile."""
        if now_s - self._last_push_s <= STANDSTILL_S:
            self._quiet_since_s = now_s

    def push(self, source: str, stamp_ns: int, item: _Item, now_s: float) -> None:
        """Take an item that was received at `now_s`."""
        known = self._sources.setdefault(source, _Source())
        # The latest, not the greatest: a source whose clock was set back keeps its place.
        known.latest_ns, known.is_waited_for = stamp_ns, True
        if self._released_ns is not None and stamp_ns < self._released_ns:
            self.late += 1
            self.last_late = f"{source}, {(self._released_ns - stamp_ns) / 1e9:.3g} s behind"
        self._newest_ns = max(self._newest_ns, stamp_ns)
        self._last_push_s = self._quiet_since_s = now_s
        entry = _Entry(stamp_ns, source, next(self._numbers), item, now_s)
        heapq.heappush(self._heap, entry)
        self._arrivals.append(entry)
        heapq.heappush(self._held.setdefault(source, []), entry)
        self._counts[source] += 1
        if len(self) > self.capacity:
            self._drop()

    def pop(self, now_s: float, yielding: Collection[str] = ()) -> tuple[str, _Item] | None:
        """Release the next item and its source, or nothing if it must still wait.

        Parameters
        ----------
        now_s : float
            Reading of the clock.
        yielding : collection of str
            Sources whose items come only when no others can be released.
        """
        self._skip_dropped()
        if not self._heap:
            return None
        others = [
            held[0] for source, held in self._held.items() if held and source not in yielding
        ] if yielding else []  # fmt: skip
        heads = [*([min(others)] if others else []), self._heap[0]]
        head = next((head for head in heads if self._may_go(head, now_s)), None)
        if head is None:
            return None
        if not self._all_are_past(head.stamp_ns):
            self._give_up_on_those_before(head.stamp_ns)
        self._take_out(head)
        self._skip_dropped()
        self._released_ns = head.stamp_ns
        return head.source, head.item

    def longest_wait_s(self, now_s: float) -> float:
        """How long the item has waited that is held the longest; 0 without any."""
        self._skip_dropped()
        return now_s - self._oldest_arrival_s() if self._heap else 0.0

    def _may_go(self, entry: _Entry[_Item], now_s: float) -> bool:
        return self._all_are_past(entry.stamp_ns) or self._patience_ends_s(entry.stamp_ns) <= now_s

    def due_in_s(self, now_s: float) -> float | None:
        """How long until `pop` gives an item even if no more come; None: nothing is held."""
        self._skip_dropped()
        if not self._heap:
            return None
        if self._all_are_past(self._heap[0].stamp_ns):
            return 0.0
        return max(0.0, self._patience_ends_s(self._heap[0].stamp_ns) - now_s)

    def clear(self) -> None:
        """Forget all items, and what was released; sources stay."""
        self._heap.clear()
        self._held.clear()
        self._counts.clear()
        self._arrivals.clear()
        self._released_ns = None
        self._newest_ns = 0

    def _drop(self) -> None:
        """Drop the oldest item of the source that holds most."""
        greediest = max(self._counts, key=lambda source: (self._counts[source], source))
        self._take_out(heapq.heappop(self._held[greediest]))
        self.dropped += 1

    def _take_out(self, entry: _Entry[_Item]) -> None:
        """Note that an item is held no longer; the heaps let go of it when it comes to the top."""
        entry.is_out = True
        self._counts[entry.source] -= 1
        held = self._held[entry.source]
        while held and held[0].is_out:
            heapq.heappop(held)

    def _skip_dropped(self) -> None:
        while self._heap and self._heap[0].is_out:
            heapq.heappop(self._heap)

    def _patience_ends_s(self, stamp_ns: int) -> float:
        """Until when the item of this stamp waits for the others, if no more comes."""
        if self._newest_ns >= stamp_ns + round(self.wait_s * 1e9):
            return self._oldest_arrival_s() + self.wait_s
        quiet_s = max(QUIET_WAITS * self.wait_s, QUIET_S) if self.wait_s else 0.0
        return self._quiet_since_s + quiet_s

    def _all_are_past(self, stamp_ns: int) -> bool:
        latest = [s.latest_ns for s in self._sources.values() if s.latest_ns is not None]
        of_this_time_ns = max(latest, default=0) - round(OTHER_TIME_S * 1e9)
        return all(
            source.latest_ns is not None
            and (source.latest_ns >= stamp_ns or source.latest_ns < of_this_time_ns)
            for source in self._sources.values()
            if source.is_waited_for
        )

    def _oldest_arrival_s(self) -> float:
        """When the item that is held the longest came; there must be one."""
        while self._arrivals[0].is_out:
            self._arrivals.popleft()
        return self._arrivals[0].received_s

    def _give_up_on_those_before(self, stamp_ns: int) -> None:
        for source in self._sources.values():
            if source.latest_ns is None or source.latest_ns < stamp_ns:
                source.is_waited_for = False
