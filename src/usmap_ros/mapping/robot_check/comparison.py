"""Who is wrong, of robots that contradict one another: a screen, and maps without the suspects."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace

import numpy as np

from usmap_ros.mapping.joint.leave_one_out import LeaveOneOutMap
from usmap_ros.mapping.joint.witnesses import MutualEvidence, credit
from usmap_ros.mapping.robot_check.agreement import LEAST_PINGS, Agreement, agreement
from usmap_ros.mapping.robot_check.finding import Finding, Verdict
from usmap_ros.mapping.robot_check.receiver_health import FEW_ECHOES
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

#: Amplitudes beyond this difference from the others' are odd: what smooth walls return, to one
#: robot squarely and to another not, differs by up to 12 dB.
ODD_LOUDNESS_DB = 15.0
#: Echoes where the map expects them that are needed to judge loudness: of others, and of the robot
#: in question. Eight of a healthy one were 18 dB louder, among walls that others struck askew.
LEAST_MATCHES, LEAST_OWN_MATCHES = 4, 12
#: Once a robot has been named, so many others can name nobody else.
LEAST_ROBOTS_LEFT = 2
#: `Agreement.fit`, relative to the median of the others, below which somebody is misplaced, and
#: below which a robot is, by a map that it has no part in; most that is asked of anybody then.
SUSPECT_FIT, MISPLACED_FIT, USUAL_FIT = 0.6, 0.4, 1.0
#: Who hears such a share of what the others' map expects is where it says it is, whatever it hears
#: besides: where walls reverberate, that is most.
HEARD_HERE = 0.9
#: So many robots, those that fit worst, are left out by turns; and those are named without whom the
#: others agree nearly as well as without anybody.
MOST_LEFT_OUT, AGREED = 4, 0.8
#: Share of what others bear out of any other robot's word, above which nobody is accused.
LESS = 0.88
#: The same for who is accused by that alone: healthy ones among walls that reverberate have half.
FAR_LESS = 0.4
#: Share of the others' words that is borne out where anybody can be accused by how little of its
#: own is: where they hardly agree with one another, nobody's word tells anything.
LEAST_USUAL = 0.3
#: Evidence that a robot and others must have of the same cells, for it to be accused by that: among
#: smooth walls it is that of a few cells, which each of them strikes from another side.
LEAST_SAID = 250.0
#: Share of its own word that a robot bears out where it does not contradict itself.
ITSELF = 0.9
#: What follows a robot's topic in the name of its earlier pings.
EARLIER_PINGS = " earlier"


def robot_of(name: str) -> str:
    """Whose pings they are, earlier ones or not."""
    return name.removesuffix(EARLIER_PINGS)


class RobotComparison:
    """Judges robots by what they have heard, and by maps that some of them have no part in.

    Parameters
    ----------
    parameters : MappingParameters
        Of the maps.
    cones : mapping of str to sequence of EchoCone
        Pings of each robot; and those that it heard earlier, by its name and `EARLIER_PINGS`.
    """

    def __init__(
        self, parameters: MappingParameters, cones: Mapping[str, Sequence[EchoCone]]
    ) -> None:
        self._parameters, self._cones = parameters, cones
        self._topics = list(cones)
        nothing = np.zeros((len(cones), len(cones)))
        self._said = MutualEvidence(nothing, nothing)
        self._agreements: dict[str, Agreement] = {}
        # What `_agreement_without` has found, which takes as long as to map everything again.
        self._without: dict[str, tuple[LeaveOneOutMap, list[Agreement]]] = {}

    def screen(self) -> dict[str, Finding]:
        """Judge all by the map that they have made together."""
        together = LeaveOneOutMap(self._cones, self._parameters)
        expected = together.expected(self._cones, of_one=self._of_one)
        self._agreements = {topic: agreement(pings) for topic, pings in expected.items()}
        self._said = self._without_self_praise(together.mutual_evidence())
        found = {}
        for topic, own in self._agreements.items():
            others = [a for t, a in self._agreements.items() if t != topic]
            found[topic] = finding_of(own, others, SUSPECT_FIT, most_asked=math.inf)
        return found

    def _of_one(self, topic: str) -> list[str]:
        """All that the robot says that has said this."""
        return [name for name in self._cones if robot_of(name) == robot_of(topic)]

    def _without_self_praise(self, said: MutualEvidence) -> MutualEvidence:
        """The same, unless a robot's latest pings agree with its earlier ones.

        It may be misplaced throughout.
        """
        for row, topic in enumerate(self._topics):
            for name in self._of_one(topic):
                column = self._topics.index(name)
                if row != column and said.agreed[row, column] >= said.contradicted[row, column]:
                    said.agreed[row, column] = said.contradicted[row, column] = 0.0
        return said

    def culprits(self, screened: Mapping[str, Finding]) -> dict[str, Finding]:
        """The suspect that is a liar, or those of which one is; nobody if all are cleared."""
        suspects = [topic for topic, finding in screened.items() if finding.is_suspect]
        for topic in suspects:
            if screened[topic].verdict != "misplaced":
                finding = finding_of(*self._agreement_without(topic), MISPLACED_FIT)
                if finding.is_suspect:
                    return {topic: finding}
        if found := self._not_borne_out():
            return found
        return self._least_borne_out(self._misplaced(suspects)) if suspects else {}

    def _not_borne_out(self) -> dict[str, Finding]:
        """Those whom others contradict that agree with one another."""
        if len(self._topics) <= LEAST_ROBOTS_LEFT:
            return {}
        shares = [self._said.borne_out(robot) for robot in range(len(self._topics))]
        found = {}
        for robot, topic in enumerate(self._topics):
            left = self._credit(topic)
            usual = float(
                np.median([share for other, share in enumerate(shares) if other != robot])
            )
            if left > 0.0 or usual < LEAST_USUAL or shares[robot] > FAR_LESS * usual:
                continue
            if self._said.shared(robot) < LEAST_SAID or self._expects_nothing(topic):
                continue
            evidence: dict[str, float | int | None] = {
                "borne_out": shares[robot],
                "others_borne_out": usual,
            }
            verdict = self._why_not_borne_out(topic)
            reason = f"others bear out {shares[robot]:.0%} of what it hears, of theirs {usual:.0%}"
            found[topic] = Finding(verdict, evidence, f"{verdict}: {reason}")
        return found

    def _credit(self, topic: str) -> float:
        """How much of the trust in some pings is left, each other robot being one witness."""
        robot = robot_of(topic)
        who = [name if robot_of(name) == robot else robot_of(name) for name in self._topics]
        names = sorted(set(who))
        is_of = np.array([[one == name for one in who] for name in names], float)
        said = MutualEvidence(*(is_of @ sums @ is_of.T for sums in self._said))
        return credit(said)[names.index(topic)]

    def _expects_nothing(self, topic: str) -> bool:
        """Whether the others' map has nothing to be heard in nearly all of some pings.

        They are of a place that nobody else looked into, and what is said of the same cells is said
        of what reverberates: of echoes of echoes behind the walls of either place.
        """
        return self._agreements[topic].pings < LEAST_PINGS

    def _why_not_borne_out(self, topic: str) -> Verdict:
        others = [a.echoes for t, a in self._agreements.items() if t != topic]
        few = FEW_ECHOES * float(np.median(others))
        return "deaf" if self._agreements[topic].echoes < few else "misplaced"

    def _least_borne_out(self, named: dict[str, Finding]) -> dict[str, Finding]:
        """Nobody, if others bear out an accused robot nearly as well as another, or better."""
        shares = {t: self._said.borne_out(robot) for robot, t in enumerate(self._topics)}
        if len(shares) <= LEAST_ROBOTS_LEFT:
            # Two bear each other out alike: halves of their own pings tell what can be asked here.
            own = [self._said.borne_out_by_themselves(robot) for robot in (0, 1)]
            if max(own) > ITSELF and min(own) < 0.5 * max(own):
                # One contradicts itself where the other does not, as who faces elsewhere.
                return named
            accused, least = list(shares), self._said.borne_out_by_themselves(0, 1)
        else:
            accused = [topic for topic, finding in named.items() if finding.is_suspect]
            beside = (shares[t] for t in shares if t == robot_of(t) and t not in accused)
            least = min(beside, default=1.0)
        return named if all(shares[topic] <= LESS * least for topic in accused) else {}

    def _misplaced(self, suspects: Sequence[str]) -> dict[str, Finding]:
        """The robot without which the others agree, if it does not fit their map.

        Several, if the others would agree without any one of them: of two nobody can say which is
        right.
        """
        fits = {t: a.fit for t, a in self._agreements.items() if a.fit is not None}
        worst = sorted(fits, key=lambda topic: (topic not in suspects, fits[topic]))[:MOST_LEFT_OUT]
        apart = {topic: self._agreement_without(topic) for topic in worst}
        known = [fit for _, others in apart.values() if (fit := usual_fit(others)) is not None]
        # Of those who know nothing of one another, nothing speaks against their agreeing.
        agreed = {
            topic: usual_fit(others) or max(known, default=USUAL_FIT)
            for topic, (_, others) in apart.items()
        }
        verdicts = {topic: finding_of(*apart[topic], MISPLACED_FIT) for topic in agreed}
        least = AGREED * max(agreed.values(), default=0.0)
        fitting = [agreed[t] for t, own in verdicts.items() if own.is_suspect and agreed[t] > least]
        named = {
            topic: own
            for topic, own in verdicts.items()
            if own.is_suspect and agreed[topic] == max(fitting, default=0.0)
        }
        if named and len(self._cones) <= LEAST_ROBOTS_LEFT:
            # Of two, the one that is right may fit the other's map the worse.
            named = {t: verdicts.get(t, Finding("unknown", {})) for t in self._cones}
        return {topic: _or_its_rivals(topic, named) for topic in named}

    def _agreement_without(self, topic: str) -> tuple[Agreement, list[Agreement]]:
        """How a robot agrees with the map of the others, and they with one another, without it."""
        robot = robot_of(topic)
        if robot not in self._without:
            others = {t: own for t, own in self._cones.items() if robot_of(t) != robot}
            apart = LeaveOneOutMap(others, self._parameters)
            among_them = apart.expected(others, of_one=self._of_one).values()
            self._without[robot] = apart, [agreement(pings) for pings in among_them]
        apart, among = self._without[robot]
        return agreement(apart.expected(self._cones, of=[topic])[topic]), among


def _or_its_rivals(topic: str, named: Mapping[str, Finding]) -> Finding:
    """What was found of one of several that contradict one another, if nobody else can tell."""
    rivals = " or ".join(other for other in sorted(named) if robot_of(other) != robot_of(topic))
    finding = named[topic]
    if not rivals:
        return finding
    own = finding.reason.partition(": ")[2] or "it may be misplaced"
    reason = f"contradicted: {own}; or {rivals} is misplaced"
    return replace(finding, verdict="contradicted", reason=reason)


def usual_fit(others: Sequence[Agreement]) -> float | None:
    """Median fit of robots; None if too little is known of any."""
    fits = [a.fit for a in others if a.pings >= LEAST_PINGS and a.fit is not None]
    return float(np.median(fits)) if fits else None


def finding_of(
    own: Agreement, others: list[Agreement], least_fit: float, most_asked: float = USUAL_FIT
) -> Finding:
    """Judge a robot by how it agrees with the others' map, beside how they agree with theirs.

    Parameters
    ----------
    own : Agreement
        How the robot in question agrees with the map of all others.
    others : list of Agreement
        Those of the others.
    least_fit : float
        Share of the others' usual fit below which it is misplaced.
    most_asked : float
        Fit beyond which the others' does not count.
    """
    louder_db = _difference(
        own.loudness_db, [a.loudness_db for a in others if a.matches >= LEAST_MATCHES]
    )
    if louder_db is not None and len(others) == 1:
        # Of two, each is as much louder than the other as that is fainter.
        louder_db *= 0.5
    evidence: dict[str, float | int | None] = asdict(own) | {"loudness_over_others_db": louder_db}
    can_tell = own.matches >= LEAST_OWN_MATCHES
    if louder_db is not None and can_tell and abs(louder_db) > ODD_LOUDNESS_DB:
        return _of_odd_loudness(louder_db, own.matches, evidence)
    if own.pings < LEAST_PINGS or own.fit is None:
        return Finding("unknown", evidence)
    # Smooth walls, struck squarely by one robot and not by another, fit better than they need to.
    usual = min(usual_fit(others) or USUAL_FIT, most_asked)
    is_here = own.audible >= LEAST_PINGS and own.heard >= HEARD_HERE * own.audible
    if own.fit >= least_fit * usual or is_here:
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
