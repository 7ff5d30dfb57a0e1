"""Some of a transducer's traces, from places apart from one another."""

from __future__ import annotations

import numpy as np

from usmap_ros.calibration.ringing import could_stand_as_far
from usmap_ros.pings.trace import EchoTrace

#: How many are kept, of no more bytes than this, and how far apart they must be at first (m).
_KEPT, _KEPT_BYTES = 40, 4_000_000
_APART_M = 0.05


class TracesApart:
    """Traces from places apart, farther from one another as long as all are on one line.

    What is heard from all places alike is the sensor's own, unless the robot goes straight on or
    round and round: a wall or an object might be always as far away.
    """

    def __init__(self) -> None:
        #: Traces that are kept, in the order of their stamps.
        self.traces: list[EchoTrace] = []
        #: How many were ever taken.
        self.taken = 0
        #: Whether they were enough once, though they may be on a line.
        self.were_enough = False
        self._apart_m = _APART_M

    def add(self, trace: EchoTrace) -> None:
        """Take a trace, unless those before it are enough or it is near one of them."""
        if self.have_turned or not self._is_apart(trace):
            return
        if self._is_full(trace):
            self.traces = self.traces[::2]
            self._apart_m *= 2.0
            if not self._is_apart(trace):
                return
        self.traces.append(trace)
        self.taken += 1
        self.were_enough = self.were_enough or self._is_full(trace)

    @property
    def have_turned(self) -> bool:
        """Whether they are enough, and neither on a line nor on a circle."""
        if not self.traces or not self._is_full(self.traces[-1]):
            return False
        positions_m = np.array([trace.pose.position_m[:2] for trace in self.traces])
        return not could_stand_as_far(positions_m, np.inf)

    def _is_full(self, trace: EchoTrace) -> bool:
        return len(self.traces) >= min(_KEPT, _KEPT_BYTES // max(trace.samples.nbytes, 1))

    def _is_apart(self, trace: EchoTrace) -> bool:
        here_m = trace.pose.position_m[:2]
        return all(
            np.hypot(*(here_m - one.pose.position_m[:2])) > self._apart_m for one in self.traces
        )
