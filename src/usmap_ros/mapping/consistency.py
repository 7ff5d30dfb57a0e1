"""Which robots' echoes contradict the map that all the others make.

A robot that is stuck repeats itself while it moves.  One that is deaf hears less than the others
would, one that is loud more, one that is noisy what is not there.  The echoes of one that is
misplaced fit what the others' map expects of it no better than they fit the same shifted in range.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, replace

import numpy as np

from usmap_ros.cone import EchoCone
from usmap_ros.mapping.agreement import Agreement, agreement
from usmap_ros.mapping.finding import Finding, Verdict
from usmap_ros.mapping.hearing import FEW_ECHOES, hearing, odd_hearing
from usmap_ros.mapping.superposition.fusion import SuperpositionFusion
from usmap_ros.mapping.superposition.others import Expected
from usmap_ros.parameters import MappingParameters

#: What the map expects of the pings of robots, by topic, as the others have it.
Expecting = Callable[[Mapping[str, Sequence[EchoCone]]], dict[str, list[Expected]]]

#: Pings of each robot that are remembered, and compared, spread evenly over those.
REMEMBERED, COMPARED = 200, 80
#: A robot has moved, between one ping and the next, from so far on.
MOVED_M, MOVED_RAD = 0.01, 0.01
#: Pings with echoes from a robot that moves that are needed to say that it repeats itself, and the
#: share of them that must be repetitions to the last digit, which noise never makes.
LEAST_REPEATS, REPEATED_SHARE = 10, 0.5
#: Amplitudes beyond this difference from the others' are odd: what smooth walls return, to one
#: robot squarely and to another not, differs by up to 12 dB.
ODD_LOUDNESS_DB = 15.0
#: Echoes where the map expects them that are needed to judge loudness; pings with expectations that
#: are needed to judge places.
LEAST_MATCHES, LEAST_PINGS = 4, 8
#: Once a robot has been named, so many others can name nobody else.
LEAST_ROBOTS_LEFT = 2
#: `Agreement.fit`, relative to the median of the others, below which a robot is suspected of being
#: misplaced, and below which that is confirmed; most that is asked of anybody.
SUSPECT_FIT, MISPLACED_FIT, USUAL_FIT = 0.7, 0.4, 1.0


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

    def forget(self, names: Collection[str]) -> None:
        """Forget robots, or topics."""
        self._robots = {t: robot for t, robot in self._robots.items() if not is_of(t, names)}

    def copy(self) -> Consistency:
        """The same memory, to be judged while the original goes on."""
        other = Consistency(self._parameters)
        other._robots = {topic: robot.copy() for topic, robot in self._robots.items()}
        return other

    def findings(
        self, expected_by_others: Expecting, between: Callable[[], None] = lambda: None
    ) -> dict[str, Finding]:
        """Judge every robot, by topic.

        A screen on the common map comes first; what it finds is confirmed on a map that the
        suspect has no part in.  Of several misplaced robots the worst is named first and the
        others are judged again without it, for it spoils the map that they are compared with.

        Parameters
        ----------
        expected_by_others : callable
            `Fusion.expected_by_others` of the map that the pings went into.
        between : callable
            Called between pieces of work, which take milliseconds; what it raises ends the
            judgement.
        """
        found = self._by_themselves()
        while True:
            screened = self._judge(expected_by_others, found, SUSPECT_FIT)
            suspects = [topic for topic, finding in screened.items() if finding.is_suspect]
            # Two that are left after a liar spoilt the map cannot tell which of them is wrong.
            can_tell = not found or len(screened) > LEAST_ROBOTS_LEFT
            suspects.sort(key=lambda topic: screened[topic].evidence["fit"] or 0.0)
            confirmations = (self._confirm(t, found, between) for t in suspects if can_tell)
            confirmed = next(filter(None, confirmations), None)
            if confirmed is None:
                cleared = {t: replace(screened[t], verdict="healthy", reason="") for t in suspects}
                return dict(sorted((found | screened | cleared).items()))
            found |= confirmed

    def _by_themselves(self) -> dict[str, Finding]:
        """Those who are found without a map, which they would spoil."""
        found: dict[str, Finding] = {}
        for topic, robot in self._robots.items():
            share = robot.repeated()
            if share > REPEATED_SHARE:
                reason = f"{share:.0%} of its pings repeat the one before though it has moved"
                found[topic] = Finding("stuck", {"repeated": share}, f"stuck: {reason}")
        hearings = {t: hearing(r.cones) for t, r in self._robots.items() if t not in found}
        return found | odd_hearing({t: own for t, own in hearings.items() if own is not None})

    def _judge(
        self, expected_by_others: Expecting, without: Collection[str], least_fit: float
    ) -> dict[str, Finding]:
        """Judge all robots but some, by a common map."""
        chosen = {t: r.chosen() for t, r in self._robots.items() if t not in without}
        expected = expected_by_others(chosen)
        agreements = {topic: agreement(expected.get(topic, [])) for topic in chosen}
        return {
            topic: judged(own, [a for t, a in agreements.items() if t != topic], least_fit)
            for topic, own in agreements.items()
        }

    def _confirm(
        self, topic: str, without: Collection[str], between: Callable[[], None]
    ) -> dict[str, Finding] | None:
        """Judge a suspect by a map of the others' pings alone; None if it is cleared."""
        others = {t: r.chosen() for t, r in self._robots.items() if t not in (topic, *without)}
        apart = SuperpositionFusion(self._parameters)
        cones = (cone for own in others.values() for cone in own)
        for cone in sorted(cones, key=lambda cone: cone.stamp_ns):
            between()
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


def judged(own: Agreement, others: list[Agreement], least_fit: float) -> Finding:
    """Judge a robot by how it agrees with the others' map, beside how they agree with theirs."""
    louder_db = _difference(
        own.loudness_db, [a.loudness_db for a in others if a.matches >= LEAST_MATCHES]
    )
    if louder_db is not None and len(others) == 1:
        # Of two, each is as much louder than the other as that is fainter.
        louder_db *= 0.5
    evidence: dict[str, float | int | None] = asdict(own) | {"loudness_over_others_db": louder_db}
    if louder_db is not None and own.matches >= LEAST_MATCHES and abs(louder_db) > ODD_LOUDNESS_DB:
        return _of_odd_loudness(louder_db, own.matches, evidence)
    if own.pings < LEAST_PINGS or own.fit is None:
        return Finding("unknown", evidence)
    fits = [a.fit for a in others if a.pings >= LEAST_PINGS and a.fit is not None]
    # Smooth walls, struck squarely by one robot and not by another, fit better than they need to.
    usual = min(float(np.median(fits)), USUAL_FIT) if fits else USUAL_FIT
    if own.fit >= least_fit * usual:
        return Finding("healthy", evidence)
    heard = f"{own.heard} of {own.audible} expected echoes were heard"
    echoes = float(np.median([a.echoes for a in others])) if others else 0.0
    if own.echoes < FEW_ECHOES * echoes:
        count = f"it hears {own.echoes:.1f} echoes a ping, others {echoes:.1f}"
        return Finding("deaf", evidence, f"deaf: {heard}, and {count}")
    fit = f"its pings fit the others' map by {own.fit:.2f} a range bin"
    return Finding("misplaced", evidence, f"misplaced: {heard}, and {fit}, of {usual:.2f} usual")


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
