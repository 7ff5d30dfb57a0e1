"""What is to be said of a robot among others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

Verdict = Literal["healthy", "unknown", "deaf", "noisy", "loud", "clipped", "stuck", "misplaced"]


@dataclass(frozen=True)
class Finding:
    """What is to be said of a robot.

    Parameters
    ----------
    verdict : str
        ``unknown`` where too little of what it looked at was seen by others.
    evidence : dict
        Numbers that the verdict is from: of an `Agreement`, of a `ReceiverHealth` or an
        `EchoHealth`, or the share of
        pings that repeat the one before though the robot has moved.
    reason : str
        In words; empty for the healthy.
    """

    verdict: Verdict
    evidence: dict[str, float | int | None]
    reason: str = ""

    @property
    def is_suspect(self) -> bool:
        """Whether its evidence is better left out."""
        return self.verdict not in ("healthy", "unknown")

    def summary(self) -> dict[str, Any]:
        """Contents for ``summary.json``."""
        return {"verdict": self.verdict, "reason": self.reason, "evidence": self.evidence}
