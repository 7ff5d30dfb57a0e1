"""What is to be said of a robot among others."""

from dataclasses import dataclass
from typing import Any, Literal

Verdict = Literal[
    "healthy", "unknown", "contradicted", "deaf", "noisy", "loud", "clipped", "stuck", "misplaced"
]


@dataclass(frozen=True)
class Finding:
    """What is to be said of a robot."""

    #: ``unknown`` where too little of what it looked at was seen by others; ``contradicted`` where
    #: it and another one contradict each other, and nobody can tell which is wrong.
    verdict: Verdict
    #: Numbers that the verdict is from: of an `Agreement`, of a `ReceiverHealth` or an
    #: `EchoHealth`, or the share of pings that repeat the one before though the robot has moved.
    evidence: dict[str, float | int | None]
    #: In words; empty for the healthy.
    reason: str = ""

    @property
    def is_suspect(self) -> bool:
        """Whether its evidence is better left out."""
        return self.verdict not in ("healthy", "unknown", "contradicted")

    @property
    def trust(self) -> float:
        """How much of what it says counts: nothing of what a suspect does."""
        return 0.0 if self.is_suspect else 1.0

    def summary(self) -> dict[str, Any]:
        """Contents for ``summary.json``."""
        return {"verdict": self.verdict, "reason": self.reason, "evidence": self.evidence}
