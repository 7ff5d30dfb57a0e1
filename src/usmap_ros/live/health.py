"""How a node is: what it counts, what went wrong lately, and what an operator should know."""

import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum

#: A problem shows for this long after it last occurred, and rates are of as long a time.
_MEMORY_S = 5.0
#: Without any work for so long, a node is not doing what it is there for.
_SILENT_AFTER_S = 10.0
#: Events that rates and percentiles are taken of.
_RECENT = 500


class Level(IntEnum):
    """How bad it is; the numbers are those of ``diagnostic_msgs/DiagnosticStatus``."""

    OK = 0
    WARN = 1
    ERROR = 2


@dataclass(frozen=True)
class Remark:
    """Something that an operator should know."""

    level: Level
    text: str


@dataclass(frozen=True)
class Report:
    """How a node is, now: the worst level, all findings in one line, and every figure."""

    level: Level
    message: str
    facts: dict[str, str]


class Health:
    """Counts what a node does and what goes wrong; may be used from any thread.

    Parameters
    ----------
    counted : sequence of str
        What is counted; all of it is reported, from the start.
    warn : callable
        Gets the first occurrence of each problem, and what is found from then on that it is.
    clock : callable
        Seconds of a clock that never runs backwards.
    """

    def __init__(
        self,
        counted: tuple[str, ...],
        warn: Callable[[str], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._warn = warn
        #: The same, which may be exchanged at any time.
        self.clock = clock
        self._lock = threading.Lock()
        self._counts: Counter[str] = Counter(dict.fromkeys(counted, 0))
        self._reasons: dict[str, str] = {}
        self._problems: dict[str, tuple[float, Level]] = {}
        self._work_s: deque[float] = deque(maxlen=_RECENT)
        self._latencies_s: deque[tuple[float, float]] = deque(maxlen=_RECENT)
        self._started_s = clock()
        self._watches: list[Callable[[], Remark | None]] = []
        self._told: dict[str, Callable[[], object]] = {}
        # What each watch found last, by the first word of it: figures in it change.
        self._found: dict[int, str] = {}

    def watch(self, look: Callable[[], Remark | None]) -> None:
        """Ask `look`, with each report, whether there is something that an operator should know."""
        self._watches.append(look)

    def tell(self, what: str, look: Callable[[], object]) -> None:
        """Report, as a figure, what `look` gives at the time."""
        self._told[what] = look

    def work(self, what: str) -> None:
        """Count a piece of what the node is there for, and take it into the rate."""
        with self._lock:
            self._counts[what] += 1
            self._work_s.append(self.clock())

    def count(self, what: str, number: int = 1) -> None:
        """Count something that is as it should be."""
        with self._lock:
            self._counts[what] += number

    def problem(self, what: str, reason: str, *, number: int = 1, is_error: bool = False) -> None:
        """Count a problem; it shows in reports for some seconds, and the first in the log."""
        with self._lock:
            is_first = what not in self._reasons
            self._counts[what] += number
            self._reasons[what] = reason
            self._problems[what] = (self.clock(), Level.ERROR if is_error else Level.WARN)
        if is_first:
            # Later ones are only counted: a broken sensor must not fill the disk.
            self._warn(f"{what}: {reason} (further ones in /diagnostics)")

    def latency(self, seconds: float) -> None:
        """Note how long a message took through the node."""
        with self._lock:
            self._latencies_s.append((self.clock(), seconds))

    def total(self, what: str) -> int:
        """How often something was counted."""
        with self._lock:
            return self._counts[what]

    def reason(self, what: str) -> str:
        """Why something was last a problem; empty if it never was."""
        with self._lock:
            return self._reasons.get(what, "")

    def slowness(self, limit_s: float) -> Remark | None:
        """Warn if half of the recent messages took longer than `limit_s`."""
        with self._lock:
            latency_s = self._recent_latency_s(0.5)
        if latency_s is None or latency_s <= limit_s:
            return None
        return Remark(Level.WARN, f"slow: messages take {latency_s:.1f} s, more than {limit_s:g} s")

    def silence(self, text: str) -> Remark | None:
        """Warn if no work has come for some seconds; `text` says of what, and why that may be."""
        with self._lock:
            since_s = self._work_s[-1] if self._work_s else self._started_s
        silent_s = self.clock() - since_s
        if silent_s < _SILENT_AFTER_S:
            return None
        return Remark(Level.WARN, f"silent for {silent_s:.0f} s: {text}")

    def report(self) -> Report:
        """How the node is, now."""
        # Not under the lock: they may look at figures themselves.
        looks = [look() for look in self._watches]
        self._warn_of_news(looks)
        watched = [finding for finding in looks if finding is not None]
        told = {what: str(look()) for what, look in self._told.items()}
        with self._lock:
            findings = [*watched, *self._recent_problems()]
            facts = {what: str(number) for what, number in self._counts.items()}
            facts |= {f"last {what}": reason for what, reason in self._reasons.items()}
            facts |= told | self._timing()
        return Report(
            max((finding.level for finding in findings), default=Level.OK),
            "; ".join(finding.text for finding in findings) or "all is well",
            facts,
        )

    def _warn_of_news(self, looks: Sequence[Remark | None]) -> None:
        """Say what was not so at the last report, for those who look at a terminal only."""
        for number, finding in enumerate(looks):
            kind = finding.text.split()[0] if finding else ""
            if finding is not None and self._found.get(number) != kind:
                self._warn(finding.text)
            self._found[number] = kind

    def _recent_problems(self) -> Iterator[Remark]:
        for what, (when_s, level) in self._problems.items():
            if self.clock() - when_s < _MEMORY_S:
                yield Remark(level, f"{what}: {self._reasons[what]}")

    def _timing(self) -> dict[str, str]:
        facts = {"rate (Hz)": f"{self._rate_hz():.1f}"}
        for name, share in (("p50", 0.5), ("p95", 0.95)):
            latency_s = self._recent_latency_s(share)
            if latency_s is not None:
                facts[f"latency {name} (ms)"] = f"{1000.0 * latency_s:.1f}"
        return facts

    def _rate_hz(self) -> float:
        now_s = self.clock()
        recent = [when_s for when_s in self._work_s if now_s - when_s < _MEMORY_S]
        if len(recent) < _RECENT:
            return len(recent) / _MEMORY_S
        # Fast work fills the memory in less time.
        return len(recent) / max(now_s - recent[0], 1e-9)

    def _recent_latency_s(self, share: float) -> float | None:
        """Latency that this share of the recent messages did not exceed; None without any."""
        now_s = self.clock()
        recent = sorted(s for when_s, s in self._latencies_s if now_s - when_s < _MEMORY_S)
        return recent[int(share * (len(recent) - 1))] if recent else None
