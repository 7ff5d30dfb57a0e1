"""Who is elsewhere than it says, by whether others hear the landmarks that it hears.

A robot that is shifted as a whole hears landmarks that agree with one another.  Others, who look at
the same, or did before, hear them elsewhere, all of them shifted alike.
"""

import math
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from usmap_ros.mapping.robot_check.borne_out import borne_out
from usmap_ros.mapping.robot_check.displacement import Displacement, Robot
from usmap_ros.mapping.robot_check.finding import Finding
from usmap_ros.numerics.arrays import FloatArray

#: Places that are tried, m: where it is told first.
STEPS_M = np.linspace(-1.5, 1.5, 41)
SHIFTS_M = np.array([(0.0, 0.0), *((x_m, y_m) for x_m in STEPS_M for y_m in STEPS_M)])
#: And around the best of them, one step after the other.
AROUND = np.array([(x, y) for x in range(-3, 4) for y in range(-3, 4)], float)
CLOSER_M = (0.0125, 0.004)
#: Gain of a shift that others contradict, of whom what they say of it where it is told is taken
#: off so many times; how much that must be; and gain of one that they do not contradict: a healthy
#: one gained 69 where walls reverberate.
LEAST_GAIN, TIMES_TOLD, LEAST_AGAINST, GAIN_ALONE = 48.0, 2.0, 6.0, 72.0
#: The least shift, m, more than a column is across, of which either hears another side; and how
#: well others must bear out the one who is shifted, there.
LEAST_M, LEAST_THERE = 0.5, 8.0
#: Gain over that of anybody else's being shifted instead.  What walls of two that fit somewhere
#: gain, the other one gains as well by the opposite shift: only a third one tells which of them.
MARGIN = 10.0
#: How well others must bear out a robot where it says it is, for it to be there; and as a share of
#: what they would elsewhere.
BORNE_OUT, HERE = 4.0, 0.4


class RobotPairs:
    """What each two robots bear out of each other, were one of them elsewhere.

    Parameters
    ----------
    robots : mapping of str to Robot
        All of them, by their latest pings.
    earlier : callable
        Gives the same by pings before these, of those who have enough: they count where the latest
        ones of the others do not show that a robot is where it says it is.

    Attributes
    ----------
    names : list of str
        Theirs.
    """

    def __init__(
        self,
        robots: Mapping[str, Robot],
        earlier: Callable[[], Mapping[str, Robot]],
    ) -> None:
        self.names = sorted(robots)
        # What each of the others bears out of a robot, by where it is.
        self._said: dict[str, dict[str, FloatArray]] = defaultdict(dict)
        # What is said of a robot in any place: pairs, and whether it is the first of the two.
        self._pairs: dict[str, list[tuple[Robot, Robot, float]]] = {n: [] for n in self.names}
        for number, one in enumerate(self.names):
            for other in self.names[:number]:
                self._add(one, other, robots[one], robots[other])
        unshown = [name for name in self.names if not self.is_borne_out(name)]
        before = earlier() if unshown else {}
        for one in unshown:
            for other in sorted(before.keys() & robots.keys() - {one}):
                self._add(one, other, robots[one], before[other])

    def _add(self, one: str, other: str, first: Robot, second: Robot) -> None:
        """Add what two bear out of each other, were the first one elsewhere, or else the other."""
        said = _borne_out(first, second, SHIFTS_M)
        self._pairs[one].append((first, second, 1.0))
        self._pairs[other].append((first, second, -1.0))
        # The places are the same the other way around, but for where it is told.
        opposite = np.append(said[0], said[:0:-1])
        for name, by, more in ((one, other, said), (other, one, opposite)):
            self._said[name][by] = self._said[name].get(by, 0.0) + more

    def shift(self, name: str) -> Displacement:
        """How a robot would most likely be shifted by what others hear."""
        total = sum(self._said[name].values(), start=np.zeros(len(SHIFTS_M)))
        told, there, best_m = float(total[0]), float(total.max()), SHIFTS_M[int(total.argmax())]
        for step_m in CLOSER_M if best_m.any() else ():
            near_m = best_m + step_m * AROUND
            pairs = self._pairs[name]
            total = sum(
                (_borne_out(one, other, by * near_m) for one, other, by in pairs),
                start=np.zeros(len(near_m)),
            )
            there, best_m = float(total.max()), near_m[int(total.argmax())]
        x_m, y_m = (-best_m).tolist()
        return Displacement("moved", (x_m, y_m), there - told, told)

    def is_borne_out(self, name: str) -> bool:
        """Whether anybody bears a robot out where it says it is."""
        said = self._said[name].values()
        return any(each[0] >= max(BORNE_OUT, HERE * each.max()) for each in said)


def is_sure(shift: Displacement) -> bool:
    """Whether a robot is shifted, if nobody else is."""
    gain, told, size_m = shift.gain, shift.told, math.hypot(*shift.error)
    if told <= -LEAST_AGAINST:
        is_much = gain - TIMES_TOLD * told >= LEAST_GAIN
    else:
        is_much = gain - max(told, 0.0) >= GAIN_ALONE
    # At the edge nothing but parallel walls may say where it ends.
    is_inside = max(map(abs, shift.error)) < STEPS_M[-2]
    # Who is deaf is contradicted everywhere, and borne out nowhere.
    return is_much and is_inside and size_m >= LEAST_M and told + gain >= LEAST_THERE


def shifted(pairs: RobotPairs) -> dict[str, Finding]:
    """Who is elsewhere; or who may be, where nobody can tell which of them is.

    Parameters
    ----------
    pairs : RobotPairs
        Of all in whom nothing else is wrong.
    """
    shifts = {name: pairs.shift(name) for name in pairs.names}
    suspects = [name for name, shift in shifts.items() if is_sure(shift)]
    if not suspects:
        return {}
    worst = max(suspects, key=lambda name: shifts[name].gain)
    least = shifts[worst].gain - MARGIN
    rivals = sorted(name for name, shift in shifts.items() if shift.gain > least)
    if rivals == [worst]:
        return {worst: shifts[worst].finding()}
    return {
        name: _or_another(shifts[name].finding(), [other for other in rivals if other != name])
        for name in rivals
    }


def _borne_out(one: Robot, other: Robot, shifts_m: FloatArray) -> FloatArray:
    """What two robots bear out of each other, were the first one elsewhere."""
    said = np.zeros(len(shifts_m))
    borne_out(one.landmarks, other.heard, shifts_m, said)
    borne_out(other.landmarks, one.heard, -shifts_m, said)
    return said


def _or_another(finding: Finding, others: list[str]) -> Finding:
    """The same of one of several, of whom nobody else can tell which it is."""
    reason = finding.reason.removeprefix("misplaced: ")
    return replace(
        finding,
        verdict="contradicted",
        reason=f"contradicted: {reason}; or {' or '.join(others)} is misplaced",
    )
