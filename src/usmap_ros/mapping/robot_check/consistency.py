"""Which robots' echoes contradict the map that all the others make.

A robot that is stuck repeats itself while it moves.  One that is deaf hears less than the others
would, one that is loud more, one that is noisy what is not there.  The echoes of one that is
misplaced meet if it faces elsewhere than it says, was there earlier or hears from less far, or
others hear the same elsewhere; or they fit what the others' map expects of it no better than they
fit the same shifted in range.  A liar spoils the map that all are compared with, so that others
contradict it: it is the one without which the rest agree.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from usmap_ros.mapping.common_error import NO_ERROR, common_error, without_error
from usmap_ros.mapping.joint.kept_pings import REMEMBERED
from usmap_ros.mapping.joint.leave_one_out import LeaveOneOutMap
from usmap_ros.mapping.pose_delay import PoseTracks
from usmap_ros.mapping.robot_check.comparison import (
    EARLIER_PINGS,
    LEAST_ROBOTS_LEFT,
    RobotComparison,
)
from usmap_ros.mapping.robot_check.confirmation import is_there
from usmap_ros.mapping.robot_check.displacement import Robot, displaced
from usmap_ros.mapping.robot_check.echo_health import (
    EchoHealth,
    echo_health,
    heard_louder,
    odd_echoes,
)
from usmap_ros.mapping.robot_check.finding import Finding
from usmap_ros.mapping.robot_check.receiver_health import odd_receivers, receiver_health
from usmap_ros.mapping.robot_check.shifts import RobotPairs, shifted
from usmap_ros.mapping.robot_check.sightings import sightings_of
from usmap_ros.numerics.geometry import way_between
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.range_cones import report_first_only
from usmap_ros.processes.threads import for_each

#: Each robot is judged by its latest pings, and of those before them so many, spread evenly, bear
#: witness apart from them, if there are that many: one that fails on the way contradicts itself,
#: and one that is mended does no more.
LATEST, EARLIER = 60, 40
#: A robot has moved, between one ping and the next, from so far on.
MOVED_M, MOVED_RAD = 0.01, 0.01
#: Pings with echoes from a robot that moves that are needed to say that it repeats itself, and the
#: share of them that must be repetitions to the last digit, which noise never makes.
LEAST_REPEATS, REPEATED_SHARE = 10, 0.5


class _Robot:
    """What is remembered of one robot."""

    def __init__(self) -> None:
        self.cones: deque[EchoCone] = deque(maxlen=REMEMBERED)
        self.repeats: deque[bool] = deque(maxlen=LATEST)
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

    def __getstate__(self) -> dict[str, Any]:
        """All of it; as a function of ours, it lets other threads go on between two robots."""
        return vars(self)

    def latest(self) -> list[EchoCone]:
        """Pings by which it is judged."""
        return list(self.cones)[-LATEST:]

    def earlier(self) -> list[EchoCone]:
        """Some of those before them; none if there are too few."""
        before = list(self.cones)[:-LATEST]
        places = np.linspace(0, len(before) - 1, EARLIER if len(before) >= EARLIER else 0)
        return [before[int(place)] for place in places]

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

    def findings(self) -> dict[str, Finding]:
        """Judge every robot, by topic.

        Echoes alone tell much, without a map.  Then comes a screen on the common map; what it finds
        is confirmed on a map that the suspect has no part in.  Then the others are judged again
        without it, for it has spoilt what they are compared with.
        """
        robots = self._alike()
        sources = {topic: robot.latest() for topic, robot in robots.items()}
        if len(robots) > LEAST_ROBOTS_LEFT:
            earlier = {t + EARLIER_PINGS: robot.earlier() for t, robot in robots.items()}
            sources |= {name: cones for name, cones in earlier.items() if cones}
        found = self._stuck()
        found |= _by_themselves({name: own for name, own in sources.items() if name not in found})
        latest = {t: robot.latest() for t, robot in robots.items() if t not in found}
        heard = _heard(latest)
        found |= self._confirmed(displaced(heard), heard, robots)
        judged = {topic: own for topic, own in heard.items() if topic not in found}
        before = {topic: sources.get(topic + EARLIER_PINGS, []) for topic in judged}
        pairs = RobotPairs(judged, lambda: _heard(before))
        moved = self._confirmed(shifted(pairs), judged, robots)
        found |= {topic: finding for topic, finding in moved.items() if finding.is_suspect}
        while True:
            left = {name: cones for name, cones in sources.items() if name not in found}
            count = len(left.keys() & self._robots.keys())
            if count < 2:
                return self._of_robots(dict.fromkeys(left, Finding("unknown", {})) | found)
            comparison = RobotComparison(self._parameters, left)
            screened = comparison.screen()
            # Two that are left after a liar spoilt the map cannot tell which of them is wrong.
            can_tell = not found or count > LEAST_ROBOTS_LEFT
            named = comparison.culprits(screened) if can_tell else {}
            # Whose landmarks others hear where it says they are is there, whatever cells say.
            named = {
                topic: finding
                for topic, finding in named.items()
                if finding.verdict != "misplaced" or not pairs.is_borne_out(topic)
            }
            if not named:
                return self._of_robots(_cleared(screened) | moved | found)
            found |= named

    def _confirmed(
        self, accused: Mapping[str, Finding], among: Iterable[str], robots: Mapping[str, _Robot]
    ) -> dict[str, Finding]:
        """The same, without suspects who are where they say by the map of those not accused."""
        if not any(finding.is_suspect for finding in accused.values()):
            return dict(accused)
        others = {topic: list(robots[topic].cones) for topic in among if topic not in accused}
        apart = LeaveOneOutMap(others, self._parameters)
        return {
            topic: finding
            for topic, finding in accused.items()
            if not (finding.is_suspect and is_there(robots[topic].latest(), apart, finding))
        }

    def _alike(self) -> dict[str, _Robot]:
        """Robots without what is wrong with all of them: none is to be blamed for that."""
        if not self._parameters.correct_common_errors:
            return self._robots
        pings = [(cone, topic) for topic, robot in self._robots.items() for cone in robot.cones]
        first_only = report_first_only(cone for cone, _ in pings)
        pings = [ping for ping in pings if ping[0].child_frame_id not in first_only]
        tracks = PoseTracks(pings)
        error = common_error(pings, tracks)
        if error == NO_ERROR:
            return self._robots
        robots = {topic: robot.copy() for topic, robot in self._robots.items()}
        for topic, robot in robots.items():
            for place, cone in enumerate(robot.cones):
                if cone.child_frame_id not in first_only:
                    robot.cones[place] = without_error(cone, topic, error, tracks)
        # Their landmarks tell more closely whether all of them are better without it.
        told, without = (_told(each) for each in (self._robots, robots))
        return robots if without >= told else self._robots

    def _stuck(self) -> dict[str, Finding]:
        """Those who repeat themselves while they move."""
        found: dict[str, Finding] = {}
        for topic, robot in self._robots.items():
            share = robot.repeated()
            if share > REPEATED_SHARE:
                reason = f"{share:.0%} of its pings repeat the one before though it has moved"
                found[topic] = Finding("stuck", {"repeated": share}, f"stuck: {reason}")
        return found

    def _of_robots(self, found: Mapping[str, Finding]) -> dict[str, Finding]:
        """What is to be said of robots, and not of their earlier pings."""
        return {topic: found[topic] for topic in sorted(self._robots)}


def _heard(sources: Mapping[str, list[EchoCone]]) -> dict[str, Robot]:
    """Landmarks of those who heard any, if they are to be compared with anybody."""
    if len(sources) < LEAST_ROBOTS_LEFT:
        return {}
    heard = {t: own for t, cones in sources.items() if (own := sightings_of(cones)) is not None}
    robots = for_each(lambda topic: Robot(sources[topic], heard[topic]), heard)
    return dict(zip(heard, robots, strict=True))


def _told(robots: Mapping[str, _Robot]) -> float:
    """What landmarks make of all that robots heard last, of log-likelihood."""
    heard = _heard({topic: robot.latest() for topic, robot in robots.items()})
    return sum(own.told for own in heard.values())


def _by_themselves(sources: Mapping[str, list[EchoCone]]) -> dict[str, Finding]:
    """Those who are found without a map, which they would spoil."""
    healths = {name: echo_health(cones) for name, cones in sources.items()}
    heard = {name: own for name, own in healths.items() if own}
    odd = odd_echoes(heard)
    found = {name: own for name, own in odd.items() if not _heard_before(name, own, heard, odd)}
    receivers = {name: receiver_health(cones) for name, cones in sources.items()}
    return found | odd_receivers({name: own for name, own in receivers.items() if own})


def _heard_before(
    name: str,
    own: Finding,
    heard: Mapping[str, EchoHealth],
    odd: Collection[str],
) -> bool:
    """Whether earlier pings show that a robot is where there is little to be heard, or quiet.

    Then what others expect there tells.
    """
    before = name + EARLIER_PINGS
    if own.verdict == "deaf":
        return before in heard and before not in odd
    is_clipped = own.verdict == "clipped" and before in heard
    return is_clipped and heard_louder(heard[before], heard[name])


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
