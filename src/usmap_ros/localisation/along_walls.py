"""The search along walls: what was gone so far is adjusted to the walls that it shows."""

from __future__ import annotations

import copy

from usmap_ros.localisation.equations import covariances
from usmap_ros.localisation.found import Found, of_pings
from usmap_ros.localisation.smoother import Smoother
from usmap_ros.localisation.walls import Walls, find_walls
from usmap_ros.numerics.arrays import FloatArray

#: How far walls may seem to be off, m, one after the other; steps for each before the last one.
_WALLS_M, _WALL_STEPS = (0.1, 0.05), 2
#: Knots that are added at once on the way along walls, one search for each: in short stretches
#: little drift is added at once, in long ones much is seen of walls that are new.
_STRETCHES = (12, 3)
#: How far walls may seem to be off at the end of a search, m, one after the other, and last of all.
_TOWARDS_THE_END_M, _AT_THE_END_M = (0.05, 0.05, 0.04, 0.03), 0.03
#: Stretches at the most.
_MOST_STRETCHES = 40


def gained_by_walls(told: Smoother) -> float:
    """How much likelier each echo is by walls that poses show as they are told."""
    blur_m = _WALLS_M[0]
    walls = find_walls(told.echoes, told.poses, told.active, blur_m)
    return told.log_posterior_of(walls, blur_m) / float(told.echoes.weight.sum())


def along_walls(start: Smoother) -> Found | None:
    """Go along with all robots, and take what walls and odometry make most likely in the end.

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
    best, most = None, _likely_by_walls(start)
    for stretch in _STRETCHES:
        one = copy.deepcopy(start)
        _go_along_walls(one, stretch)
        _, factor = _adjust_to_walls(one, _AT_THE_END_M)
        likely = _likely_by_walls(one)
        if likely > most:
            best, most = of_pings(one, covariances(factor, one.knot_count)), likely
    return best


def _likely_by_walls(smoother: Smoother) -> float:
    """How likely poses are by the walls that they show, whatever others they were adjusted to."""
    walls = find_walls(smoother.echoes, smoother.poses, smoother.active, _AT_THE_END_M)
    return smoother.log_posterior_of(walls, _AT_THE_END_M)


def _go_along_walls(smoother: Smoother, stretch: int) -> None:
    """Adjust what was gone so far to the walls that it shows, each time with so many knots more."""
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
    for blur_m in _TOWARDS_THE_END_M:
        _adjust_to_walls(smoother, blur_m)


def _adjust_to_walls(smoother: Smoother, sigma_m: float) -> tuple[Walls, tuple[FloatArray, bool]]:
    walls = find_walls(smoother.echoes, smoother.poses, smoother.active, sigma_m)
    for _ in range(_WALL_STEPS):
        walls, _ = smoother.adjust_to(walls, sigma_m)
    return smoother.adjust_to(walls, sigma_m)
