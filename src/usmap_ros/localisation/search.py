"""The search for poses: what was gone so far is adjusted to the landmarks that it shows."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator
from typing import NamedTuple

from usmap_ros.localisation.data_association import associate_echoes
from usmap_ros.localisation.echo_table import first_of_each_ping
from usmap_ros.localisation.found import FoundPoses, average, of_pings
from usmap_ros.localisation.lines_and_points import Landmarks
from usmap_ros.localisation.smoother import Smoother
from usmap_ros.localisation.votes import find_landmarks, find_lines
from usmap_ros.numerics.arrays import FloatArray

#: How far walls may seem to be off, m, one after the other; steps for each before the last one.
_WALLS_M, _WALL_STEPS = (0.1, 0.05), 2
#: Knots that are added at once on the way along walls, one search for each: in short stretches
#: little drift is added at once, in long ones much is seen of walls that are new.  All at once is
#: surest where odometry is so good that poses as told show walls; it also tells the others how well
#: odometry is known.
_STRETCHES = (10**6, 12, 6)
#: How far walls may seem to be off, m, for points to be looked for.  Where poses are worse, points
#: among smooth walls are mostly chance, and lead a search astray; among poles, which have few walls
#: to follow, one more search takes them from its start.
_POINTS_M = 0.04
#: Stretches of all searches, from when on they look for points, and whether they go along by the
#: first echo of each ping: among smooth walls later ones lead astray, among rough ones they are
#: missed.  All ends are adjusted to all echoes, and weighed by them.
_SEARCHES = (
    *((stretch, _POINTS_M, False) for stretch in _STRETCHES),
    (_STRETCHES[-1], math.inf, False),
    (_STRETCHES[1], _POINTS_M, True),
)
#: The same for readings of the first thing only: corners are points, but some searches do without.
_SEARCHES_FIRST_ONLY = (
    *((stretch, 0.0, False) for stretch in _STRETCHES),
    (_STRETCHES[0], _POINTS_M, False),
    (_STRETCHES[-1], math.inf, False),
)
#: A search by first echoes counts where there is one line for so many points, at the least: among
#: poles most of what tells is left out, and poses that were right were bent to what is left.
_POINTS_A_LINE = 3.0
#: How far walls may seem to be off at the end of a search, m, one after the other; how far lines
#: are found by, at the least, or a wall would be found twice.
_TOWARDS_THE_END_M, _FOUND_M = (0.05, 0.05, 0.04, 0.04, 0.03, 0.03, 0.03, 0.03), 0.03
#: The same last of all, but for readings of the first thing only: ways of drones got worse by that.
_AT_THE_END_M = 0.02
#: Times that noise is told by how far echoes are off landmarks; how much wider than that it is, for
#: poses have taken some of it up; and what it is at the least and the most, m.
_NOISE_ROUNDS, _WIDER, _LEAST_M, _MOST_M = 2, 1.2, 0.01, 0.03
#: Ends that differ by less of log-likelihood are much alike: so much it is off by which lines are
#: found.
_ALIKE = 20.0
#: The same of the first echoes alone, which count beside all of them: they come the straight way,
#: while later ones along smooth walls may fit a room that is turned as well as the right one.
_ALIKE_FIRST = 10.0
#: By so much, for the root of the number of echoes, it is off by chance and by furniture: poses as
#: told stand unless something is likelier by more.  In two offices, where it misled, that was 0.3
#: at the most; where it was right, 1.9 to 6 in seven mazes, and 0.8 and more in flats.
_BY_CHANCE = 0.6
#: Where ways seem to be so many standard deviations longer or shorter than odometry tells, they are
#: looked for with ways as told as well, but for so much: echoes of echoes meet more often in a
#: place that is smaller, and drew a corridor together by a fifth.
_FAR_OFF, _AS_TOLD_STD = 2.5, 0.003
#: Stretches at the most.
_MOST_STRETCHES = 40


class Adjusted(NamedTuple):
    """What poses were adjusted to."""

    #: What stands.
    landmarks: Landmarks
    #: (array, bool): decomposition of the equations of the knots, for `covariances`.
    factor: tuple[FloatArray, bool]
    #: How far echoes were taken to be off landmarks.
    sigma_m: float


def search(start: Smoother, before: FloatArray | None = None) -> FoundPoses | None:
    """Go along with all robots, and average ends by how likely landmarks and odometry make them.

    Parameters
    ----------
    start : Smoother
        With poses as they were told.
    before : (n, 3) array, optional
        Poses that were found by less than is known now: one search more begins with them, so that
        what they had right is not lost where the others go astray.

    Returns
    -------
    Found or None
        None where no end is clearly more likely than what was told.
    """
    if len(start.echoes.ping) == 0:
        return None
    start.active[:] = True
    first_only = start.echoes.are_first_only
    finest_m = _FOUND_M if first_only else _AT_THE_END_M
    told, ends = _likely_by_landmarks(start, finest_m), []
    searches = _SEARCHES_FIRST_ONLY if first_only else _SEARCHES
    if before is not None:
        searches = (searches[0], *searches)
    for number, (stretch, points_m, by_first) in enumerate(searches):
        begin = before if number == 0 else None
        for one, so_far in _searched(start, stretch, points_m, by_first, begin):
            # The next search knows by this one how well odometry is known.
            for track, searched in zip(start.tracks, one.tracks, strict=True):
                track.spread = searched.spread
            left_open = one.left_open(so_far.factor) if first_only else 0.0
            adjusted = so_far if first_only else _by_noise(one, points_m)
            likely = _likely_by_landmarks(one, finest_m) - left_open
            if likely > told and not (by_first and _are_mostly_points(adjusted.landmarks)):
                known = one.known_by(adjusted.landmarks, adjusted.sigma_m)
                ends.append((likely, likely / _ALIKE + _first_alike(one), of_pings(one, known)))
    by_chance = _BY_CHANCE * math.sqrt(float(start.echoes.weight.sum())) if first_only else 0.0
    if max((likely for likely, *_ in ends), default=told) <= told + by_chance:
        return None
    return average([(weight, found) for _, weight, found in ends])


def _searched(
    start: Smoother, stretch: int, points_m: float, by_first: bool, begin: FloatArray | None
) -> Iterator[tuple[Smoother, Adjusted]]:
    """Where one search of `_SEARCHES` ends, and where it does with ways as odometry tells them."""
    are_as_told = False
    while True:
        one = copy.deepcopy(start)
        if begin is not None:
            one.begin_with(begin)
        if by_first:
            one.echoes = first_of_each_ping(start.echoes)
        adjusted = _go_along(one, stretch, points_m)
        one.echoes = start.echoes
        far_off = [abs(each.scale - 1.0) > _FAR_OFF * each.scale_std for each in one.tracks]
        yield one, adjusted
        if are_as_told or not any(far_off):
            return
        are_as_told, start = True, copy.deepcopy(start)
        for track, is_far_off in zip(start.tracks, far_off, strict=True):
            track.scale_std = _AS_TOLD_STD if is_far_off else track.scale_std


def _are_mostly_points(landmarks: Landmarks) -> bool:
    """Whether hardly any of some landmarks are lines."""
    return len(landmarks.points_m) > _POINTS_A_LINE * len(landmarks.normals_rad)


def _first_alike(smoother: Smoother) -> float:
    """How likely poses are by first echoes alone, over what is much alike; 0 if all are first."""
    if smoother.echoes.are_first_only:
        return 0.0
    one = copy.copy(smoother)
    one.echoes = first_of_each_ping(smoother.echoes)
    return _likely_by_landmarks(one, _AT_THE_END_M) / _ALIKE_FIRST


def _by_noise(smoother: Smoother, points_m: float) -> Adjusted:
    """Adjust poses to landmarks by how far echoes are really off them; see `_go_along`."""
    sigma_m = _TOWARDS_THE_END_M[-1]
    for _ in range(_NOISE_ROUNDS - 1):
        sigma_m = _noise_m(smoother, sigma_m, points_m)
        _adjust_to_landmarks(smoother, sigma_m, points_m)
    return _adjust_to_landmarks(smoother, _noise_m(smoother, sigma_m, points_m), points_m)


def _noise_m(smoother: Smoother, sigma_m: float, points_m: float) -> float:
    """How far echoes seem to be off the landmarks that they are of, and one more by `sigma_m`."""
    landmarks = _landmarks(smoother, max(sigma_m, _FOUND_M), points_m)
    echoes = smoother.echoes
    heard = associate_echoes(echoes, smoother.poses, smoother.active, landmarks, sigma_m)
    weights = heard.shares * echoes.weight[heard.echo]
    total = float(weights @ heard.off_m**2) + sigma_m**2
    off_m = _WIDER * math.sqrt(total / (float(weights.sum()) + 1.0))
    return min(max(off_m, _LEAST_M), _MOST_M)


def _landmarks(smoother: Smoother, sigma_m: float, points_m: float) -> Landmarks:
    """Walls that echoes show, and points among them, such as poles and edges.

    Points are looked for where poses are not off by more than `points_m`.
    """
    find = find_landmarks if sigma_m <= points_m else find_lines
    return find(smoother.echoes, smoother.poses, smoother.active, sigma_m)


def _likely_by_landmarks(smoother: Smoother, sigma_m: float) -> float:
    """How likely poses are by the walls that they show, whatever others they were adjusted to."""
    walls = _landmarks(smoother, _FOUND_M, _POINTS_M)
    return smoother.log_posterior_of(walls, sigma_m)


def _go_along(smoother: Smoother, stretch: int, points_m: float) -> Adjusted:
    """Adjust what was gone so far to the walls that it shows, each time with so many knots more.

    Not by finer ranges, or poses would seem to be known better than they are: what walls are off,
    they are off for many pings alike.
    """
    longest = max(map(len, smoother.knots))
    stretches = min(-(-longest // stretch), _MOST_STRETCHES)
    for number in range(1, stretches + 1):
        last = longest * number // stretches
        for robot, first in smoother.first.items():
            rows = smoother.tracks[robot].rows
            smoother.active[rows] = smoother.knot[rows] - first < last
        for blur_m in _WALLS_M:
            _adjust_to_landmarks(smoother, blur_m, points_m)
        for robot in smoother.first:
            smoother.predict(robot, min(last, len(smoother.knots[robot]) - 1))
        smoother.spread()
    adjusted = _adjust_to_landmarks(smoother, _TOWARDS_THE_END_M[0], points_m)
    for blur_m in _TOWARDS_THE_END_M[1:]:
        adjusted = _adjust_to_landmarks(smoother, blur_m, points_m)
        smoother.weigh_odometry(adjusted.factor)
    return adjusted


def _adjust_to_landmarks(smoother: Smoother, sigma_m: float, points_m: float) -> Adjusted:
    """Adjust poses and walls together."""
    found_m = max(sigma_m, _FOUND_M)
    walls = _landmarks(smoother, found_m, points_m)
    for _ in range(_WALL_STEPS):
        walls, _ = smoother.adjust_to(walls, sigma_m)
    return Adjusted(*smoother.adjust_to(walls, sigma_m), sigma_m)
