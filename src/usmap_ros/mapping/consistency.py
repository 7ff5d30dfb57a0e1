"""Which robots' echoes contradict the map that all the others make.

A robot that is stuck repeats itself while it moves.  One that is deaf hears less than the others
would, one that is loud more.  The echoes of one that is misplaced fit what the others' map
expects of it no better than they fit the same shifted in range.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy as np

from usmap_ros.cone import EchoCone
from usmap_ros.mapping.agreement import Agreement, agreement
from usmap_ros.mapping.superposition.fusion import SuperpositionFusion
from usmap_ros.mapping.superposition.others import Expected
from usmap_ros.parameters import MappingParameters

#: What the map expects of the pings of robots, by topic, as the others have it.
Expecting = Callable[[Mapping[str, Sequence[EchoCone]]], dict[str, list[Expected]]]
Verdict = Literal["healthy", "unknown", "deaf", "loud", "stuck", "misplaced"]

#: Pings of each robot that are remembered, and compared, spread evenly over those.
REMEMBERED, COMPARED = 200, 80
#: A robot has moved, between one ping and the next, from so far on.
MOVED_M, MOVED_RAD = 0.01, 0.01
#: Pings with echoes from a robot that moves that are needed to say that it repeats itself, and the
#: share of them that must be repetitions to the last digit, which noise never makes.
LEAST_REPEATS, REPEATED_SHARE = 10, 0.5
#: Amplitudes, and detection limits, beyond this difference from the others' are odd.
ODD_LOUDNESS_DB, ODD_LIMIT_DB = 6.0, 10.0
#: Echoes where the map expects them that are needed to judge loudness, fewer where it is very odd;
#: pings with expectations that are needed to judge places.
LEAST_MATCHES, FEW_MATCHES, VERY_ODD_DB = 8, 4, 12.0
LEAST_PINGS = 8
#: Once a robot has been named, so many others can name nobody else.
LEAST_ROBOTS_LEFT = 2
#: `Agreement.fit`, relative to the median of the others, below which a robot is suspected of being
#: misplaced, and below which that is confirmed; what is assumed of the others if there is nothing.
SUSPECT_FIT, MISPLACED_FIT, USUAL_FIT = 0.7, 0.4, 1.0


@dataclass(frozen=True)
class Finding:
    """What is to be said of a robot.

    Parameters
    ----------
    verdict : str
        ``unknown`` where too little of what it looked at was seen by others.
    evidence : dict
        Numbers of its `Agreement`, and `repeated`, the share of its pings that repeat the one
        before though it has moved.
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


class _Robot:
    """What is remembered of one robot."""

    def __init__(self) -> None:
        self.cones: deque[EchoCone] = deque(maxlen=REMEMBERED)
        self.repeats: deque[bool] = deque(maxlen=REMEMBERED)
        self._last: EchoCone | None = None

    def add(self, cone: EchoCone) -> None:
        if self._last is not None and len(cone.ranges_m) and _has_moved(self._last, cone):
            self.repeats.append(_is_repetition(self._last, cone))
        self._last = cone
        self.cones.append(cone)

    def copy(self) -> _Robot:
        other = _Robot()
        other.cones, other.repeats = self.cones.copy(), self.repeats.copy()
        return other

    def chosen(self) -> list[EchoCone]:
        """Pings to compare, spread evenly."""
        places = np.linspace(0, len(self.cones) - 1, min(COMPARED, len(self.cones)))
        return [self.cones[int(place)] for place in places]

    def repeated(self) -> float:
        """Share of its pings that repeat the one before, though it has moved."""
        return float(np.mean(self.repeats)) if len(self.repeats) >= LEAST_REPEATS else 0.0


class Consistency:
    """Compares each robot's pings with what the others' map expects; remembers the latest.

    Parameters
    ----------
    parameters : MappingParameters
        Of the map.
    """

    def __init__(self, parameters: MappingParameters) -> None:
        self._parameters = parameters
        self._robots: dict[str, _Robot] = {}

    def add(self, topic: str, cone: EchoCone) -> None:
        """Remember a ping."""
        self._robots.setdefault(topic, _Robot()).add(cone)

    def copy(self) -> Consistency:
        """The same memory, to be judged while the original goes on."""
        other = Consistency(self._parameters)
        other._robots = {topic: robot.copy() for topic, robot in self._robots.items()}
        return other

    def findings(self, expected_by_others: Expecting) -> dict[str, Finding]:
        """Judge every robot, by topic.

        A screen on the common map comes first; what it finds is confirmed on a map that the
        suspect has no part in.  Of several misplaced robots the worst is named first and the
        others are judged again without it, for it spoils the map that they are compared with.

        Parameters
        ----------
        expected_by_others : callable
            `Fusion.expected_by_others` of the map that the pings went into.
        """
        found: dict[str, Finding] = {}
        for topic, robot in self._robots.items():
            share = robot.repeated()
            if share > REPEATED_SHARE:
                reason = f"{share:.0%} of its pings repeat the one before though it has moved"
                found[topic] = Finding("stuck", {"repeated": share}, f"stuck: {reason}")
        while True:
            judged = self._judge(expected_by_others, found, SUSPECT_FIT)
            suspects = [topic for topic, finding in judged.items() if finding.is_suspect]
            # Two that are left after a liar spoilt the map cannot tell which of them is wrong.
            can_tell = not found or len(judged) > LEAST_ROBOTS_LEFT
            suspects.sort(key=lambda topic: judged[topic].evidence["fit"] or 0.0)
            confirmations = (self._confirm(topic, found) for topic in suspects if can_tell)
            confirmed = next(filter(None, confirmations), None)
            if confirmed is None:
                cleared = {t: replace(judged[t], verdict="healthy", reason="") for t in suspects}
                return dict(sorted((found | judged | cleared).items()))
            found |= confirmed

    def _judge(
        self, expected_by_others: Expecting, without: Collection[str], least_fit: float
    ) -> dict[str, Finding]:
        """Judge all robots but some, by a common map."""
        chosen = {t: r.chosen() for t, r in self._robots.items() if t not in without}
        expected = expected_by_others(chosen)
        agreements = {topic: agreement(expected.get(topic, [])) for topic in chosen}
        return {
            topic: _verdict(own, [a for t, a in agreements.items() if t != topic], least_fit)
            for topic, own in agreements.items()
        }

    def _confirm(self, topic: str, without: Collection[str]) -> dict[str, Finding] | None:
        """Judge a suspect by a map of the others' pings alone; None if it is cleared."""
        others = {t: r.chosen() for t, r in self._robots.items() if t not in (topic, *without)}
        apart = SuperpositionFusion(self._parameters)
        cones = (cone for own in others.values() for cone in own)
        for cone in sorted(cones, key=lambda cone: cone.stamp_ns):
            apart.fuse(cone)
        finding = self._judge(apart.expected_by_others, without, MISPLACED_FIT)[topic]
        if not finding.is_suspect:
            return None
        if finding.verdict == "misplaced" and len(others) == 1:
            # Which of two is right, nobody can say.
            finding = replace(finding, reason=f"{finding.reason}; or the only other robot is")
            return {topic: finding, **dict.fromkeys(others, finding)}
        return {topic: finding}


def is_of(topic: str, names: Iterable[str]) -> bool:
    """Whether a topic is among some names, each of a topic or of the robot whose it is."""
    path = topic.strip("/") + "/"
    return any(path.startswith(name.strip("/") + "/") for name in names if name.strip("/"))


def _verdict(own: Agreement, others: list[Agreement], least_fit: float) -> Finding:
    """Judge a robot by how it agrees with the others' map, beside how they agree with theirs."""
    limit_db = _difference(own.limit_db, [a.limit_db for a in others])
    louder_db = _difference(
        own.loudness_db, [a.loudness_db for a in others if a.matches >= FEW_MATCHES]
    )
    if louder_db is not None and len(others) == 1:
        # Of two, each is as much louder than the other as that is fainter.
        louder_db *= 0.5
    evidence: dict[str, float | int | None] = asdict(own) | {
        "limit_over_others_db": limit_db,
        "loudness_over_others_db": louder_db,
    }
    # Few echoes that happen to match do not tell a misplaced robot's loudness.
    if louder_db is not None and own.matches >= FEW_MATCHES and abs(louder_db) > VERY_ODD_DB:
        return _of_odd_loudness(louder_db, own.matches, evidence)
    if limit_db is not None and limit_db > ODD_LIMIT_DB:
        reason = f"deaf: its detection limit is {limit_db:.0f} dB above the others'"
        return Finding("deaf", evidence, reason)
    if own.pings < LEAST_PINGS or own.fit is None:
        return Finding("unknown", evidence)
    fits = [a.fit for a in others if a.pings >= LEAST_PINGS and a.fit is not None]
    usual = float(np.median(fits)) if fits else USUAL_FIT
    if own.fit < least_fit * usual:
        reason = (
            f"misplaced: {own.heard} of {own.audible} expected echoes were heard, and its pings"
            f" fit the others' map by {own.fit:.2f} a range bin where theirs fit by {usual:.2f}"
        )
        return Finding("misplaced", evidence, reason)
    if louder_db is not None and own.matches >= LEAST_MATCHES and abs(louder_db) > ODD_LOUDNESS_DB:
        return _of_odd_loudness(louder_db, own.matches, evidence)
    return Finding("healthy", evidence)


def _of_odd_loudness(
    louder_db: float, matches: int, evidence: dict[str, float | int | None]
) -> Finding:
    verdict: Verdict = "loud" if louder_db > 0.0 else "deaf"
    compared = "louder" if louder_db > 0.0 else "fainter"
    reason = f"{matches} echoes are {abs(louder_db):.0f} dB {compared} than by the others"
    return Finding(verdict, evidence, f"{verdict}: {reason}")


def _difference(own: float | None, others: list[float | None]) -> float | None:
    known = [value for value in others if value is not None]
    return None if own is None or not known else float(own - np.median(known))


def _has_moved(before: EchoCone, after: EchoCone) -> bool:
    way_m = np.linalg.norm(after.pose.position_m[:2] - before.pose.position_m[:2])
    turned = (after.pose.yaw_rad - before.pose.yaw_rad + np.pi) % (2.0 * np.pi) - np.pi
    return bool(way_m > MOVED_M or abs(turned) > MOVED_RAD)


def _is_repetition(before: EchoCone, after: EchoCone) -> bool:
    return np.array_equal(before.ranges_m, after.ranges_m) and np.array_equal(
        before.amplitudes, after.amplitudes
    )
