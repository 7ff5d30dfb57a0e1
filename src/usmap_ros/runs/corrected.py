"""Pings with corrected poses; here, because who waits for them need not load what corrects."""

from __future__ import annotations

from dataclasses import dataclass, field

from usmap_ros.localisation.pose_kind import PoseKind
from usmap_ros.mapping.far_off import Ping


@dataclass(frozen=True)
class RobotPoses:
    """What became of the poses of a robot."""

    #: What they were.
    kind: PoseKind
    #: The frame that they are in now.
    frame_id: str
    #: ``joined`` with others in this frame, ``alone``, or ``lost``: carried off, and not joined.
    state: str
    #: Root mean square of how far places were moved within their frame.
    correction_m: float
    #: Root mean square of how far they may still be off.
    std_m: float

    def summary(self) -> dict[str, object]:
        """Of ``summary.json``."""
        return {
            "poses": self.kind.value,
            "frame_id": self.frame_id,
            "state": self.state,
            "correction_m": self.correction_m,
            "std_m": self.std_m,
        }


@dataclass(frozen=True)
class Corrected:
    """Pings with corrected poses."""

    #: List of (topic, EchoCone): in the order they came in.
    pings: list[Ping]
    #: What became of each robot's poses.
    robots: dict[str, RobotPoses] = field(default_factory=dict)

    def drifts(self, robot: str) -> bool:
        """Whether its changes are known better than its places, as of robots that nobody knows."""
        return robot not in self.robots or self.robots[robot].kind.drifts
