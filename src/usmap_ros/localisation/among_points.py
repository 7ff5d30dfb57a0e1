"""The search among points: robots are followed, matched with what others heard, and adjusted."""

from __future__ import annotations

import copy

import numpy as np

from usmap_ros.localisation.found import Found, average, of_pings
from usmap_ros.localisation.smoother import Smoother
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.geometry import wrapped

#: Knots by which a robot's own map lags behind it where robots are followed: one search for each.
_LAGS = (6, 3)
#: Improvements of each, and rounds of one: between them it is asked anew how much echoes count.
_IMPROVEMENTS, _ROUNDS = 2, 3
#: Blur, m, and steps of the adjustment that ends each search: so fine that ranges count by nearly
#: what they are worth.
_FINER = ((0.08, 10), (0.05, 10), (0.03, 10), (0.02, 30))
_FINEST_M = _FINER[-1][0]
#: Weight of an echo of points, over the square of that share; the least one to begin with, since
#: poses that are far off share little, and the most.
_OF_POINTS, _LEAST_WEIGHT, _MOST_WEIGHT = 6.0, 0.3, 1.0
#: Blur, m: of a match while robots go, of matches of a round, and of the field until the end.
_FOLLOWED_M, _MATCHED_M, _FINAL_M = (0.08, 0.067, 0.053, 0.04), (0.12, 0.06), 0.05
#: Steps of robots that look at all that was heard so far, at the most.
_STEPS = 40
#: Knots of a segment that is matched with what is not its own neighbourhood.
_SEGMENT = 6
#: A change that was for the better is tried again, so many times as large.
_FARTHER = 4.0
#: Rounds until the field of poses as they were told no longer changes.
_WARM_UP = 8


def with_all(start: Smoother) -> Smoother:
    """The same poses, all of whose echoes count."""
    told = copy.deepcopy(start)
    told.active[:] = True
    return told


def make_field(told: Smoother) -> None:
    """Make the field of the echoes from poses as they are."""
    for _ in range(_WARM_UP):
        told.map(_FINAL_M)


def among_points(start: Smoother, told: Smoother) -> list[Smoother]:
    """Where searches end that take all that answers for points, with the same weight of echoes.

    Parameters
    ----------
    start : Smoother
        With poses as they were told.
    told : Smoother
        The same with the field of all echoes.
    """
    ends, weight = [], max(_LEAST_WEIGHT, _weight(told))
    for lag in _LAGS:
        one = copy.deepcopy(start)
        one.trust(weight)
        _follow(one, lag)
        for _ in range(_IMPROVEMENTS):
            _improve(one, _ROUNDS)
            one.trust(max(_LEAST_WEIGHT, _weight(one)))
        ends.append(one)
    most = max(one.weight for one in ends)
    for one in ends:
        one.trust(most)
    return ends


def most_likely(ends: list[Smoother], told: Smoother) -> Found | None:
    """Adjust all ends finely, and average those that are more likely than the poses as told.

    Parameters
    ----------
    ends : list of Smoother
        Of `among_points`; changed.
    told : Smoother
        With poses as they were told, and the field of all echoes; changed.
    """
    for one in ends:
        for blur_m, steps in _FINER:
            for _ in range(steps):
                one.adjust(blur_m)
    told.trust(ends[0].weight)
    least = told.log_posterior(_FINEST_M)
    likely = [(one.log_posterior(_FINEST_M), one) for one in ends]
    found = [(gained, _at_pings(one)) for gained, one in likely if gained > least]
    return average(found) if found else None


def _weight(smoother: Smoother) -> float:
    """How much an echo counts, by how many come from places that pings share."""
    for _ in range(2):
        smoother.map(_FINAL_M)
    return min(_MOST_WEIGHT, _OF_POINTS * smoother.shared() ** 2)


def _follow(smoother: Smoother, lag: int) -> None:
    """Go along with all robots, and match what they hear with what was heard before.

    What a robot heard over its last `lag` knots is no part of the map that it is matched with:
    it has the same errors.
    """
    free = list(smoother.first)
    longest = max(len(smoother.knots[number]) for number in free)
    # Of long recordings, most steps look at what is new only: or they took the square of the time.
    stride = max(1, longest // _STEPS)
    for track in smoother.tracks:
        if track.is_fixed:
            smoother.active[track.rows] = True
    for last in range(1, longest):
        window = np.zeros(len(smoother.poses), np.bool_)
        before, ends = smoother.active.copy(), {}
        for number in free:
            track, count = smoother.tracks[number], len(smoother.knots[number])
            if count < 2:
                continue
            end = min(last, count - 1)
            begin = max(0, end - lag)
            if last < count:
                smoother.predict(number, last - 1)
            own = smoother.knot[track.rows] - smoother.first[number]
            smoother.active[track.rows[own < begin]] = True
            window[track.rows[(own >= begin) & (own < end)]] = True
            ends[number] = begin, end
        smoother.spread()
        if last > lag:
            if last % stride == 0:
                smoother.map(_FINAL_M)
            else:
                smoother.extend(_FINAL_M, smoother.active & ~before)
            _match_window(smoother, window, ends)
    smoother.active[:] = True


def _match_window(smoother: Smoother, window: BoolArray, ends: dict[int, tuple[int, int]]) -> None:
    heard = smoother.heard_by(smoother.active)
    for sigma_m in _FOLLOWED_M:
        pulls = smoother.pull(heard, window, sigma_m)
        for number, (begin, end) in ends.items():
            smoother.match(number, begin, end, pulls)
        smoother.spread()


def _improve(smoother: Smoother, rounds: int) -> None:
    """Match and adjust in turn; the smoother is left with the best that was on the way."""
    most = smoother.log_posterior(_FINAL_M)
    best, before = _knots(smoother), _knots(smoother)
    for number in range(rounds):
        _rematch(smoother, number % 2)
        smoother.adjust(0.06)
        smoother.adjust(_FINAL_M)
        gained = smoother.log_posterior(_FINAL_M)
        after = _knots(smoother)
        gained = max(gained, _go_farther(smoother, before, after, gained))
        before = _knots(smoother)
        if gained > most:
            best, most = before, gained
    _set_knots(smoother, best)


def _go_farther(smoother: Smoother, before: FloatArray, after: FloatArray, gained: float) -> float:
    """Try the same change once more, and larger; the posterior, if it is the better one."""
    shares, density = smoother.shares.copy(), smoother.density.copy()
    change = after - before
    change[:, 2] = wrapped(change[:, 2])
    smoother.move(_FARTHER * change)
    smoother.adjust(_FINAL_M)
    farther = smoother.log_posterior(_FINAL_M)
    if farther <= gained:
        _set_knots(smoother, after)
        smoother.shares, smoother.density = shares, density
    return farther


def _rematch(smoother: Smoother, neighbours: int) -> None:
    """Match every segment of each track with all but itself and its neighbours."""
    segment = np.full(len(smoother.poses), -1)
    for number, first in smoother.first.items():
        rows = smoother.tracks[number].rows
        segment[rows] = (smoother.knot[rows] - first) // _SEGMENT
    for sigma_m in _MATCHED_M:
        smoother.map(sigma_m)
        everything = smoother.heard_by(smoother.active)
        information = np.zeros((len(smoother.poses), 2, 2))
        gradient = np.zeros((len(smoother.poses), 2))
        for number in smoother.first:
            is_own = np.zeros(len(segment), np.bool_)
            is_own[smoother.tracks[number].rows] = True
            for one in range(int(segment[is_own].max()) + 1):
                near = is_own & (np.abs(segment - one) <= neighbours)
                others = everything - smoother.heard_by(near)
                pulls = smoother.pull(others, is_own & (segment == one), sigma_m)
                information += pulls[0]
                gradient += pulls[1]
        for number in smoother.first:
            smoother.match(number, 0, len(smoother.knots[number]) - 1, (information, gradient))
        smoother.spread()


def _knots(smoother: Smoother) -> FloatArray:
    """All knots that may move, one behind the other."""
    return np.concatenate([smoother.knots[number] for number in smoother.first])


def _set_knots(smoother: Smoother, knots: FloatArray) -> None:
    change = knots - _knots(smoother)
    change[:, 2] = wrapped(change[:, 2])
    smoother.move(change)


def _at_pings(smoother: Smoother) -> Found:
    """Poses of all pings, and how well each is known."""
    kept = _knots(smoother)
    for _ in range(3):
        smoother.map(_FINEST_M)
    at_knots = smoother.adjust(_FINEST_M)
    _set_knots(smoother, kept)
    return of_pings(smoother, at_knots)
