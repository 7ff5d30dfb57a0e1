"""The search for poses: among points or along walls, and never worse than none."""

from __future__ import annotations

from usmap_ros.localisation.along_walls import along_walls, gained_by_walls
from usmap_ros.localisation.among_points import among_points, make_field, most_likely, with_all
from usmap_ros.localisation.found import Found
from usmap_ros.localisation.smoother import Smoother

#: What lines of walls, with what they cost, gain of log-likelihood an echo where it is walls: among
#: poles it was 0.2 to 0.43, in rooms 0.49 and more.  Share of echoes from places that pings share,
#: with the poses that points make most likely: among poles it was 0.43 and more, in rooms up to
#: 0.26.  Where both are less, too few pings share anything, and points are the safer guess.
_WALLED, _POINTS, _LEAST_WALLED = 0.52, 0.35, 0.4


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
    # Sensors that hear surfaces from any side hear some in every beam, poles or not.
    if start.echoes.are_first_only:
        return along_walls(start)
    told = with_all(start)
    gained = gained_by_walls(told)
    if gained > _WALLED:
        return along_walls(start)
    make_field(told)
    ends = among_points(start, told)
    if max(one.shared() for one in ends) < _POINTS:
        gained = max(gained, *map(gained_by_walls, ends))
        if gained > _LEAST_WALLED:
            return along_walls(start)
    return most_likely(ends, told)
