"""Which robots' echoes contradict the map that all the others make.

A robot that is stuck repeats itself while it moves.  One that is deaf hears less than the others
would, one that is loud more, one that is noisy what is not there.  The echoes of one that is
misplaced fit what the others' map expects of it no better than they fit the same shifted in range;
those of one that faces elsewhere than it says fit better what it would hear there.  A liar spoils
the map that all are compared with, so that others contradict it: it is the one without which the
rest agree.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import replace

import numpy as np

from usmap_ros.mapping.joint.kept_pings import REMEMBERED
from usmap_ros.mapping.robot_check.comparison import LEAST_ROBOTS_LEFT, RobotComparison
from usmap_ros.mapping.robot_check.echo_health import echo_health, odd_echoes
from usmap_ros.mapping.robot_check.finding import Finding
from usmap_ros.mapping.robot_check.receiver_health import odd_receivers, receiver_health
from usmap_ros.numerics.geometry import way_between
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

#: Of the pings of each robot that are remembered, so many are compared, spread evenly.
COMPARED = 80
#: The latest pings of each robot, by which alone its receiver is judged as well: one that fails on
#: the way would else be named only when half of all that are remembered are wrong.
LATEST = 60
#: A robot has moved, between one ping and the next, from so far on.
MOVED_M, MOVED_RAD = 0.01, 0.01
#: Pings with echoes from a robot that moves that are needed to say that it repeats itself, and the
#: share of them that must be repetitions to the last digit, which noise never makes.
LEAST_REPEATS, REPEATED_SHARE = 10, 0.5


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

    def findings(self, between: Callable[[], None] = lambda: None) -> dict[str, Finding]:
        """Judge every robot, by topic.

        A screen on the common map comes first; what it finds is confirmed on a map that the
        suspect has no part in.  Then the others are judged again without it, for it has spoilt
        what they are compared with.

        Parameters
        ----------
        between : callable
            Called between pieces of work; what it raises ends the judgement.
        """
        found = self._by_themselves()
        while True:
            chosen = {t: r.chosen() for t, r in self._robots.items() if t not in found}
            if len(chosen) < 2:
                unknown = {t: Finding("unknown", {}) for t in chosen}
                return dict(sorted((found | unknown).items()))
            comparison = RobotComparison(self._parameters, chosen, between)
            screened = comparison.screen()
            # Two that are left after a liar spoilt the map cannot tell which of them is wrong.
            can_tell = not found or len(screened) > LEAST_ROBOTS_LEFT
            named = comparison.culprits(screened) if can_tell else {}
            if not named:
                return dict(sorted((found | _cleared(screened)).items()))
            found |= named

    def _by_themselves(self) -> dict[str, Finding]:
        """Those who are found without a map, which they would spoil."""
        found: dict[str, Finding] = {}
        for topic, robot in self._robots.items():
            share = robot.repeated()
            if share > REPEATED_SHARE:
                reason = f"{share:.0%} of its pings repeat the one before though it has moved"
                found[topic] = Finding("stuck", {"repeated": share}, f"stuck: {reason}")
        rest = {t: list(robot.cones) for t, robot in self._robots.items() if t not in found}
        latest = {t: cones[-LATEST:] for t, cones in rest.items()}
        found |= odd_echoes(
            {t: heard for t, cones in rest.items() if (heard := echo_health(cones))}
        )
        for pings in (latest, rest):
            receivers = {t: own for t, cones in pings.items() if (own := receiver_health(cones))}
            found |= odd_receivers(receivers)
        return found


def _cleared(screened: Mapping[str, Finding]) -> dict[str, Finding]:
    """The same, with nobody suspected any more."""
    return {
        topic: replace(finding, verdict="healthy", reason="") if finding.is_suspect else finding
        for topic, finding in screened.items()
    }


def is_of(topic: str, names: Iterable[str]) -> bool:
    """Whether a topic is among some names, each of a topic or of the robot whose it is."""
    path = topic.strip("/") + "/"
    return any(path.startswith(name.strip("/") + "/") for name in names if name.strip("/"))


def _has_moved(before: EchoCone, after: EchoCone) -> bool:
    way_m, turn_rad = way_between(before.pose, after.pose)
    return way_m > MOVED_M or turn_rad > MOVED_RAD


def _is_repetition(before: EchoCone, after: EchoCone) -> bool:
    return np.array_equal(before.ranges_m, after.ranges_m) and np.array_equal(
        before.amplitudes, after.amplitudes
    )
