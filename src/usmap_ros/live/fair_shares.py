"""Who takes more than a fair share of the time that fusion has."""

from __future__ import annotations

import math
from dataclasses import dataclass

from usmap_ros.pings.cone import EchoCone

#: How fast what was spent is forgotten, and times a fair share from which on it is too much.
_MEMORY_S, _TOO_MUCH = 10.0, 1.5
#: What a ping costs besides what it reaches, m².
_BESIDES_M2 = 4.0


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
