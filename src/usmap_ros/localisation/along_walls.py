"""The search along walls: what was gone so far is adjusted to the walls that it shows."""

from __future__ import annotations

import copy
import math

from usmap_ros.localisation.equations import covariances
from usmap_ros.localisation.found import Found, average, of_pings
from usmap_ros.localisation.smoother import Smoother
from usmap_ros.localisation.walls import find_walls
from usmap_ros.numerics.arrays import FloatArray

#: How far walls may seem to be off, m, one after the other; steps for each before the last one.
_WALLS_M, _WALL_STEPS = (0.1, 0.05), 2
#: Knots that are added at once on the way along walls, one search for each: in short stretches
#: little drift is added at once, in long ones much is seen of walls that are new.  All at once is
#: surest where odometry is so good that poses as told show walls; it also tells the others how well
#: odometry is known.  Readings of the first thing only gain nothing by the last one.
_STRETCHES = (10**6, 12, 6, 3)
#: How far walls may seem to be off at the end of a search, m, one after the other; how far lines
#: are found by, at the least, or a wall would be found twice.
_TOWARDS_THE_END_M, _FOUND_M = (0.05, 0.05, 0.04, 0.04, 0.03, 0.03, 0.03, 0.03), 0.03
#: The same last of all, but for readings of the first thing only: ways of drones got worse by that.
_AT_THE_END_M = 0.02
#: Ends that differ by less of log-likelihood are much alike: so much it is off by which lines are
#: found.
_ALIKE = 20.0
#: By so much, for the root of the number of echoes, it is off by chance: poses as told stand unless
#: something is likelier by more.
_BY_CHANCE = 0.5
#: Stretches at the most.
_MOST_STRETCHES = 40


def gained_by_walls(told: Smoother) -> float:
    """How much likelier each echo is by walls that poses show as they are told."""
    blur_m = _WALLS_M[0]
    walls = find_walls(told.echoes, told.poses, told.active, blur_m)
    return told.log_posterior_of(walls, blur_m) / float(told.echoes.weight.sum())


def along_walls(start: Smoother) -> Found | None:
    """Go along with all robots, and average ends by how likely walls and odometry make them.

    Parameters
    ----------
    start : Smoother
        With poses as they were told.

    Returns
    -------
    Found or None
        None where no end is more likely than what was told.
    """
    start.active[:] = True
    first_only = start.echoes.are_first_only
    finest_m = _FOUND_M if first_only else _AT_THE_END_M
    ends, least = [], _likely_by_walls(start, finest_m)
    if first_only:
        least += _BY_CHANCE * math.sqrt(float(start.echoes.weight.sum()))
    for stretch in _STRETCHES[: -1 if first_only else None]:
        one = copy.deepcopy(start)
        factor = _go_along_walls(one, stretch)
        # The next search knows by this one how well odometry is known.
        for track, so_far in zip(start.tracks, one.tracks, strict=True):
            track.spread = so_far.spread
        left_open = one.left_open(factor) if first_only else 0.0
        if not first_only:
            _adjust_to_walls(one, finest_m)
        likely = _likely_by_walls(one, finest_m) - left_open
        if likely > least:
            ends.append((likely / _ALIKE, of_pings(one, covariances(factor, one.knot_count))))
    return average(ends) if ends else None


def _likely_by_walls(smoother: Smoother, sigma_m: float) -> float:
    """How likely poses are by the walls that they show, whatever others they were adjusted to."""
    walls = find_walls(smoother.echoes, smoother.poses, smoother.active, _FOUND_M)
    return smoother.log_posterior_of(walls, sigma_m)


def _go_along_walls(smoother: Smoother, stretch: int) -> tuple[FloatArray, bool]:
    """Adjust what was gone so far to the walls that it shows, each time with so many knots more.

    Returns
    -------
    factor
        Decomposition for `covariances`.  By finer ranges poses would seem to be known better than
        they are: what walls are off, they are off for many pings alike.
    """
    longest = max(map(len, smoother.knots))
    stretches = min(-(-longest // stretch), _MOST_STRETCHES)
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
    factor = _adjust_to_walls(smoother, _TOWARDS_THE_END_M[0])
    for blur_m in _TOWARDS_THE_END_M[1:]:
        factor = _adjust_to_walls(smoother, blur_m)
        smoother.weigh_odometry(factor)
    return factor


def _adjust_to_walls(smoother: Smoother, sigma_m: float) -> tuple[FloatArray, bool]:
    """Adjust poses and walls together; gives the decomposition for `covariances`."""
    found_m = max(sigma_m, _FOUND_M)
    walls = find_walls(smoother.echoes, smoother.poses, smoother.active, found_m)
    for _ in range(_WALL_STEPS):
        walls, _ = smoother.adjust_to(walls, sigma_m)
    _, factor = smoother.adjust_to(walls, sigma_m)
    return factor
