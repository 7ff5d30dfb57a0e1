"""What a replay waits for: that those who reconstruct its traces keep up."""

from collections import deque
from dataclasses import dataclass, field

#: Message time by which the oldest trace without its cone may lie behind the replay: little
#: enough for cones of several robots to be put in order again, and for no queue to overflow.
LAG_S = 0.1
#: Nobody who is silent for so long, in real time, is waited for until he answers again.  The first
#: answer may take longer: programs are loaded and compiled for it.
PATIENCE_S, FIRST_PATIENCE_S = 15.0, 60.0


@dataclass
class _Reader:
    """Traces of one topic that have no cone yet, and when that last changed."""

    owed_ns: deque[int] = field(default_factory=deque)
    moved_s: float = 0.0
    patience_s: float = FIRST_PATIENCE_S
    is_waited_for: bool = True


class Readers:
    """Keeps a replay from running ahead of those who read it.

    A reconstructor answers each trace with a cone of the same stamp, or with none if it refuses
    the trace: then the next one's cone answers for it.  Nothing here asks for the time.
    """

    def __init__(self) -> None:
        self._readers: dict[str, _Reader] = {}

    def __len__(self) -> int:
        """Count those that there are, waited for or not."""
        return len(self._readers)

    def add(self, topic: str) -> None:
        """Wait for whoever reads the traces of a topic."""
        self._readers.setdefault(topic, _Reader())

    def sent(self, topic: str, stamp_ns: int, now_s: float) -> None:
        """Note a trace; without effect for topics that were not added."""
        reader = self._readers.get(topic)
        if reader is None:
            return
        if not reader.owed_ns:
            reader.moved_s = now_s
        reader.owed_ns.append(stamp_ns)

    def answered(self, topic: str, stamp_ns: int, now_s: float) -> None:
        """Note a cone: it answers its trace and all older ones."""
        reader = self._readers.get(topic)
        if reader is None:
            return
        reader.moved_s, reader.patience_s, reader.is_waited_for = now_s, PATIENCE_S, True
        while reader.owed_ns and reader.owed_ns[0] <= stamp_ns:
            reader.owed_ns.popleft()

    def limit_ns(self, now_s: float) -> float:
        """Message time that the replay may reach by now; infinite if nobody is waited for."""
        limits_ns = [float("inf")]
        for reader in self._readers.values():
            if not reader.owed_ns:
                continue
            if now_s - reader.moved_s > reader.patience_s:
                reader.is_waited_for = False
                reader.owed_ns.clear()
            elif reader.is_waited_for:
                limits_ns.append(reader.owed_ns[0] + LAG_S * 1e9)
        return min(limits_ns)

    def forget(self) -> None:
        """Begin anew: nothing is owed."""
        for reader in self._readers.values():
            reader.owed_ns.clear()
