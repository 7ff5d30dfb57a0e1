"""What is wrong with where a robot says its pings are from, by what would make its echoes meet.

Echoes of several pings meet in points and walls if ranges and poses are right.  They do so far
better with its heading turned, its poses later or its ranges scaled if it is that which is wrong.
Of a shift nothing shows but in what others hear, see `shifts`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from usmap_ros.mapping.robot_check.borne_out import borne_out
from usmap_ros.mapping.robot_check.finding import Finding
from usmap_ros.mapping.robot_check.landmark_search import MOST, explain, explained_by
from usmap_ros.mapping.robot_check.landmarks import COLUMNS, KIND, POINT, A, B
from usmap_ros.mapping.robot_check.sightings import RobotTrack, Sightings
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.geometry import wrapped
from usmap_ros.pings.cone import EchoCone
from usmap_ros.processes.threads import for_each

#: What is tried: turns (rad), times by which poses are late (s), and what ranges are over those
#: that are told; and steps of the first two around the best of them.
TURNS_RAD = tuple(math.radians(by) for by in (*range(-160, -10, 20), *range(20, 190, 20)))
LATE_S = (-1.0, -0.5, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0)
SCALES = (0.93, 0.95, 0.97, 1.0, 1.03, 1.05, 1.07)
CLOSER_RAD, CLOSER_S = math.radians(5.0), 0.1
#: Turns that are so far from the best one must be worse; and so many parts of a robot's way must
#: gain so much in sum, each by itself, by a turn or a delay: a few walls, met from a few places,
#: fit others by chance.
#: Not if as much is gained as all that the echoes are explained as told, where those of a part are
#: too far apart: of 256 healthy robots 0.4 of it was gained at the most.
ELSEWHERE_RAD = math.radians(60.0)
PARTS, LEAST_IN_PARTS = 3, 8.0
#: Gain of log-likelihood from which on it is that which is wrong, and a share of what the echoes
#: as told gain that must be exceeded as well; and the least errors that are told of.
LEAST_GAIN, LEAST_SHARE = 20.0, 0.05
#: Share of the former from which on a delay's gain is worked out with landmarks of its own.
WORTH_A_LOOK = 0.5
LEAST_TURN_RAD, LEAST_LATE_S = math.radians(12.0), 0.2
#: For ranges the gain times the share that they are too long by must exceed this, since what is
#: hardly wrong fits by chance; more where more echoes a metre are unexplained than so many, and so
#: many times if ranges are too short, or best multiplied by less than so much.  1,440 healthy
#: robots, of three each, came to 0.51 at the most, 224 of two to 0.66, to half of what is asked
#: if ranges are too short, and with poses off by 3 cm to 1.5 at 0.925.  Steps around the best.
LEAST_WRONG_GAIN, DENSE, TIMES_IF_ODD, LEAST_USUAL_SCALE = 0.7, 0.6, 3.0, 0.935
CLOSER_SCALE = (0.01, 0.005, 0.0025)
#: The same for turns and delays with what others hear of it, which may speak against them: more
#: where more is unexplained, of which chance makes as much as the root of it.
LEAST_GAIN_OF_ALL = 30.0
#: And of all that the echoes as told gain, of which most is chance where walls reverberate and
#: robots look one way: healthy ones gained 0.34 of it by a turn, with what others said of that, and
#: 0.13 by a scale, or 0.27 by an odd one; others whose ranges were 5 % too long 0.16 at the least.
SHARE_OF_ALL, SHARE_OF_SCALED = 0.08, 0.12


@dataclass(frozen=True)
class Displacement:
    """What would make a robot's echoes meet."""

    #: ``turned``, ``late``, ``scaled`` or ``moved``.
    kind: Literal["turned", "late", "scaled", "moved"]
    #: Of heading (rad), of stamps (s), of ranges (a share of them), or of place (m, east and
    #: north).
    error: tuple[float, ...]
    #: By how much likelier its echoes are without it.
    gain: float
    #: By how much likelier they are by landmarks as they are told.
    told: float

    def finding(self) -> Finding:
        """What is to be said of the robot."""
        evidence = {"gain": self.gain, "told": self.told}
        size = self.error[0]
        if self.kind == "turned":
            evidence["turned_rad"] = size
            how = f"it faces {math.degrees(size):+.0f}° from where it does"
        elif self.kind == "late":
            evidence["late_s"] = size
            how = f"its poses are {abs(size):.1f} s {'late' if size > 0.0 else 'early'}"
        elif self.kind == "scaled":
            evidence["scaled"] = size
            how = f"its ranges are {abs(size):.0%} too {'long' if size > 0.0 else 'short'}"
        else:
            evidence |= {"east_m": size, "north_m": self.error[1]}
            how = f"it is {math.hypot(*self.error):.1f} m off ({size:+.1f}, {self.error[1]:+.1f})"
        whose = "others'" if self.kind == "moved" else "its own"
        reason = f"misplaced: by {whose} echoes {how}"
        return Finding("misplaced", dict(evidence), reason)


class Robot:
    """A robot's echoes, and the landmarks that they show.

    Parameters
    ----------
    cones : sequence of EchoCone
        Its pings.
    heard : Sightings
        The same.
    """

    def __init__(self, cones: Sequence[EchoCone], heard: Sightings) -> None:
        self.heard, self._way = heard, RobotTrack(cones, heard)
        self._every = np.ones(len(heard.ping), np.bool_)
        self.told, self.landmarks = self._explained(heard)

    def displacement(self) -> Displacement | None:
        """What is wrong with its poses or ranges, if that shows."""
        turned, late = self._best_turn(), self._best_delay()
        best = turned if turned.gain > late.gain else late
        size = abs(best.error[0])
        least = LEAST_TURN_RAD if best is turned else LEAST_LATE_S
        is_sure = best.gain >= LEAST_GAIN + LEAST_SHARE * self.told and size >= least
        if is_sure and best.gain < self.told:
            is_sure = self._gain_in_parts(best) >= LEAST_IN_PARTS
        return best if is_sure else None

    def is_borne_out(self, wrong: Displacement, robots: Iterable[Robot]) -> bool:
        """Whether what others hear does not speak against a turn or a delay by which it gains."""
        right, _ = self._without(wrong)
        landmarks, gain = self._explained(right)[1], wrong.gain
        for other in robots:
            if other is not self:
                gain += _agreement(other.landmarks, right) - _agreement(other.landmarks, self.heard)
                gain += _agreement(landmarks, other.heard)
                gain -= _agreement(self.landmarks, other.heard)
        least = LEAST_GAIN_OF_ALL * math.sqrt(max(1.0, self.heard.background / DENSE))
        return gain >= least + SHARE_OF_ALL * self.told

    def _best_turn(self) -> Displacement:
        gains = {by: self._gain_of_turn(by) for by in TURNS_RAD}
        for _ in range(2):
            middle = max(gains, key=gains.__getitem__)
            for by in (middle - CLOSER_RAD, middle + CLOSER_RAD):
                gains[by] = self._gain_of_turn(by)
        best = max(gains, key=gains.__getitem__)
        # Where surfaces fit anything, other turns do nearly as well.
        others = (
            gain for by, gain in gains.items() if math.cos(by - best) < math.cos(ELSEWHERE_RAD)
        )
        gain = gains[best] - max(0.0, *others)
        return Displacement("turned", (-best,), gain, self.told)

    def _gain_of_turn(self, by_rad: float) -> float:
        return self._explained(self._turned(by_rad), least=self.told)[0] - self.told

    def _gain_in_parts(self, wrong: Displacement) -> float:
        """What landmarks that each part of its way shows by itself gain without it, in sum."""
        right, wanted = self._without(wrong)
        part = PARTS * self.heard.ping // len(self.heard.x_m)
        return sum(
            self._explained(right, wanted & (part == one))[0]
            - self._explained(self.heard, wanted & (part == one))[0]
            for one in range(PARTS)
        )

    def _without(self, wrong: Displacement) -> tuple[Sightings, BoolArray]:
        """What it heard without a turn or a delay, and which echoes are of poses that are known."""
        if wrong.kind == "late":
            later, known = self._way.later(wrong.error[0])
            return later, known[self.heard.ping]
        return self._turned(-wrong.error[0]), self._every

    def _turned(self, by_rad: float) -> Sightings:
        return self.heard._replace(yaw_rad=wrapped(self.heard.yaw_rad + by_rad))

    def _best_delay(self) -> Displacement:
        gains = {by: self._gain_of_delay(by) for by in LATE_S}
        middle = max(gains, key=gains.__getitem__)
        for by in (middle - CLOSER_S, middle + CLOSER_S):
            gains[by] = self._gain_of_delay(by)
        best = max(gains, key=gains.__getitem__)
        return Displacement("late", (best,), gains[best], self.told)

    def _gain_of_delay(self, by_s: float) -> float:
        later, known = self._way.later(by_s)
        wanted = known[self.heard.ping]
        told = explained_by(self.landmarks, self.heard, wanted)
        gain = self._explained(later, wanted, told)[0] - told
        if gain < WORTH_A_LOOK * LEAST_GAIN:
            return gain
        # Without the pings that are left out other landmarks are found, and explain more or less.
        return gain + told - self._explained(self.heard, wanted)[0]

    def scaling(self, robots: Iterable[Robot]) -> Displacement | None:
        """What is wrong with its ranges by its own echoes and by what others hear.

        What landmarks are found varies by chance: those found at each scale are tried at all.
        """
        others, found = [robot for robot in robots if robot is not self], {1.0: self.landmarks}

        def said(scales: Iterable[float]) -> dict[float, tuple[float, float]]:
            """What its own echoes and the others' say of scales."""
            heard = {scale: self._scaled(scale) for scale in scales}
            found.update({s: self._explained(heard[s])[1] for s in scales if s not in found})
            return {scale: self._said_of(heard[scale], scale, found, others) for scale in scales}

        gains = said(SCALES)
        for step in CLOSER_SCALE:
            best = max(gains, key=lambda scale: sum(gains[scale]))
            if best == 1.0:
                return None
            gains |= said((best - step, best + step))
        best = max(gains, key=lambda scale: sum(gains[scale]))
        # Once more, now that landmarks of all scales are found.
        gains = said((1.0, best))
        gained = np.subtract(gains[best], gains[1.0])
        error = scale_error(best, gained, self.heard.background, self.told)
        return error and Displacement("scaled", error[:1], error[1], self.told)

    def _said_of(
        self,
        heard: Sightings,
        scale: float,
        found: Mapping[float, FloatArray],
        others: Iterable[Robot],
    ) -> tuple[float, float]:
        """What its own echoes say of a scale, by landmarks found at several, and what others do."""
        sets = [self._spread(marks, scale / other) for other, marks in found.items()]
        own = max(explained_by(marks, heard, self._every) for marks in sets)
        theirs = 0.0
        for other in others:
            theirs += _agreement(other.landmarks, heard)
            theirs += max(_agreement(marks, other.heard) for marks in sets)
        return own, theirs

    def _scaled(self, factor: float) -> Sightings:
        return self.heard._replace(range_m=factor * self.heard.range_m)

    def _spread(self, marks: FloatArray, factor: float) -> FloatArray:
        """Landmarks as they would be found if ranges were so much longer."""
        spread = marks.copy()
        x_m, y_m = float(self.heard.x_m.mean()), float(self.heard.y_m.mean())
        is_point = marks[:, KIND] == POINT
        spread[is_point, A] += (factor - 1.0) * (marks[is_point, A] - x_m)
        spread[is_point, B] += (factor - 1.0) * (marks[is_point, B] - y_m)
        walls = marks[~is_point]
        far_m = walls[:, B] - np.cos(walls[:, A]) * x_m - np.sin(walls[:, A]) * y_m
        spread[~is_point, B] += (factor - 1.0) * far_m
        return spread

    def _explained(
        self, heard: Sightings, wanted: BoolArray | None = None, least: float = -math.inf
    ) -> tuple[float, FloatArray]:
        """Log-likelihood ratio of echoes by landmarks, and these; it may be given up as `least`."""
        found = np.zeros((MOST, COLUMNS))
        gain, count = explain(heard, self._every if wanted is None else wanted, found, least)
        return gain, found[:count]


def scale_error(
    scale: float, gains: FloatArray, background: float, told: float
) -> tuple[float, float] | None:
    """By what share ranges are too long, and what is gained without it, if that is sure.

    Parameters
    ----------
    scale : float
        What they are best multiplied by.
    gains : (2,) array
        Of log-likelihood: of a robot's own echoes, and of others' landmarks.
    background : float
        Echoes a metre that nothing known explains.
    told : float
        What the echoes as told gain by landmarks.
    """
    own, gain, size = float(gains[0]), float(gains.sum()), 1.0 / scale - 1.0
    # Round columns answer from in front of the point that they seem to be, and what is not exact
    # fits as well what is far nearer.
    times = 1.0 if LEAST_USUAL_SCALE <= scale <= 1.0 else TIMES_IF_ODD
    is_much = gain * abs(size) >= times * LEAST_WRONG_GAIN * max(1.0, background / DENSE)
    is_much = is_much and gain >= times * SHARE_OF_SCALED * told
    return (size, gain) if own >= 0.0 and is_much else None


def _agreement(marks: FloatArray, heard: Sightings) -> float:
    said = np.zeros(1)
    borne_out(marks, heard, np.zeros((1, 2)), said)
    return float(said[0])


def displaced(robots: Mapping[str, Robot]) -> dict[str, Finding]:
    """Those whose echoes say so, unless most do: then it is something that all have in common.

    Parameters
    ----------
    robots : mapping of str to Robot
        All that can be asked.
    """
    alone = for_each(Robot.displacement, robots.values())
    found = {
        name: own
        for (name, robot), own in zip(robots.items(), alone, strict=True)
        if own and robot.is_borne_out(own, robots.values())
    }
    left = {name: robot for name, robot in robots.items() if name not in found}
    together = for_each(lambda robot: robot.scaling(left.values()), left.values())
    scaled = {name: own for name, own in zip(left, together, strict=True) if own}
    if scaled:
        # Beside one whose ranges are too long those of others seem too short.
        worst = max(scaled, key=lambda name: scaled[name].gain)
        found[worst] = scaled[worst]
    return (
        {name: own.finding() for name, own in found.items()}
        if 2 * len(found) <= len(robots)
        else {}
    )
