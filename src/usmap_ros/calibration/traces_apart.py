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
        #: Whether they are enough, and neither on a line nor on a circle.
        self.have_turned = False
        self._apart_m = _APART_M
        # Of those that are kept.
        self._positions_m = np.zeros((0, 2))

    def add(self, trace: EchoTrace) -> None:
        """Take a trace, unless those before it are enough or it is near one of them."""
        if self.have_turned or not self._is_apart(trace):
            return
        if self._is_full(trace):
            self.traces, self._positions_m = self.traces[::2], self._positions_m[::2]
            self._apart_m *= 2.0
            if not self._is_apart(trace):
                return
        self.traces.append(trace)
        self._positions_m = np.vstack([self._positions_m, trace.pose.position_m[:2]])
        self.taken += 1
        if self._is_full(trace):
            self.were_enough = True
            self.have_turned = not could_stand_as_far(self._positions_m, np.inf)

    def _is_full(self, trace: EchoTrace) -> bool:
        return len(self.traces) >= min(_KEPT, _KEPT_BYTES // max(trace.samples.nbytes, 1))

    def _is_apart(self, trace: EchoTrace) -> bool:
        off_m = self._positions_m - trace.pose.position_m[:2]
        return bool((np.hypot(off_m[:, 0], off_m[:, 1]) > self._apart_m).all())
