"""The way of a robot, as its odometry tells it and as it is corrected.

Only some pings, the knots, have poses that are looked for; those in between follow odometry, and
what it is off from knot to knot is shared out evenly along the way.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from usmap_ros.localisation.planar import between, compose, turned_into
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.geometry import wrapped

#: Odometry that states no covariance: errors for the root of each metre (m, rad).
_SLIP_M, _TURN_RAD = 0.02, 0.026
#: Looks from nearer to each other than this are one: they hear the same parts of the same walls.
_ONE_PLACE_M, _ONE_PLACE_RAD = 0.05, 0.1
#: Way that a ping counts for where the robot stands, m.
_STANDING_M = 1e-4
#: Rounding of covariances, m² or rad².
_NOTHING = 1e-12
#: Knots are no nearer to each other than the way (m) or turn (rad) that odometry errs over.
_KNOT_M, _KNOT_RAD = 0.4, 0.4
#: What even the best odometry is off: between any two knots, and for each metre (m, rad).
_FLOOR_M, _FLOOR_RAD = 0.002, 0.003
_FLOOR_M_PER_M, _FLOOR_RAD_PER_M = 0.005, 0.003


@dataclass
class Track:
    """Odometry of a robot, with what was found out since: its scale, and how well it is known."""

    #: (n,) int array: which pings of the recording are its, in the order of their stamps.
    rows: NDArray[np.intp]
    #: (n, 3) array: poses as they were reported.
    told: FloatArray
    #: (n, 3, 3) array: of these.
    covariances: FloatArray
    #: (n,) int array: which of the robot's transducers each ping is of: each is somewhere else on
    #: it.
    transducers: NDArray[np.intp]
    #: Pings from knot to knot.
    every: int
    #: Whether poses are right as they are reported.
    is_fixed: bool = False
    #: Whether the covariances say how odometry drifts; otherwise it does as wheels usually do.
    is_stated: bool = True
    #: Ways that the robot has gone over those that odometry tells, and how far off 1 that is known
    #: to be beforehand, as a standard deviation.
    scale: float = 1.0
    scale_std: float = 0.03
    #: (3,) array: standard deviations of odometry's errors along, across and in heading, over those
    #: stated.
    spread: FloatArray = field(default_factory=lambda: np.ones(3))
    along_m: FloatArray = field(init=False)
    knots: NDArray[np.intp] = field(init=False)
    ways: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        self.along_m = self._along_m()
        self.knots = self._knots()
        told = self.told[self.knots]
        self._increments = between(told[:-1], told[1:])
        self.ways = self._ways(self._increments)
        self._stated = self._informations(self.knots)

    @property
    def increments(self) -> FloatArray:
        """Changes of pose from knot to knot by odometry of that scale, (knots - 1, 3)."""
        return self._increments + (self.scale - 1.0) * self.ways

    @property
    def informations(self) -> FloatArray:
        """How well these are known, (knots - 1, 3, 3): inverse covariances in the first's axes."""
        return self._stated / (self.spread[:, np.newaxis] * self.spread)

    def _knots(self) -> NDArray[np.intp]:
        """Pings whose poses are looked for: so many pings apart, and what odometry errs over."""
        found, last = [0], len(self.rows) - 1
        turned_rad = np.concatenate([[0.0], np.cumsum(np.abs(self._turns_rad()))])
        while found[-1] < last:
            at = found[-1]
            far = np.searchsorted(self.along_m, self.along_m[at] + _KNOT_M)
            turned = np.searchsorted(turned_rad, turned_rad[at] + _KNOT_RAD)
            found.append(int(min(max(at + self.every, min(far, turned)), last)))
        return np.array(found)

    def _ways(self, increments: FloatArray) -> FloatArray:
        """Of increments, what the robot has gone rather than where its transducers are on it."""
        gone_m = np.diff(self.along_m[self.knots])
        seen_m = np.hypot(*increments[:, :2].T)
        ways = increments * np.minimum(1.0, gone_m / np.maximum(seen_m, 1e-9))[:, np.newaxis]
        ways[:, 2] = 0.0
        return np.asarray(ways)

    def _informations(self, knots: NDArray[np.intp]) -> FloatArray:
        """What is stated of how well increments are known."""
        told, known = self.told[knots], self.covariances[knots] * self.is_stated
        step = told[1:] - told[:-1]
        carried = np.tile(np.eye(3), (len(step), 1, 1))
        carried[:, 0, 2], carried[:, 1, 2] = -step[:, 1], step[:, 0]
        turn = turned_into(told[:-1])
        cost = known[1:] - carried @ known[:-1] @ np.swapaxes(carried, 1, 2)
        cost = turn @ cost @ np.swapaxes(turn, 1, 2)
        # Where the start is uncertain and nothing is added to it, nothing is said of the way.
        is_stated = bool(np.abs(cost).max(initial=0.0) > _NOTHING)
        way_m = np.diff(self.along_m[knots])
        if known[:, :2, 2].any():
            values, vectors = np.linalg.eigh(0.5 * (cost + np.swapaxes(cost, 1, 2)))
            cost = (vectors * np.maximum(values, 0.0)[:, np.newaxis]) @ np.swapaxes(vectors, 1, 2)
        else:
            cost = _by_variances(known, way_m)
        floor = np.stack(
            [_FLOOR_M + _FLOOR_M_PER_M * way_m] * 2 + [_FLOOR_RAD + _FLOOR_RAD_PER_M * way_m],
            axis=-1,
        )
        if not is_stated:
            floor = np.hypot(
                floor, np.sqrt(way_m)[:, np.newaxis] * np.array([_SLIP_M, _SLIP_M, _TURN_RAD])
            )
        return np.asarray(np.linalg.inv(cost + floor[:, :, np.newaxis] ** 2 * np.eye(3)), float)

    def _along_m(self) -> FloatArray:
        """How far the robot has gone at each ping, (n,)."""
        along_m = np.zeros(len(self.rows))
        for transducer in np.unique(self.transducers):
            own = np.flatnonzero(self.transducers == transducer)
            steps_m = np.hypot(*np.diff(self.told[own, :2], axis=0).T)
            along_m[own[1:]] = np.cumsum(steps_m)
        return np.maximum.accumulate(along_m)

    def _turns_rad(self) -> FloatArray:
        """By how much the robot turns before each ping but the first, (n - 1,)."""
        heading = np.zeros(len(self.rows))
        for transducer in np.unique(self.transducers):
            own = np.flatnonzero(self.transducers == transducer)
            heading[own[1:]] = wrapped(np.diff(self.told[own, 2]))
        return heading[1:]

    def start_information(self) -> FloatArray:
        """How well the first pose is known, as an inverse covariance."""
        floor = np.diag([_FLOOR_M, _FLOOR_M, _FLOOR_RAD]) ** 2
        return np.asarray(np.linalg.inv(self.covariances[0] + floor))

    def shares(self) -> tuple[NDArray[np.intp], FloatArray]:
        """For each ping the knot before it, and how far it is on the way to the next one.

        Odometry errs where the robot moves, and hardly where it stands.
        """
        pings = np.arange(len(self.rows))
        before = np.clip(
            np.searchsorted(self.knots, pings, side="right") - 1, 0, max(len(self.knots) - 2, 0)
        )
        if len(self.knots) < 2:
            return before, np.zeros(len(pings))
        gone = self.along_m + _STANDING_M * pings
        start = gone[self.knots[before]]
        return before, (gone - start) / (gone[self.knots[before + 1]] - start)

    def poses(self, at_knots: FloatArray) -> FloatArray:
        """Poses of all pings from those of the knots, (n, 3)."""
        before, share = self.shares()
        if len(self.knots) < 2:
            return compose(at_knots[before], between(self.told[:1], self.told))
        start, told = at_knots[before], self.told[self.knots[before]]
        along = compose(start, between(told, self.told))
        end = compose(start, between(told, self.told[self.knots[before + 1]]))
        gap = at_knots[before + 1] - end
        gap[:, 2] = wrapped(gap[:, 2])
        poses = along + share[:, np.newaxis] * gap
        poses[:, 2] = wrapped(poses[:, 2])
        return poses

    def looks(self, half_angle_rad: FloatArray) -> FloatArray:
        """Weight of each ping, (n,): those that look at one thing from one place are one look.

        Parameters
        ----------
        half_angle_rad : (n,) array
            Of each ping's beam.
        """
        weights = np.ones(len(self.rows))
        for transducer in np.unique(self.transducers):
            own = np.flatnonzero(self.transducers == transducer)
            first = 0
            for ping in range(1, len(own) + 1):
                if ping < len(own):
                    moved = self.told[own[ping]] - self.told[own[first]]
                    is_near = math.hypot(moved[0], moved[1]) < _ONE_PLACE_M
                    if is_near and abs(wrapped(moved[2])) < _ONE_PLACE_RAD:
                        continue
                weights[own[first:ping]] = 1.0 / (ping - first)
                first = ping
        return weights / self._beams_alike(half_angle_rad)

    def _beams_alike(self, half_angle_rad: FloatArray) -> FloatArray:
        """How many transducers hear at once, from one place, what each ping hears, (n,)."""
        alike = np.ones(len(self.rows))
        first, heard = 0, set[int]()
        for ping in range(len(self.rows) + 1):
            if ping < len(self.rows):
                transducer = int(self.transducers[ping])
                moved_m = math.dist(self.told[ping, :2], self.told[first, :2])
                if transducer not in heard and moved_m < _ONE_PLACE_M:
                    heard.add(transducer)
                    continue
                heard = {transducer}
            run = slice(first, ping)
            alike[run] = _shared_beams(self.told[run, 2], half_angle_rad[run])
            first = ping
        return alike


def _shared_beams(heading_rad: FloatArray, half_angle_rad: FloatArray) -> FloatArray:
    """How many beams look where each of them does, shares of beams among them, (n,)."""
    apart_rad = np.abs(wrapped(heading_rad[:, np.newaxis] - heading_rad))
    shared = 1.0 - 0.5 * apart_rad / half_angle_rad[:, np.newaxis]
    return np.asarray(np.maximum(shared, 0.0).sum(axis=1))


def _by_variances(known: FloatArray, way_m: FloatArray) -> FloatArray:
    """What steps cost by the growth of variances alone, (n, 3, 3).

    Many drivers state no correlation of places and headings: that headings which are off take
    places along.  Places are then off by that above all, and steps by no more than is usual.
    """
    grown = np.maximum(np.diff(np.diagonal(known, axis1=1, axis2=2), axis=0), 0.0)
    grown[:, :2] = np.minimum(grown[:, :2].mean(axis=1), _SLIP_M**2 * way_m)[:, np.newaxis]
    return np.asarray(grown[:, :, np.newaxis] * np.eye(3))
