"""What a node says of itself on /diagnostics."""

from __future__ import annotations

import threading
import time
from collections import Counter, deque

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from usmap_ros.live.interfaces import DIAGNOSTICS
from usmap_ros.nodes.plumbing.endpoints import advertise, every

#: A problem shows in the status for this long after it last occurred.
_MEMORY_S = 5.0
#: Latencies that percentiles are taken of.
_LATENCIES = 500


class Health:
    """Counts what a node does and what goes wrong, and publishes it at an interval.

    Counting may be done from any thread.

    Parameters
    ----------
    node : Node
        Whose health it is.
    period_s : float
        From one message to the next.
    counted : sequence of str
        What is counted; all of it is reported, from the start.
    """

    def __init__(self, node: Node, period_s: float, counted: tuple[str, ...]) -> None:
        self._node = node
        self._lock = threading.Lock()
        self._counts: Counter[str] = Counter(dict.fromkeys(counted, 0))
        self._reasons: dict[str, str] = {}
        self._problems: dict[str, tuple[float, bool]] = {}
        self._arrivals: deque[float] = deque(maxlen=_LATENCIES)
        self._latencies_s: deque[float] = deque(maxlen=_LATENCIES)
        self._publisher = advertise(node, DIAGNOSTICS)
        every(node, period_s, self.publish)

    def received(self) -> None:
        """Count a message that has arrived, and take it into the rate."""
        with self._lock:
            self._counts["received"] += 1
            self._arrivals.append(time.monotonic())

    def count(self, what: str, number: int = 1) -> None:
        """Count something that is as it should be."""
        with self._lock:
            self._counts[what] += number

    def problem(self, what: str, reason: str, *, number: int = 1, is_error: bool = False) -> None:
        """Count a problem; it shows in the status for some seconds, and the first in the log."""
        with self._lock:
            is_first = what not in self._reasons
            self._counts[what] += number
            self._reasons[what] = reason
            self._problems[what] = (time.monotonic(), is_error)
        if is_first:
            # Later ones are only counted: a broken sensor must not fill the disk.
            self._node.get_logger().warning(f"{what}: {reason} (further ones in /diagnostics)")

    def latency(self, seconds: float) -> None:
        """Note how long a message took through this node."""
        with self._lock:
            self._latencies_s.append(seconds)

    def total(self, what: str) -> int:
        """How often something was counted."""
        with self._lock:
            return self._counts[what]

    def reason(self, what: str) -> str:
        """Why something was last a problem; empty if it never was."""
        with self._lock:
            return self._reasons.get(what, "")

    def publish(self) -> None:
        """Publish the status now."""
        message = DiagnosticArray()
        message.header.stamp = self._node.get_clock().now().to_msg()
        message.status = [self.status()]
        self._publisher.publish(message)

    def status(self) -> DiagnosticStatus:
        """Level, one line, and all figures."""
        with self._lock:
            now = time.monotonic()
            recent = {
                what: is_error
                for what, (when, is_error) in self._problems.items()
                if now - when < _MEMORY_S
            }
            facts = {what: str(number) for what, number in self._counts.items()}
            facts |= {f"last {what}": reason for what, reason in self._reasons.items()}
            facts |= self._timing(now)
            lines = [f"{what}: {self._reasons[what]}" for what in recent]
        level = DiagnosticStatus.OK
        if recent:
            level = DiagnosticStatus.ERROR if any(recent.values()) else DiagnosticStatus.WARN
        return DiagnosticStatus(
            level=level,
            name=self._node.get_fully_qualified_name(),
            message="; ".join(lines) or "all is well",
            hardware_id=self._node.get_namespace().strip("/"),
            values=[KeyValue(key=key, value=value) for key, value in facts.items()],
        )

    def _timing(self, now: float) -> dict[str, str]:
        recent = sum(now - when < _MEMORY_S for when in self._arrivals)
        facts = {"rate (Hz)": f"{recent / _MEMORY_S:.1f}"}
        latencies = sorted(self._latencies_s)
        for name, share in (("p50", 0.5), ("p95", 0.95)):
            if latencies:
                value = latencies[int(share * (len(latencies) - 1))]
                facts[f"latency {name} (ms)"] = f"{1000.0 * value:.1f}"
        return facts
