"""Which echoes come from which landmark."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.localisation.echo_table import TrackEchoes
from usmap_ros.localisation.lines_and_points import Landmarks, LandmarkViews, view_landmarks
from usmap_ros.numerics.arrays import BoolArray, FloatArray

#: Echoes per metre of range that no wall explains.
_BACKGROUND = 0.6
#: Stretch of a wall, m, of which it is asked how many of the pings that face it hear it; what is
#: thought of that beforehand, and how many looks outweigh it.
_STRETCH_M, _LEAST_RATE, _FIRST_RATE, _PRIOR_LOOKS = 0.3, 0.05, 0.3, 2.0
#: Of a stretch, the most that it is taken to be heard where a look goes through.
_MOST_RATE = 0.9
#: How well the edge of a beam is known, rad.
_EDGE_RAD = 0.05
#: Ranges and poses that are off by so much at the most, m, tell walls whose echoes scatter less;
#: echoes that outweigh what is thought of that beforehand; and the least of their variance.
_TELLING_M, _USUAL_ECHOES, _LEAST_SCATTER = 0.025, 10.0, 0.1
#: Echoes farther from a wall, standard deviations, are not its.
_REACH = 5.0
#: Times that this is asked anew, with what is thought of it then.
_ROUNDS = 3
#: Weight of an echo of a landmark: what it is off, it is off for several pings alike.
ECHO_WEIGHT = 0.5
#: Part of what echoes of a landmark would tell that is observed, at the least.
_LEAST_OBSERVED = 0.1
#: Part of those that are not worth their cost that go at once, one of so many; and what is left of
#: an echo without its landmark, at the least.
_PARTS, _LEAST_LEFT = 3, 1e-9


class DataAssociation(NamedTuple):
    """Which echoes are whose: a row for each echo and each landmark that it may well be of."""

    #: (n,) int arrays: which.
    echo: NDArray[np.intp]
    landmark: NDArray[np.intp]
    #: (n,) array: of the landmark in the echo.
    shares: FloatArray
    #: (n,) array: by how much the place that the echo would be from is behind the landmark.
    off_m: FloatArray
    #: (n,) array: where that is along a wall.
    along_m: FloatArray
    #: (3, n) array: by how much it goes behind it as the robot moves along x and y, and turns.
    by_pose: FloatArray
    #: (n,) array: of `off_m`, in units of that of an echo from the foot of the perpendicular.
    precision: FloatArray
    #: Of all echoes, relative to none of them being a landmark's.
    log_likelihood: float

    def observed(self, echoes: TrackEchoes, count: int, sigma_m: float) -> DataAssociation:
        """The same with the precision that is left where nobody knows which echoes are whose.

        As poses move, echoes go over from a landmark to another one, or to none.  What shares that
        are known would tell is more than what is observed by that (the missing information of
        Louis, JRSS B 1982), and covariances by it would be too small.
        """
        weights = self.shares * echoes.weight[self.echo]
        missing = (1.0 - self.shares) * self.precision * (self.off_m / sigma_m) ** 2
        whole = np.maximum(np.bincount(self.landmark, weights, count), 1e-12)
        left = np.bincount(self.landmark, weights * (1.0 - missing), count) / whole
        left = np.maximum(left, _LEAST_OBSERVED)
        return self._replace(precision=self.precision * left[self.landmark])


class _Pairs(NamedTuple):
    """Echoes and landmarks that they may be of, a row each; and how they are looked at."""

    #: Of all pings and landmarks.
    seen: LandmarkViews
    #: (n,) int arrays: which.
    echo: NDArray[np.intp]
    landmark: NDArray[np.intp]
    #: (n,) arrays: as `DataAssociation.off_m`, and its standard deviation.
    off_m: FloatArray
    std_m: FloatArray
    #: (n,) array: how `off_m` changes as the robot turns.
    per_rad_m: FloatArray
    #: (n,) array: density of ranges where the echo is as likely as it may be, times how much
    #: likelier than usual it is a landmark's.
    most: FloatArray
    #: (n,) int array: which stretch of the landmark.
    cell: NDArray[np.intp]
    #: (pings, landmarks) int array: the same for each ping.
    cells: NDArray[np.int64]
    #: (stretches, landmarks) array: looks at each stretch.
    asked: FloatArray
    #: (k,) int arrays: echoes of the first thing only, and what stands before it.
    beyond: NDArray[np.intp]
    past: NDArray[np.intp]

    @classmethod
    def of(
        cls, echoes: TrackEchoes, poses: FloatArray, wanted: BoolArray, landmarks: Landmarks,
        sigma_m: float,
    ) -> _Pairs:  # fmt: skip
        """Parameters are those of `associate_echoes`."""
        count, seen, ping = landmarks.total, view_landmarks(landmarks, echoes, poses), echoes.ping
        # Of most landmarks a ping looks the other way.
        echo, landmark = np.nonzero(seen.faced[ping])
        at, range_m = (ping[echo], landmark), echoes.range_m[echo]
        aslant_rad = seen.aslant_rad[at]
        cosine, per_rad_m = np.cos(aslant_rad), -range_m * np.sin(aslant_rad)
        off_m = range_m * cosine - seen.far_m[at]
        std_m = np.hypot(sigma_m * cosine, per_rad_m * _EDGE_RAD)
        stretch = np.floor(seen.along_m / _STRETCH_M).astype(np.int64)
        stretch -= stretch.min(initial=0)
        cells = stretch * count + np.arange(count)
        first_only, looked_at = echoes.aslant_rad[echo] > 0.0, seen.faced.copy()
        looked_at[at] = ~(first_only & (off_m < -2.0 * std_m))
        looks = np.zeros(len(poses))
        looks[ping] = echoes.weight * wanted[ping]
        shape = int(stretch.max(initial=0)) + 1, count
        asked = _by_stretch(cells[looked_at], looks[np.nonzero(looked_at)[0]], shape)
        beyond = first_only & (off_m > 3.0 * std_m)
        its = np.flatnonzero(wanted[at[0]] & (np.abs(off_m) < _REACH * std_m))
        return cls(
            seen, echo[its], landmark[its], off_m[its], std_m[its], per_rad_m[its],
            echoes.onset[echo[its]] * cosine[its] / std_m[its], cells[at][its], cells, asked,
            echo[beyond], landmark[beyond],
        )  # fmt: skip

    def associate_echoes(
        self, echoes: TrackEchoes, kept: NDArray[np.intp], sigma_m: float
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Of some rows the shares and how tight landmarks are; evidence, and rates by stretch."""
        echo, landmark, cell = self.echo[kept], self.landmark[kept], self.cell[kept]
        apart, most = self.off_m[kept] / self.std_m[kept], self.most[kept]
        count, weight = self.asked.shape[1], echoes.weight[echo]
        tight, rate = np.ones(count), np.full(self.asked.shape, _FIRST_RATE)
        density = _density(apart, tight[landmark]) * most
        shares, evidence = _shares(echo, rate.ravel()[cell] * density, len(echoes.ping))
        for _ in range(_ROUNDS):
            heard = _by_stretch(cell, shares * weight, self.asked.shape)
            rate = (heard + _LEAST_RATE * _PRIOR_LOOKS) / (self.asked + _PRIOR_LOOKS)
            if sigma_m <= _TELLING_M:
                tight = _tightness(landmark, shares, apart, count)
            density = _density(apart, tight[landmark]) * most
            shares, evidence = _shares(echo, rate.ravel()[cell] * density, len(echoes.ping))
        return shares, tight[landmark], evidence, rate


def associate_echoes(
    echoes: TrackEchoes, poses: FloatArray, wanted: BoolArray, landmarks: Landmarks, sigma_m: float
) -> DataAssociation:
    """Say which echoes come from which landmark, by how often each stretch of it is heard.

    Stretches of a point are the directions that it is looked at from.

    Parameters
    ----------
    echoes, poses, wanted, sigma_m
        As of `find_lines`.
    landmarks : Landmarks
        What stands.
    """
    pairs, ping = _Pairs.of(echoes, poses, wanted, landmarks, sigma_m), echoes.ping
    echo, landmark = pairs.echo, pairs.landmark
    shares, tight, evidence, rate = pairs.associate_echoes(echoes, np.arange(len(echo)), sigma_m)
    through = rate.ravel()[pairs.cells[ping[pairs.beyond], pairs.past]]
    likelihood = np.log(evidence / _BACKGROUND)
    missed = np.log1p(-np.minimum(through, _MOST_RATE))
    likelihood += np.bincount(pairs.beyond, missed, len(ping))
    at = ping[echo], landmark
    by_pose = np.stack([pairs.seen.toward_x[at], pairs.seen.toward_y[at], pairs.per_rad_m])
    return DataAssociation(
        echo, landmark, shares, pairs.off_m, pairs.seen.along_m[at], by_pose,
        (tight * sigma_m / pairs.std_m) ** 2, float((echoes.weight * wanted[ping]) @ likelihood),
    )  # fmt: skip


def worth_their_cost(
    echoes: TrackEchoes, poses: FloatArray, wanted: BoolArray, landmarks: Landmarks, sigma_m: float
) -> Landmarks:
    """Those landmarks without which echoes would be less likely by more than they cost.

    Parameters are those of `associate_echoes`.
    """
    pairs, is_worth = (
        _Pairs.of(echoes, poses, wanted, landmarks, sigma_m),
        np.ones(landmarks.total, np.bool_),
    )
    least = cost_of_landmark(int(wanted.sum())) / ECHO_WEIGHT
    while True:
        kept = np.flatnonzero(is_worth[pairs.landmark])
        shares, *_ = pairs.associate_echoes(echoes, kept, sigma_m)
        lost = -np.log(np.maximum(1.0 - shares, _LEAST_LEFT)) * echoes.weight[pairs.echo[kept]]
        gained = np.bincount(pairs.landmark[kept], lost, landmarks.total)
        poor = np.flatnonzero(is_worth & (gained < least))
        if not len(poor):
            return landmarks.of(is_worth)
        # Not all at once: what one loses, another one of the same echoes gains.
        is_worth[poor[np.argsort(gained[poor])[: -(-len(poor) // _PARTS)]]] = False


def cost_of_landmark(pings: int) -> float:
    """What the two unknowns of a landmark cost of log-likelihood.

    That is by the Bayesian information criterion: or poses that are wrong would see a wall twice
    and explain as much.
    """
    return math.log(max(pings, 1))


def _density(apart: FloatArray, tight: FloatArray) -> FloatArray:
    """Density of echoes that are so many standard deviations off."""
    return np.asarray(tight * np.exp(-0.5 * (apart * tight) ** 2) / math.sqrt(2.0 * math.pi))


def _tightness(
    wall: NDArray[np.intp], shares: FloatArray, apart: FloatArray, count: int
) -> FloatArray:
    """By how much less than usual the echoes of each wall scatter, as a factor of 1 and more.

    Of what is no wall, but echoes in a row by chance, they scatter as widely as they may.
    """
    variance = np.bincount(wall, shares * apart**2, count) + _USUAL_ECHOES
    variance /= np.bincount(wall, shares, count) + _USUAL_ECHOES
    return np.asarray(1.0 / np.sqrt(np.clip(variance, _LEAST_SCATTER, 1.0)))


def _shares(echo: np.ndarray, density: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """What part of each echo is whose, and how likely each echo is in all."""
    evidence = np.asarray(np.bincount(echo, density, count), float) + _BACKGROUND
    return density / evidence[echo], evidence


def _by_stretch(cell: np.ndarray, values: FloatArray, shape: tuple[int, int]) -> FloatArray:
    """Sums by stretches of walls, half of the neighbours' among them."""
    counts = np.bincount(cell, values, shape[0] * shape[1])
    own = np.asarray(counts, float).reshape(shape)
    around = np.pad(own, ((1, 1), (0, 0)))
    return np.asarray(own + 0.5 * (around[:-2] + around[2:]))
