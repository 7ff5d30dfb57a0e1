"""Who is elsewhere than it says, by whether others hear the landmarks that it hears.

A robot that is shifted as a whole hears landmarks that agree with one another.  Others, who look at
the same, or did before, hear them elsewhere, all of them shifted alike.
"""

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
#: Gain of a shift, of which what others bear out as it is told is taken off so many times, and
#: what they do as a share of what they would; the least shift, m, more than a column is across, of
#: which either hears another side; how well somebody else must bear out the one who is right of
#: two; and all of them the one who is elsewhere, there.
LEAST_GAIN, TIMES_TOLD, MOST_SHARE, LEAST_M, BORNE_OUT = 28.0, 2.0, 0.35, 0.5, 4.0
LEAST_THERE = 8.0
#: How much others must contradict one where it says it is, and gain that does if they do not: of
#: one who is alone there nobody knows anything, and its walls fit others' somewhere (up to 58).
LEAST_AGAINST, GAIN_ALONE = 6.0, 70.0
#: Share of what others bear out of a robot elsewhere that they do where it says it is, for it to be
#: there; and of the gain of a shift, from which on one other robot alone makes it.
HERE, MOSTLY = 0.5, 0.7


class RobotPairs:
    """What each two robots bear out of each other, were one of them elsewhere.

    Parameters
    ----------
    robots : mapping of str to Robot
        All of them, by their latest pings.
    earlier : callable
        Gives the same by pings before these, of those who have enough: they count where the latest
        ones of the others do not show that a robot is where it says it is.
    between : callable
        Called between pieces of work.

    Attributes
    ----------
    names : list of str
        Theirs.
    """

    def __init__(
        self,
        robots: Mapping[str, Robot],
        earlier: Callable[[], Mapping[str, Robot]],
        between: Callable[[], None],
    ) -> None:
        self.names = sorted(robots)
        self._said: dict[tuple[str, str], FloatArray] = {}
        for number, one in enumerate(self.names):
            for other in self.names[:number]:
                between()
                self._said[one, other] = said = _borne_out(robots[one], robots[other])
                # The places are the same the other way around, but for where it is told.
                self._said[other, one] = np.append(said[0], said[:0:-1])
        unshown = [name for name in self.names if not self.is_borne_out(name, share=HERE)]
        before = earlier() if unshown else {}
        for one in unshown:
            for other in before.keys() & robots.keys() - {one}:
                between()
                self._said[one, other] = self._said[one, other] + _borne_out(
                    robots[one], before[other]
                )

    def shift(self, name: str) -> Displacement | None:
        """How a robot is shifted by what others hear, if they hear it."""
        said = [self._said[name, other] for other in self.names if other != name]
        total = np.sum(said, axis=0) if said else np.zeros(len(SHIFTS_M))
        best = int(total.argmax())
        gain, told = float(total[best] - total[0]), float(total[0])
        size_m = float(np.hypot(*SHIFTS_M[best]))
        least = LEAST_GAIN if told <= -LEAST_AGAINST else GAIN_ALONE
        is_sure = gain - TIMES_TOLD * told >= least and told <= MOST_SHARE * total[best]
        # At the edge nothing but parallel walls may say where it ends.
        is_inside = float(np.abs(SHIFTS_M[best]).max()) < STEPS_M[-2]
        # Who is deaf is contradicted everywhere, and borne out nowhere.
        is_there = is_inside and size_m >= LEAST_M and total[best] >= LEAST_THERE
        if not (is_sure and is_there):
            return None
        x_m, y_m = (-SHIFTS_M[best]).tolist()
        return Displacement("moved", (x_m, y_m), gain, told)

    def made_by(self, shift: Displacement, name: str) -> list[str]:
        """Who alone makes most of the gain of a robot's shift."""
        there = int(np.argmin(np.hypot(*(SHIFTS_M + np.array(shift.error)).T)))
        return [
            other
            for other in self.names
            if other != name
            and self._said[name, other][there] - self._said[name, other][0] > MOSTLY * shift.gain
        ]

    def is_borne_out(self, name: str, but_by: str = "", share: float = 0.0) -> bool:
        """Whether anybody but one bears a robot out where it says it is.

        At the least by such a share of what it would elsewhere.
        """
        others = [other for other in self.names if other != but_by]
        said = [self._said[name, other] for other in others if (name, other) in self._said]
        return any(one[0] >= max(BORNE_OUT, share * one.max()) for one in said)


def shifted(pairs: RobotPairs) -> dict[str, Finding]:
    """Who is elsewhere; or who may be, where nobody can tell which of them is.

    Parameters
    ----------
    pairs : RobotPairs
        Of all in whom nothing else is wrong.
    """
    suspects = {name: shift for name in pairs.names if (shift := pairs.shift(name))}
    if not suspects:
        return {}
    worst = max(suspects, key=lambda name: suspects[name].gain)
    if pairs.is_borne_out(worst, share=MOST_SHARE):
        return {}
    # Either of two is elsewhere, by what they alone say of each other.
    accusers = {*suspects, *pairs.made_by(suspects[worst], worst)} - {worst}
    rivals = sorted(name for name in accusers if not pairs.is_borne_out(name, worst, MOST_SHARE))
    if not rivals:
        return {worst: suspects[worst].finding()}
    return {
        name: _or_another(
            suspects.get(name, _opposite(suspects[worst])).finding(),
            sorted({worst, *rivals} - {name}),
        )
        for name in (worst, *rivals)
    }


def _borne_out(one: Robot, other: Robot) -> FloatArray:
    """What two robots bear out of each other, were the first one elsewhere."""
    said = np.zeros(len(SHIFTS_M))
    borne_out(one.landmarks, other.heard, SHIFTS_M, said)
    borne_out(other.landmarks, one.heard, -SHIFTS_M, said)
    return said


def _opposite(shift: Displacement) -> Displacement:
    """That of one who is right if somebody else is not shifted."""
    return replace(shift, error=tuple(-by_m for by_m in shift.error))


def _or_another(finding: Finding, others: list[str]) -> Finding:
    """The same of one of several, of whom nobody else can tell which it is."""
    reason = finding.reason.removeprefix("misplaced: ")
    return replace(
        finding,
        verdict="contradicted",
        reason=f"contradicted: {reason}; or {' or '.join(others)} is misplaced",
    )
