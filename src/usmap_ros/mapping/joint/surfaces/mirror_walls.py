"""Walls that answer as mirrors do: where struck squarely, at the foot of the perpendicular.

A wall with unit normal n at distance ρ from the origin returns one echo to each ping whose beam
holds the perpendicular on it, from range ρ - p·n.  Echoes that no reliable cell explains vote for
(direction of n, ρ); the best stretch of feet, where hits count for the wall and loud misses
against it, is the wall.  A rough wall looks the same at its nearest point, but many echoes of it
follow: a mirror is followed by few.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.surfaces.mirror_criteria import (
    ANY,
    USUAL,
    MirrorCriteria,
    fitted,
    tells_direction,
)
from usmap_ros.mapping.joint.surfaces.mirror_fits import (
    MirrorSearch,
    candidates,
    share_that_heard,
)
from usmap_ros.mapping.joint.surfaces.mirror_odds import LEAST_ODDS, mirror_odds
from usmap_ros.mapping.joint.surfaces.mirrors import (
    MirrorWall,
    face_usually,
    squared,
    without_doubles,
)
from usmap_ros.mapping.joint.surfaces.multiple_reflections import images, reflected, seen_directly
from usmap_ros.mapping.joint.surfaces.round_column import RoundColumn
from usmap_ros.mapping.joint.visibility.echoes import Echoes, mirror_levels
from usmap_ros.mapping.ping_table import ABSORPTION, PingTable, X, Y
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.processes.threads import in_turn

#: Amplitude reflectivities that a mirror may have, over what the loudest echo of one ping in ten
#: means, for most pings hear nothing squarely, but a floor; and where ranges alone are known.
LEAST_MIRROR, MOST_MIRROR, LOUD_PINGS, OF_RANGES = 0.3, 2.0, 0.1, (0.25, 1.6)
#: Mirrors that are found at the most.
MOST_WALLS = 60
#: Echoes that follow a mirror's own at the most, on the mean.
MOST_FOLLOWING = 3.2
#: One whose loudness varies less than this, as a median deviation of its logarithm, and that many
#: heard, is a mirror whatever else is heard: along rough walls chance lines up 16 such echoes.
STEADY, CERTAIN_HITS = 0.07, 35
#: Pings that must have heard likely mirrors: two poles make a line of six.
LEAST_HITS = 9
#: Where cells explain such a share of all echoes, likely mirrors are lines of poles: of rooms that
#: have mirrors they explain 0.65 at the most, of poles that line up, above a floor, 0.72 and more.
MOST_EXPLAINED = 0.7
#: Walls of one place are mostly alike: logarithms of reflectivities that differ by less.
ALIKE = 0.25
#: Logarithm of reflectivity by which single echoes of a place's mirrors differ from the usual one.
BAND = 0.4
#: What comes first came by way of no other mirror: if it varies less than this, and few follow, it
#: may be of a wall that is by so much fainter; how far behind the first others came with it, m.
NEARLY_STEADY, FAINTER, FIRST_M = 0.16, 1.6, 0.05
#: How far beside a mirror others would be, m, and share of its pings at the most that heard as much
#: there: where a floor, or sound that came by way of many things, fills all ranges, some lines up.
BESIDE_M, MOST_BESIDE = (-0.2, -0.16, -0.12, 0.12, 0.16, 0.2), 0.2


def mirror_walls(
    table: PingTable,
    pings: NDArray[np.int64],
    echoes: Echoes,
    is_explained: BoolArray,
    is_usable: BoolArray,
    first_only: BoolArray,
) -> list[MirrorWall]:
    """Mirrors of a place that has some.

    Echoes that nothing else explains tell whether there are any, and of which reflectivity; then
    all echoes tell where.

    Parameters
    ----------
    table : PingTable
        Pings.
    pings : (pings,) integer array
        Their rows.
    echoes : Echoes
        Theirs.
    is_explained : (echoes,) bool array
        Whether reliable cells explain an echo.
    is_usable : (echoes,) bool array
        Whether a mirror may explain an echo.
    first_only : (pings,) bool array
        Pings of sensors that report the first thing only.
    """
    among = perpendicular_walls(table, pings, echoes, ~is_explained, first_only)
    places_m = table.numbers[pings][:, [X, Y]]
    usual = _usual_mirror(among, places_m, _share_of(is_explained, is_usable))
    if usual is None:
        return []
    faintest, loudest = math.exp(usual - BAND), math.exp(usual + BAND)
    search = MirrorSearch(table, pings, echoes, is_usable, first_only, faintest, loudest)
    walls = _likelier_than_points(
        seen_directly(without_doubles(found_mirrors(search, ANY)), places_m)
    )
    is_left = left_of(is_usable & ~reflected(walls, table, pings, echoes), walls)
    more = found_mirrors(search._replace(is_open=is_left), USUAL)
    faces_usually = face_usually(more, walls)
    walls += [wall for wall, is_usual in zip(more, faces_usually, strict=True) if is_usual]
    is_left = left_of(is_left & ~is_explained & _are_first(echoes), walls)
    dim = search._replace(is_open=is_left, faintest=math.exp(usual - FAINTER), loudest=faintest)
    fainter = _likelier_than_points(found_mirrors(dim, ANY))
    walls += [each for each in fainter if each.deviation < NEARLY_STEADY and _is_bare(each)]
    seen = seen_directly(without_doubles(walls), places_m)
    still = [wall for wall in seen if _is_still(wall, places_m) and stands_out(search, wall)]
    return squared(still, places_m, echoes)


def stands_out(search: MirrorSearch, wall: MirrorWall) -> bool:
    """Whether more is heard of a wall than of what would be beside it.

    Parameters
    ----------
    search : MirrorSearch
        With the echoes that mirrors may explain.
    wall : MirrorWall
        One that was found among them.
    """
    beside = [
        share_that_heard(search, wall.pings, wall.normal_rad, wall.distance_m + beside_m)
        for beside_m in BESIDE_M
    ]
    return float(np.mean(beside)) <= MOST_BESIDE


def _is_still(wall: MirrorWall, places_m: FloatArray) -> bool:
    """Whether what is left of a wall, without the pings that others hide it from, tells of one."""
    feet_m = wall.feet_m(places_m)
    return len(feet_m) >= USUAL.hits and tells_direction(USUAL, np.sort(feet_m))


def left_of(is_open: BoolArray, things: Iterable[MirrorWall | RoundColumn]) -> BoolArray:
    """Which of some (echoes,) that are open are of none of some things."""
    is_left = is_open.copy()
    for thing in things:
        is_left[thing.echoes] = False
    return is_left


def _are_first(echoes: Echoes) -> BoolArray:
    """Whether each echo comes with the first of its ping, and so by way of nothing else."""
    count = np.diff(echoes.start)
    first_m = echoes.range_m[np.minimum(echoes.start[:-1], len(echoes.range_m) - 1)]
    are_first: BoolArray = echoes.range_m <= np.repeat(first_m, count) + FIRST_M
    return are_first


def _likelier_than_points(walls: list[MirrorWall]) -> list[MirrorWall]:
    """Walls but for those that points explain as well, unless they face as many do."""
    pairs = zip(walls, face_usually(walls, walls), strict=True)
    return [wall for wall, is_usual in pairs if is_usual or wall.over_point > 0.0]


def _is_bare(wall: MirrorWall) -> bool:
    """Whether as few echoes follow a wall's own as follow a mirror's."""
    return wall.following < MOST_FOLLOWING


def _usual_mirror(found: list[MirrorWall], places_m: FloatArray, explained: float) -> float | None:
    """Logarithm of the reflectivity of most mirrors among what was heard squarely, if any are.

    What came over several mirrors is the steadier, and fainter: it speaks for those in which it
    stands.
    """
    found = without_doubles(found)
    if not found:
        return None
    hits = np.array([len(wall.echoes) for wall in found])
    odds, is_image = mirror_odds(found, explained), images(found, places_m)
    # One that was heard steadily by many is a mirror, whatever else stands there.
    are_certain = (hits >= CERTAIN_HITS) & [wall.deviation < STEADY for wall in found]
    are_direct = ~is_image.any(axis=1)
    likely = is_image[are_certain].any(axis=0) | (are_certain & are_direct)
    if not likely.any():
        likely = odds > 0.0
        if explained > MOST_EXPLAINED or odds.sum() < LEAST_ODDS or hits[likely].sum() < LEAST_HITS:
            return None
        likely = likely & are_direct if (likely & are_direct).any() else likely
    logs = np.array([wall.log_mirror for wall in found])
    groups = (np.abs(logs - logs[:, np.newaxis]) < ALIKE) & likely
    alike = groups[int(np.argmax(groups @ hits))]
    return float(np.average(logs[alike], weights=hits[alike]))


def _share_of(is_explained: BoolArray, is_usable: BoolArray) -> float:
    """Share of usable echoes that reliable cells explain."""
    # Of echoes of other parts of the place nothing is asked.
    return int((is_explained & is_usable).sum()) / max(int(is_usable.sum()), 1)


def perpendicular_walls(
    table: PingTable,
    pings: NDArray[np.int64],
    echoes: Echoes,
    is_open: BoolArray,
    first_only: BoolArray,
) -> list[MirrorWall]:
    """Walls that are heard at the feet of perpendiculars, whether or not from elsewhere, too.

    Parameters
    ----------
    table, pings, echoes, first_only
        As in `mirror_walls`.
    is_open : (echoes,) bool array
        Whether an echo may be one's.
    """
    return found_mirrors(mirror_search(table, pings, echoes, is_open, first_only), ANY)


def mirror_search(
    table: PingTable,
    pings: NDArray[np.int64],
    echoes: Echoes,
    is_open: BoolArray,
    first_only: BoolArray,
    faintest: float = LEAST_MIRROR,
) -> MirrorSearch:
    """Where mirrors are looked for that are as loud as the loudest of some echoes, or nearly so.

    Parameters
    ----------
    table, pings, echoes, first_only
        As in `mirror_walls`.
    is_open : (echoes,) bool array
        Whether an echo may be one's.
    faintest : float
        Least amplitude reflectivity of one over what the loudest open echo of one ping in ten
        means, if not ranges alone are known.
    """
    limits = _loudness(table, pings, echoes, is_open, first_only, faintest)
    return MirrorSearch(table, pings, echoes, is_open, first_only, *limits)


def _loudness(
    table: PingTable,
    pings: NDArray[np.int64],
    echoes: Echoes,
    is_open: BoolArray,
    first_only: BoolArray,
    faintest: float,
) -> tuple[float, float]:
    """Amplitude reflectivities that mirrors may have, by what pings' loudest open echoes mean."""
    ping = np.repeat(np.arange(len(pings)), np.diff(echoes.start))
    is_open = is_open & ~first_only[ping]
    level = mirror_levels(echoes, table.numbers[pings[ping], ABSORPTION])
    loudest = np.zeros(len(pings))
    np.maximum.at(loudest, ping[is_open], level[is_open])
    if not loudest.any():
        return OF_RANGES
    loud = float(np.quantile(loudest[loudest > 0.0], 1.0 - LOUD_PINGS))
    return faintest * loud, MOST_MIRROR * loud


def found_mirrors(search: MirrorSearch, bar: MirrorCriteria) -> list[MirrorWall]:
    """Mirrors that explain echoes.

    Parameters
    ----------
    search : MirrorSearch
        Where they are looked for.
    bar : MirrorCriteria
        What each must have.
    """
    search = search._replace(is_open=search.is_open.copy())
    found: list[MirrorWall] = []

    def take(candidate: tuple[float, float], wall: MirrorWall | None) -> bool:
        is_found = wall is not None and len(found) < MOST_WALLS
        while wall is not None and len(found) < MOST_WALLS:
            found.append(wall)
            search.is_open[wall.echoes] = False
            # Farther along the same line there may be more of it.
            wall = fitted(search, bar, wall.normal_rad, wall.distance_m)
        return is_found

    in_turn(lambda line: fitted(search, bar, *line), candidates(search, bar.hits), take)
    return found
