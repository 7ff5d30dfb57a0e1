"""What a replay waits for besides its readers: that those who fuse cones keep up with them."""

from collections.abc import Mapping
from dataclasses import dataclass

#: What `map_fusion` reports of its queue: how many cones wait in it, and how many may.
WAITING, ROOM = "waiting", "queue depth"
#: Share of a queue that may be in use, as far as anybody can know, before the replay waits.
_FULL = 0.8
#: Reports come every second at the defaults; who sends none for so long is waited for no more.
_PATIENCE_S = 15.0


@dataclass
class _Queue:
    """A queue of cones as it was last reported, and the cones of which that said nothing yet."""

    waiting: int
    room: int
    reported_s: float
    sent_before: int = 0
    sent_since: int = 0

    def is_full(self) -> bool:
        """Whether it may be too full for more.

        Those that were under way when the report was made may be in it and not counted: cones of
        one interval before it count as well.
        """
        return self.waiting + self.sent_before + self.sent_since >= _FULL * self.room


class Backlog:
    """Keeps a replay from filling the queues of those who fuse its cones.

    They report on ``/diagnostics`` how full their queues are.  Nothing here asks for the time.
    """

    def __init__(self) -> None:
        self._queues: dict[str, _Queue] = {}

    def __len__(self) -> int:
        """Count the queues that were ever reported."""
        return len(self._queues)

    def reported(self, name: str, facts: Mapping[str, str], now_s: float) -> None:
        """Note what a node says of itself; without effect if it says nothing of a queue."""
        try:
            waiting, room = int(facts[WAITING]), int(facts[ROOM])
        except (KeyError, ValueError):
            return
        before = self._queues.get(name)
        sent = before.sent_since if before else 0
        self._queues[name] = _Queue(waiting, room, now_s, sent_before=sent)

    def sent(self) -> None:
        """Note a cone that is on its way."""
        for queue in self._queues.values():
            queue.sent_since += 1

    def is_full(self, now_s: float) -> bool:
        """Whether anybody has more to fuse than there should be."""
        return any(
            queue.is_full() and now_s - queue.reported_s <= _PATIENCE_S
            for queue in self._queues.values()
        )
