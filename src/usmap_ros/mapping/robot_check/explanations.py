"""What would make all robots' pings fit better, if one robot were not as it says.

A robot's pings are held against what all pings say, as it tells them, and as they would be if it
faced elsewhere, stood elsewhere, or were late.  What makes all pings fit much better, and surely,
is what is wrong, unless something that is wrong with another robot would do nearly as much.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from usmap_ros.mapping.robot_check.displacement import (
    COARSE,
    FINE_M,
    SHARP,
    Displacement,
    Way,
)
from usmap_ros.mapping.robot_check.echo_health import from_places
from usmap_ros.mapping.robot_check.finding import Finding, or_its_rivals
from usmap_ros.mapping.robot_check.sightings import (
    Field,
    empty_field,
    fits,
    said,
    sightings_of,
)
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.pings.cone import EchoCone

#: Sides of cells and how far from an echo they may be, m: to tell, and to look for places.
FINE, COARSE_CELLS = (0.05, 0.04), (0.1, 0.1)
#: How far a displacement may reach beyond what pings do; and most that a robot's places may be
#: apart: of those who go farther the newest count.
MARGIN_M, MOST_WAY_M = 1.5, 60.0
#: Once a robot has been named, so many others can name nobody else; and places that are needed to
#: tell anything of one.
LEAST_ROBOTS_LEFT, LEAST_PLACES = 2, 10
#: Places on the coarse grid that are looked at more closely.
CANDIDATES = 3
#: Gain in log-likelihood of all pings, beside this share of what they gain as they are told, and in
#: its standard errors, of blocks of so many pings, from which on something is wrong; and the share
#: of it that nothing wrong with another robot may reach.
LEAST_GAIN, LEAST_SHARE, LEAST_CERTAINTY, BLOCK, RIVAL_SHARE = 10.0, 0.03, 1.5, 5, 0.8
#: What is taken off the gain by a place, of which many are tried: logarithm of their number.
OF_PLACES = math.log(len(COARSE) * len(FINE_M) ** 2)


@dataclass(frozen=True)
class Explanation:
    """What would make pings fit better.

    Parameters
    ----------
    by : Displacement
        What may be wrong.
    gain, told, certainty : float
        Of log-likelihood over the pings as they are told, theirs over nothing explained, and that
        of the first in standard errors.
    """

    by: Displacement
    gain: float
    told: float
    certainty: float

    @property
    def is_sure(self) -> bool:
        """Whether it is more than chance."""
        least = LEAST_GAIN + LEAST_SHARE * max(self.told, 0.0)
        return self.gain >= least and self.certainty >= LEAST_CERTAINTY

    def finding(self) -> Finding:
        """What is to be said of the robot."""
        evidence: dict[str, float | int | None] = {
            "gain": self.gain, "told": self.told, "certainty": self.certainty,
        }  # fmt: skip
        reason = f"misplaced: its pings fit the others' {self.by.in_words()}"
        return Finding("misplaced", evidence, reason)


class Comparison:
    """One robot's pings, and those of all others that reach into the same area.

    Parameters
    ----------
    own : sequence of EchoCone
        Pings of the robot.
    others : sequence of EchoCone
        Of all others.
    """

    def __init__(self, own: Sequence[EchoCone], others: Sequence[EchoCone]) -> None:
        own, west_m, south_m, width_m, height_m = _area(own)
        self._way = Way(own)
        self._others = sightings_of(
            [cone for cone in others if _reaches(cone, west_m, south_m, width_m, height_m)]
        )
        self._area = west_m, south_m, width_m, height_m
        field = empty_field(*self._area, *FINE)
        self._said = said(self._others, field)
        own_said = said(self._way.told, field)
        together = self._said.plus(own_said)
        self._told = fits(self._way.told, together, 1), fits(self._others, together, 1)

    def explanations(self, between: Callable[[], None]) -> list[Explanation]:
        """What may be wrong, and how much better all would fit."""
        found = []
        for by in (*SHARP, *self._places(between)):
            between()
            pings = self._way.displaced(by)
            together = self._said.plus(said(pings, self._said))
            own = fits(pings, together, 1)
            own = np.where(pings.greatest_m > 0.0, own, self._told[0])
            found.append(self._explanation(by, own, fits(self._others, together, 1)))
        return found

    def _explanation(self, by: Displacement, own: FloatArray, others: FloatArray) -> Explanation:
        gains = np.concatenate([own - self._told[0], others - self._told[1]])
        blocks = np.add.reduceat(gains, np.arange(0, len(gains), BLOCK))
        error = max(float(blocks.std()) * math.sqrt(len(blocks)), 1e-9)
        gain, told = float(gains.sum()), float(self._told[0].sum() + self._told[1].sum())
        penalty = OF_PLACES if by.kind == "moved" else 0.0
        return Explanation(by, gain - penalty, told, gain / error)

    def _places(self, between: Callable[[], None]) -> list[Displacement]:
        """Where the robot may be instead."""
        coarse = said(self._others, empty_field(*self._area, *COARSE_CELLS))
        at = [(self._fit_at(by, coarse), by) for by in COARSE]
        between()
        found = []
        for _, by in sorted(at, reverse=True)[:CANDIDATES]:
            around = [
                Displacement("moved", by.x + x_m, by.y + y_m) for x_m in FINE_M for y_m in FINE_M
            ]
            found.append(max(around, key=lambda place: self._fit_at(place, self._said)))
        return found

    def _fit_at(self, by: Displacement, others: Field) -> float:
        return float(fits(self._way.displaced(by), others, 0).sum())


def _area(own: Sequence[EchoCone]) -> tuple[list[EchoCone], float, float, float, float]:
    """The newest pings that are near one another, and the rectangle that they reach into."""
    xy_m = np.array([cone.pose.position_m[:2] for cone in own])
    far = np.flatnonzero(np.abs(xy_m - xy_m[-1]).max(axis=1) > 0.5 * MOST_WAY_M)
    first = int(far[-1]) + 1 if len(far) else 0
    near = list(own[first:])
    reach_m = max(cone.transducer.max_range_m for cone in near) + MARGIN_M
    west_m, south_m = (xy_m[first:].min(axis=0) - reach_m).tolist()
    width_m, height_m = (np.ptp(xy_m[first:], axis=0) + 2.0 * reach_m).tolist()
    return near, west_m, south_m, width_m, height_m


def _reaches(
    cone: EchoCone, west_m: float, south_m: float, width_m: float, height_m: float
) -> bool:
    x_m, y_m = (float(value) for value in cone.pose.position_m[:2])
    reach_m = cone.transducer.max_range_m
    return (
        west_m - reach_m < x_m < west_m + width_m + reach_m
        and south_m - reach_m < y_m < south_m + height_m + reach_m
    )


def displaced(
    cones: Mapping[str, Sequence[EchoCone]], between: Callable[[], None]
) -> dict[str, Finding]:
    """The robot that something is wrong with, or those of which one is; most often nobody.

    Parameters
    ----------
    cones : mapping of str to sequence of EchoCone
        Pings of each robot, two robots at the least.
    between : callable
        As in `Consistency.findings`.
    """
    kept = {topic: from_places(own) for topic, own in cones.items()}
    best = dict[str, Explanation]()
    for topic, own in kept.items():
        between()
        if len(own) < LEAST_PLACES:
            continue
        others = [cone for other, theirs in kept.items() if other != topic for cone in theirs]
        explanations = Comparison(own, others).explanations(between)
        best[topic] = max(explanations, key=lambda one: one.gain)
    sure = {topic: one for topic, one in best.items() if one.is_sure}
    most = max((one.gain for one in sure.values()), default=math.inf)
    named = {t: one.finding() for t, one in best.items() if one.gain >= RIVAL_SHARE * most}
    if named and len(cones) <= LEAST_ROBOTS_LEFT:
        # Of two, the one that is right may as well be displaced.
        named = {t: best[t].finding() if t in best else Finding("unknown", {}) for t in cones}
    return {topic: or_its_rivals(topic, named) for topic in named}
