"""The search for poses: from several starts, coarse to fine, and never worse than none."""

from __future__ import annotations

import copy
from dataclasses import dataclass

import numpy as np

from usmap_ros.localisation.equations import covariances
from usmap_ros.localisation.planar import wrapped
from usmap_ros.localisation.smoother import Smoother
from usmap_ros.localisation.walls import Walls, find_walls
from usmap_ros.numerics.arrays import BoolArray, FloatArray

#: Knots by which a robot's own map lags behind it where robots are followed: one search for each.
_LAGS = (6, 3)
#: Improvements of each, and rounds of one: between them it is asked anew how much echoes count.
_IMPROVEMENTS, _ROUNDS = 2, 3
#: Blur, m, and steps of the adjustment that ends each search: so fine that ranges count by nearly
#: what they are worth.
_FINER = ((0.08, 10), (0.05, 10), (0.03, 10), (0.02, 30))
_FINEST_M = _FINER[-1][0]
#: What lines of walls, with what they cost, gain of log-likelihood an echo where it is walls: among
#: poles it was 0.2 to 0.43, in rooms 0.49 and more.  Share of echoes from places that pings share,
#: with the poses that points make most likely: among poles it was 0.43 and more, in rooms up to
#: 0.26.  Where both are less, too few pings share anything, and points are the safer guess.
_WALLED, _POINTS, _LEAST_WALLED = 0.52, 0.35, 0.4
#: Weight of an echo of points, over the square of that share; the least one to begin with, since
#: poses that are far off share little, and the most.
_OF_POINTS, _LEAST_WEIGHT, _MOST_WEIGHT = 6.0, 0.3, 1.0
#: How far walls may seem to be off, m, one after the other; steps for each before the last one.
_WALLS_M, _WALL_STEPS = (0.1, 0.05), 2
#: Knots that are added at once on the way along walls, one search for each: in short stretches
#: little drift is added at once, in long ones much is seen of walls that are new.
_STRETCHES = (12, 3)
#: How far walls may seem to be off at the end of a search, m, one after the other, and last of all.
_TOWARDS_THE_END_M, _AT_THE_END_M = (0.05, 0.05, 0.04, 0.03), 0.03
#: Blur, m: of a match while robots go, of matches of a round, and of the field in the end.
_FOLLOWED_M, _MATCHED_M, _FINAL_M = (0.08, 0.067, 0.053, 0.04), (0.12, 0.06), 0.05
#: Steps of robots that look at all that was heard so far, at the most.
_STEPS = 40
#: Knots of a segment that is matched with what is not its own neighbourhood.
_SEGMENT = 6
#: A change that was for the better is tried again, so many times as large.
_FARTHER = 4.0
#: Rounds until the field of poses as they were told no longer changes.
_WARM_UP = 8


@dataclass(frozen=True)
class Found:
    """Poses that were found.

    Parameters
    ----------
    poses : (n, 3) array
        x, y (m) and yaw (rad).
    covariances : (n, 3, 3) array
        Of these; NaN of poses that were not looked for.
    """

    poses: FloatArray
    covariances: FloatArray


def search(start: Smoother) -> Found | None:
    """Find poses that odometry and all echoes together make most likely.

    Parameters
    ----------
    start : Smoother
        With poses as they were told.

    Returns
    -------
    Found or None
        None where nothing is more likely than what was told.
    """
    if len(start.echoes.ping) == 0:
        return None
    told = copy.deepcopy(start)
    told.active[:] = True
    for _ in range(_WARM_UP):
        told.map(_FINAL_M)
    gained = _gained_by_walls(told)
    # Sensors that hear surfaces from any side hear some in every beam, poles or not.
    if gained > _WALLED or np.median(start.echoes.aslant_rad) > 0.0:
        return _along_walls(start)
    ends = _among_points(start, max(_LEAST_WEIGHT, _weight(told)))
    if max(one.shared() for one in ends) < _POINTS:
        gained = max(gained, *map(_gained_by_walls, ends))
        if gained > _LEAST_WALLED:
            return _along_walls(start)
    for one in ends:
        for blur_m, steps in _FINER:
            for _ in range(steps):
                one.adjust(blur_m)
    told.trust(ends[0].weight)
    least = told.log_posterior(_FINEST_M)
    found = [(one.log_posterior(_FINEST_M), one) for one in ends]
    found = [(gained, one) for gained, one in found if gained > least]
    return _average(found) if found else None


def _among_points(start: Smoother, weight: float) -> list[Smoother]:
    """Where searches end that take all that answers for points, with the same weight of echoes."""
    ends = []
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


def _weight(smoother: Smoother) -> float:
    """How much an echo counts, by how many come from places that pings share."""
    for _ in range(2):
        smoother.map(_FINAL_M)
    return min(_MOST_WEIGHT, _OF_POINTS * smoother.shared() ** 2)


def _gained_by_walls(told: Smoother) -> float:
    """How much likelier each echo is by walls that poses show as they are told."""
    blur_m = _WALLS_M[0]
    walls = find_walls(told.echoes, told.poses, told.active, blur_m)
    return told.log_posterior_of(walls, blur_m) / float(told.echoes.weight.sum())


def _along_walls(start: Smoother) -> Found | None:
    """Go along with all robots, and take what walls and odometry make most likely in the end."""
    start.active[:] = True
    best, most = None, _likely_by_walls(start)
    for stretch in _STRETCHES:
        one = copy.deepcopy(start)
        _go_along_walls(one, stretch)
        _, factor = _adjust_to_walls(one, _AT_THE_END_M)
        likely = _likely_by_walls(one)
        if likely > most:
            best, most = _of_pings(one, covariances(factor, one.knot_count)), likely
    return best


def _likely_by_walls(smoother: Smoother) -> float:
    """How likely poses are by the walls that they show, whatever others they were adjusted to."""
    walls = find_walls(smoother.echoes, smoother.poses, smoother.active, _AT_THE_END_M)
    return smoother.log_posterior_of(walls, _AT_THE_END_M)


def _go_along_walls(smoother: Smoother, stretch: int) -> None:
    """Adjust what was gone so far to the walls that it shows, each time with so many knots more."""
    longest = max(map(len, smoother.knots))
    stretches = min(-(-longest // stretch), _STEPS)
    for number in range(1, stretches + 1):
        last = longest * number // stretches
        for robot, first in smoother.first.items():
            rows = smoother.tracks[robot].rows
            smoother.active[rows] = smoother.knot[rows] - first < last
        for blur_m in _WALLS_M:
            _adjust_to_walls(smoother, blur_m)
        for robot in smoother.first:
            smoother.predict(robot, min(last, len(smoother.knots[robot]) - 1))
        smoother.spread()
    for blur_m in _TOWARDS_THE_END_M:
        _adjust_to_walls(smoother, blur_m)


def _adjust_to_walls(smoother: Smoother, sigma_m: float) -> tuple[Walls, tuple[FloatArray, bool]]:
    walls = find_walls(smoother.echoes, smoother.poses, smoother.active, sigma_m)
    for _ in range(_WALL_STEPS):
        walls, _ = smoother.adjust_to(walls, sigma_m)
    return smoother.adjust_to(walls, sigma_m)


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


def _average(ends: list[tuple[float, Smoother]]) -> Found:
    """Poses that the ends of several searches have on average, by how likely they are.

    What they differ by is uncertain, and counts as such.
    """
    gained = np.array([one for one, _ in ends])
    weights = np.exp(gained - gained.max())
    weights /= weights.sum()
    found = [_at_pings(one) for _, one in ends]
    first = found[0].poses
    apart = np.array([one.poses - first for one in found])
    apart[:, :, 2] = wrapped(apart[:, :, 2])
    mean = np.einsum("e,enj->nj", weights, apart)
    off = apart - mean
    spread = np.einsum("e,eni,enj->nij", weights, off, off)
    within = np.einsum("e,enij->nij", weights, np.array([one.covariances for one in found]))
    poses = first + mean
    poses[:, 2] = wrapped(poses[:, 2])
    return Found(poses, within + spread)


def _at_pings(smoother: Smoother) -> Found:
    """Poses of all pings, and how well each is known."""
    kept = _knots(smoother)
    for _ in range(3):
        smoother.map(_FINEST_M)
    at_knots = smoother.adjust(_FINEST_M)
    _set_knots(smoother, kept)
    return _of_pings(smoother, at_knots)


def _of_pings(smoother: Smoother, at_knots: FloatArray) -> Found:
    """The poses as they are, with covariances between those of the knots."""
    known = np.full((len(smoother.poses), 3, 3), np.nan)
    for number, first in smoother.first.items():
        rows = smoother.tracks[number].rows
        before, share = smoother.knot[rows], smoother.share[rows][:, np.newaxis, np.newaxis]
        after = np.minimum(before + 1, first + len(smoother.knots[number]) - 1)
        known[rows] = (1.0 - share) * at_knots[before] + share * at_knots[after]
    return Found(smoother.poses.copy(), known)
