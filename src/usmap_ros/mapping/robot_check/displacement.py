"""In which way a robot is elsewhere than it says, if one explains its pings by the others' map.

Its pings are held against what the map expects where the robot says it is, and where it would be
if it faced elsewhere, stood elsewhere, were late, or measured ranges with the wrong speed of sound.
A ping's fit is by how much it is likelier with what is expected of it than with the same shifted in
range, so that a place where much is expected gains nothing by that.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.field import (
    BIN_M,
    GREATEST_RANGE,
    LEAST_RANGE,
    NOISE,
    RANGE_STD,
    X,
    Y,
)
from usmap_ros.mapping.joint.kept_pings import Pings
from usmap_ros.mapping.joint.leave_one_out import turned_looks
from usmap_ros.mapping.looks import Looks
from usmap_ros.mapping.ping_bins import ECHO, SILENCE
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.pings.cone import EchoCone

#: Share of echoes and silences that no map explains, and the width of their powers' logarithms.
UNEXPLAINED, LOG_POWERS = 0.2, math.log(1e6)
#: Powers expected in a range bin, over the noise, from which on it tells anything.
LOUD = 2.0
#: Shifts of range that are compared with, m.
SHIFTS_M = (-0.35, -0.25, -0.15, 0.15, 0.25, 0.35)
#: Those that are looked for: turns, wrong scales, delays, and places on a grid, m.
TURNS_RAD = tuple(math.radians(degrees) for degrees in range(-160, 181, 20) if degrees)
SCALES, DELAYS_S = (0.9, 0.95, 1.05, 1.1), (-1.0, -0.5, 0.5, 1.0)
GRID_M = tuple(0.2 * step for step in range(-6, 7))
#: Those that are as near to each other explain the same: by angle, by scale, and by place, m.
NEAR_RAD, NEAR_SCALE, NEAR_M = 0.75, 0.06, 0.45

Kind = Literal["told", "turned", "scaled", "late", "moved"]


class Displacement(NamedTuple):
    """What may be wrong with a robot's poses, or with its ranges.

    Parameters
    ----------
    kind : str
        ``turned``, ``scaled``, ``late``, ``moved``, or ``told``: nothing is.
    x, y : float
        By how much: rad, factor, s; or the way in metres.
    """

    kind: Kind
    x: float = 0.0
    y: float = 0.0

    def is_near(self, other: Displacement) -> bool:
        """Whether another one explains the same."""
        if self.kind != other.kind:
            return False
        if self.kind == "turned":
            return abs(math.remainder(self.x - other.x, math.tau)) < NEAR_RAD
        if self.kind == "scaled":
            return abs(self.x - other.x) < NEAR_SCALE
        if self.kind == "late":
            return self.x * other.x > 0.0
        return math.hypot(self.x - other.x, self.y - other.y) < NEAR_M

    def in_words(self) -> str:
        """Under which condition its pings fit."""
        words = {
            "told": "as it is",
            "turned": f"if it faces {math.degrees(self.x):+.0f}° from there",
            "scaled": f"if its ranges are {self.x:.2f} of what it says",
            "late": f"if its poses are {self.x:+.1f} s late",
            "moved": f"if it is {math.hypot(self.x, self.y):.1f} m from there",
        }
        return words[self.kind]


TOLD = Displacement("told")
#: Those that are looked for with the errors of maps, and those on a grid.
SHARP = (
    *(Displacement("turned", by_rad) for by_rad in TURNS_RAD),
    *(Displacement("scaled", factor) for factor in SCALES),
    *(Displacement("late", delay_s) for delay_s in DELAYS_S),
)
COARSE = tuple(
    Displacement("moved", x_m, y_m)
    for x_m in GRID_M
    for y_m in GRID_M
    if math.hypot(x_m, y_m) > 0.25
)


class Allowance(NamedTuple):
    """What is allowed for when pings are compared.

    Parameters
    ----------
    range_std_m : float
        Error of range: of maps, or of a grid of places.
    most : float
        That a ping says.
    fit, times, certainty : float
        What a displacement is sure from: its fit, how many times what the next best comes to, and
        standard errors.
    """

    range_std_m: float
    most: float
    fit: float
    times: float
    certainty: float


#: Of healthy robots in 4 rooms the surest of the grid came to 1.55 times the next best.
OF_SHARP = Allowance(0.03, 20.0, fit=40.0, times=1.5, certainty=3.0)
OF_COARSE = Allowance(0.08, 6.0, fit=60.0, times=1.8, certainty=4.0)


def allowed_for(by: Displacement) -> Allowance:
    """What is allowed for with a displacement."""
    return OF_COARSE if by.kind == "moved" else OF_SHARP


#: Expected powers, (pings, bins), of some looks.
Levels = Callable[[Looks], FloatArray]


class Way:
    """Where a robot says it has been; its pings, and where it would have heard them from.

    Parameters
    ----------
    cones : sequence of EchoCone
        In the order of their stamps.
    pings : Pings
        Those of them that count.
    stamps_s : (pings,) array
        Of those.
    """

    def __init__(self, cones: Sequence[EchoCone], pings: Pings, stamps_s: FloatArray) -> None:
        self.pings, self._stamps_s = pings, stamps_s
        self._told_s = np.array([cone.stamp_ns for cone in cones]) * 1e-9
        self._xy_m = np.array([cone.pose.position_m[:2] for cone in cones])
        self._yaw_rad = np.unwrap([cone.pose.yaw_rad for cone in cones])

    def displaced(self, by: Displacement, range_std_m: float) -> Looks:
        """Looks as they would be, with so much error of ranges."""
        looks = self.pings.looks
        numbers = looks.numbers.copy()
        numbers[:, RANGE_STD] = np.hypot(numbers[:, RANGE_STD], range_std_m)
        if by.kind == "scaled":
            numbers[:, [LEAST_RANGE, GREATEST_RANGE, BIN_M]] *= by.x
        elif by.kind == "moved":
            numbers[:, [X, Y]] += by.x, by.y
        looks = looks._replace(numbers=numbers)
        if by.kind == "turned":
            return turned_looks(looks, by.x)
        return self._later(looks, by.x) if by.kind == "late" else looks

    def _later(self, looks: Looks, by_s: float) -> Looks:
        """With the poses of another time."""
        rows, numbers = self.pings.rows, looks.numbers
        then_s = self._stamps_s + by_s
        yaw_rad = np.zeros(len(numbers))
        yaw_rad[rows] = np.interp(then_s, self._told_s, self._yaw_rad) - np.interp(
            self._stamps_s, self._told_s, self._yaw_rad
        )
        for axis, way_m in zip((X, Y), self._xy_m.T, strict=True):
            numbers[rows, axis] = np.interp(then_s, self._told_s, way_m)
        return turned_looks(looks, yaw_rad)


class Explanation(NamedTuple):
    """What explains a robot's pings best, beside what it says.

    Parameters
    ----------
    by : Displacement
        That.
    fit, told, other : float
        Sum of the fits of its pings by that, by what the robot says, and by the best of its like
        that are not near.
    certainty : float
        By how much the first is above the second, in standard errors.
    """

    by: Displacement
    fit: float
    told: float
    other: float
    certainty: float

    @property
    def is_sure(self) -> bool:
        """Whether nothing else explains its pings nearly as well, and what it says does not."""
        least = allowed_for(self.by)
        is_best = self.fit > max(self.told, least.times * self.other)
        return self.fit > least.fit and self.certainty > least.certainty and is_best


def sure_explanation(way: Way, levels: Levels) -> Explanation | None:
    """Look for a displacement; None if none is sure."""
    for those in (SHARP, COARSE):
        found = _best(way, levels, those)
        if found.is_sure:
            return found
    return None


def _best(way: Way, levels: Levels, those: Sequence[Displacement]) -> Explanation:
    """Which of some displacements of one kind of allowance explains most."""
    allowance = allowed_for(those[0])
    told = fit_by(way, TOLD, levels, allowance)
    fits = {by: fit_by(way, by, levels, allowance) for by in those}
    best = max(fits, key=lambda by: float(fits[by].sum()))
    other = max(float(fit.sum()) for by, fit in fits.items() if not by.is_near(best))
    gain = fits[best] - told
    error = max(float(gain.std()) * math.sqrt(len(gain)), 1e-9)
    return Explanation(
        best, float(fits[best].sum()), float(told.sum()), other, float(gain.sum()) / error
    )


def fit_by(way: Way, by: Displacement, levels: Levels, allowance: Allowance) -> FloatArray:
    """Fit of each ping by one displacement."""
    looks, rows = way.displaced(by, allowance.range_std_m), way.pings.rows
    expected = levels(looks)
    shifted = np.zeros(len(rows))
    bin_m = float(np.median(looks.numbers[rows, BIN_M]))
    for shift_m in SHIFTS_M:
        shifted += _log_likelihood(looks, rows, _moved(looks, rows, expected, shift_m / bin_m))
    fit = _log_likelihood(looks, rows, expected) - shifted / len(SHIFTS_M)
    return np.clip(fit, -allowance.most, allowance.most)


def _moved(
    looks: Looks, rows: NDArray[np.int64], expected: FloatArray, by_bins: float
) -> FloatArray:
    """The same in other range bins."""
    moved = np.repeat(looks.numbers[rows, NOISE, np.newaxis], expected.shape[1], axis=1)
    by = round(by_bins)
    if abs(by) >= expected.shape[1]:
        return moved
    if by > 0:
        moved[:, by:] = expected[:, :-by]
    else:
        moved[:, :by] = expected[:, -by:]
    return moved


def _log_likelihood(looks: Looks, rows: NDArray[np.int64], expected: FloatArray) -> FloatArray:
    """Of each ping, over that of echoes from anywhere and of silence in any case."""
    bins = expected.shape[1]
    kind, power, limit = looks.kind[rows, :bins], looks.power[rows], looks.limit[rows]
    tells = (expected > LOUD * looks.numbers[rows, NOISE, np.newaxis]) & (
        np.arange(bins) < looks.bins[rows, np.newaxis]
    )
    ratio = np.maximum(power / expected, 1e-12)
    background = UNEXPLAINED / LOG_POWERS
    echo = np.log((1.0 - UNEXPLAINED) * ratio * np.exp(-ratio) + background) - math.log(background)
    silent = np.log(1.0 - (1.0 - UNEXPLAINED) * np.exp(-limit / expected))
    sums: FloatArray = np.where(tells & (kind == ECHO), echo, 0.0).sum(axis=1)
    sums += np.where(tells & (kind == SILENCE), silent, 0.0).sum(axis=1)
    return sums
