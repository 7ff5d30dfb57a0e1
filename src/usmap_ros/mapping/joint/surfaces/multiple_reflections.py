"""Echoes by way of several mirrors, and the walls that they seem to be.

Sound that a mirror sends on to another one and gets back comes from where the one stands in the
other: behind it, as far as the room is wide, where nothing is.  A way over walls A, B, … is as long
as the straight line to the transducer's image in A, of that in B, … (Allen & Berkley, "Image method
for efficiently simulating small-room acoustics", J. Acoust. Soc. Am. 65 (1979) 943-950), and no
louder than all of their reflectivities allow.
"""

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.surfaces.mirrors import MirrorWall, heard_by
from usmap_ros.mapping.joint.visibility.echoes import Echoes
from usmap_ros.mapping.ping_table import (
    ABSORPTION,
    GREATEST_RANGE,
    HALF_ANGLE,
    HEADING,
    RANGE_STD,
    PingTable,
    X,
    Y,
)
from usmap_ros.numerics.arrays import BoolArray, FloatArray, spans
from usmap_ros.numerics.geometry import wrapped

#: Reflections of a way at the most, and mirrors that are taken for it, those with most echoes.
MOST_REFLECTIONS, MOST_MIRRORS = 3, 10
#: An echo is that of a way if it is so near to where it should be, beyond what its range is
#: uncertain by, m, and no louder than so many times what mirrors on the beam's axis would return.
NEAR_M, LOUDER = 0.03, 1.5
#: Mirrors go on so far beyond the feet that were heard, m.
BEYOND_M = 0.3
#: A wall hides what is farther behind it than this, m, where a foot on it is this near; it is
#: another's image if such a share of its pings would have to hear it through others.
BEHIND_M, FOOT_M, HIDDEN_SHARE = 0.15, 0.15, 0.5
#: What is just where a wall stands in another one, so near, m, and as parallel, is an image if
#: that other one is aslant, and was heard as near as this, m, to where it is in the way.
JUST_M, JUST_COSINE, IMAGE_M, ASLANT_COSINE = 0.1, 0.999, 1.5, 0.97
#: Places that are nearer to each other than this, m, see the same.
APART_M = 0.2
#: A circle passes through a corner if it is so near, m; walls go on to a corner by so much, m, and
#: it is one if its sides differ by as much as this sine of their angle.
ROUND_CORNER_M, CORNER_BEYOND_M, CORNER_SINE = 0.05, 3.0, 0.5


def images(walls: Sequence[MirrorWall], places_m: FloatArray) -> BoolArray:
    """Whether each wall is heard with another one in the way, in which it is an image.

    Parameters
    ----------
    walls : sequence of MirrorWall
        Those that were heard.
    places_m : (pings, 2) array
        Where pings were heard from.

    Returns
    -------
    is_image : (walls, walls) bool array
        Of each in each.
    """
    return _stand_in(_crossings(walls, places_m))


def seen_directly(walls: Sequence[MirrorWall], places_m: FloatArray) -> list[MirrorWall]:
    """Walls that are no images, by the pings alone that have none of the others in the way.

    What stands in others from one room may be where there is a wall of the next one.

    Parameters
    ----------
    walls : sequence of MirrorWall
        Those that were heard.
    places_m : (pings, 2) array
        Where pings were heard from.
    """
    crossings = _crossings(walls, places_m)
    stands = ~_stand_in(crossings).any(axis=1)
    seen = list[MirrorWall]()
    for number in np.flatnonzero(stands).tolist():
        crossed: BoolArray = np.asarray(crossings[number][stands].any(axis=0))
        if crossed.mean() <= HIDDEN_SHARE:
            seen.append(heard_by(walls[number], ~crossed, places_m))
    return seen


def _stand_in(crossings: Sequence[BoolArray]) -> BoolArray:
    """Whether each wall is an image in each other, by which of its pings have that in the way."""
    shares = [crosses.mean(axis=1) for crosses in crossings]
    is_hidden = np.array(shares).reshape(len(crossings), len(crossings)) > HIDDEN_SHARE
    # What hides nothing but images may be one itself.
    stands = ~is_hidden.any(axis=1)
    return np.asarray(is_hidden & stands, bool)


def _crossings(walls: Sequence[MirrorWall], places_m: FloatArray) -> list[BoolArray]:
    """Of each wall, which of its pings have each other one in the way, (walls, hits)."""
    near_m = np.where(_are_just_in(walls, places_m), IMAGE_M, FOOT_M)
    return [
        np.array([_crosses(wall, other, places_m, near_m[k, m]) for m, other in enumerate(walls)])
        for k, wall in enumerate(walls)
    ]


def _are_just_in(walls: Sequence[MirrorWall], places_m: FloatArray) -> BoolArray:
    """Whether each wall is just where one of them stands in each other one, aslant, as an image.

    Who looks at one squarely through a gap in a wall that is parallel hears nothing of that; and
    where somebody was behind a wall, it does not go on.
    """
    axes = np.array([_axes(wall) for wall in walls]).reshape(-1, 2, 2)
    normals, distances_m = axes[:, 0], np.array([wall.distance_m for wall in walls])
    on_m = np.array([0.5 * (wall.begin_m + wall.end_m) for wall in walls])
    middles_m = distances_m[:, np.newaxis] * normals + on_m[:, np.newaxis] * axes[:, 1]
    are = np.zeros((len(walls), len(walls)), bool)
    for number, other in enumerate(walls):
        turned = normals @ normals[number]
        mirrored = normals - 2.0 * turned[:, np.newaxis] * normals[number]
        mirrored_m = distances_m - 2.0 * turned * other.distance_m
        are_there = np.abs(middles_m @ mirrored.T - mirrored_m) < JUST_M
        are_there &= normals @ mirrored.T > JUST_COSINE
        are[:, number] = are_there.any(axis=1) & (turned <= ASLANT_COSINE)
        are[:, number] &= _is_before(other, places_m)
    return are


def _is_before(wall: MirrorWall, places_m: FloatArray) -> bool:
    """Whether no place is behind a wall, and so it may go on a little."""
    ahead, along = _axes(wall)
    on_m = places_m @ along
    may_be_on = (on_m > wall.begin_m - IMAGE_M) & (on_m < wall.end_m + IMAGE_M)
    return not np.any(may_be_on & (places_m @ ahead > wall.distance_m))


def _crosses(wall: MirrorWall, other: MirrorWall, places_m: FloatArray, near_m: float) -> BoolArray:
    """Whether each of a wall's pings has another one before its foot, near where it was heard."""
    heard_from_m = places_m[wall.pings]
    ahead, along = _axes(other)
    toward = np.array([np.cos(wall.normal_rad), np.sin(wall.normal_rad)])
    before_m = other.distance_m - heard_from_m @ ahead
    with np.errstate(divide="ignore", invalid="ignore"):
        way_m = before_m / (toward @ ahead)
    ranges_m = wall.distance_m - heard_from_m @ toward
    is_between = (way_m > 0.0) & (way_m < ranges_m - BEHIND_M)
    crossings_m = (heard_from_m + np.where(is_between, way_m, 0.0)[:, np.newaxis] * toward) @ along
    feet_m = np.sort(places_m[other.pings] @ along)
    after = np.searchsorted(feet_m, crossings_m).clip(1, max(1, len(feet_m) - 1))
    nearest_m = np.minimum(
        np.abs(feet_m[after - 1] - crossings_m),
        np.abs(feet_m[np.minimum(after, len(feet_m) - 1)] - crossings_m),
    )
    crosses: BoolArray = is_between & (nearest_m < near_m)
    return crosses


def out_of_sight(
    points_m: FloatArray, mirrors: Sequence[MirrorWall], places_m: FloatArray
) -> BoolArray:
    """Whether mirrors stand between points and every place.

    Parameters
    ----------
    points_m : (points, 2) array
        That echoes seem to come from.
    mirrors : sequence of MirrorWall
        As far as they go.
    places_m : (pings, 2) array
        Where pings were heard from.
    """
    _, some = np.unique(np.floor(places_m / APART_M), axis=0, return_index=True)
    place_m, point_m = places_m[some], points_m[:, np.newaxis]
    hidden = np.zeros((len(points_m), len(some)), bool)
    for mirror in mirrors:
        ahead, along = _axes(mirror)
        before_m = mirror.distance_m - place_m @ ahead
        beyond_m = point_m @ ahead - mirror.distance_m
        is_beyond = (before_m > 0.0) & (beyond_m > BEHIND_M)
        share = before_m / np.where(is_beyond, before_m + beyond_m, 1.0)
        on_m = place_m @ along + share * (point_m @ along - place_m @ along)
        hidden |= is_beyond & (on_m > mirror.begin_m) & (on_m < mirror.end_m)
    return np.asarray(hidden.all(axis=1), bool)


def are_corners(
    middles_m: FloatArray, radii_m: FloatArray, mirrors: Sequence[MirrorWall]
) -> BoolArray:
    """Whether what seem to be round columns are corners of mirrors.

    What two mirrors return over each other comes from their corner, to whoever listens: a circle
    behind both of them that passes through it fits as well.

    Parameters
    ----------
    middles_m : (circles, 2) array
        Their middles.
    radii_m : (circles,) array
        And radii.
    mirrors : sequence of MirrorWall
        As far as they were heard.
    """
    are = np.zeros(len(radii_m), bool)
    for one, other in combinations(mirrors, 2):
        axes = [_axes(wall) for wall in (one, other)]
        normals = np.array([ahead for ahead, _ in axes])
        if abs(np.linalg.det(normals)) < CORNER_SINE:
            continue
        distances_m = np.array([one.distance_m, other.distance_m])
        corner_m = np.linalg.solve(normals, distances_m)
        if any(
            not wall.begin_m - CORNER_BEYOND_M < corner_m @ along < wall.end_m + CORNER_BEYOND_M
            for wall, (_, along) in zip((one, other), axes, strict=True)
        ):
            continue
        are_behind = (middles_m @ normals.T > distances_m).all(axis=1)
        off_m = np.hypot(*(middles_m - corner_m).T) - radii_m
        are |= are_behind & (np.abs(off_m) < ROUND_CORNER_M)
    return are


def _axes(wall: MirrorWall) -> tuple[FloatArray, FloatArray]:
    """Unit vectors across a wall and along it."""
    cosine, sine = np.cos(wall.normal_rad), np.sin(wall.normal_rad)
    return np.array([cosine, sine]), np.array([-sine, cosine])


def reflected(
    mirrors: Sequence[MirrorWall],
    table: PingTable,
    pings: NDArray[np.int64],
    echoes: Echoes,
    most: int = MOST_REFLECTIONS,
) -> BoolArray:
    """Whether each echo may have come by way of several mirrors.

    Parameters
    ----------
    mirrors : sequence of MirrorWall
        That stand.
    table : PingTable
        Pings.
    pings : (pings,) integer array
        Their rows.
    echoes : Echoes
        Theirs.
    most : int
        Reflections of a way.
    """
    numbers = table.numbers[pings]
    loudest = sorted(mirrors, key=lambda mirror: -len(mirror.pings))[:MOST_MIRRORS]
    found = np.zeros(len(echoes.range_m), bool)
    for ping, length_m, loudness in _ways(loudest, numbers, most):
        count = echoes.start[ping + 1] - echoes.start[ping]
        way = np.repeat(np.arange(len(ping)), count)
        echo = spans(echoes.start[ping], count)
        heard_m, number = echoes.range_m[echo], numbers[ping[way]]
        decay = np.exp(-0.5 * number[:, ABSORPTION] * heard_m)
        is_near = np.abs(heard_m - length_m[way]) < NEAR_M + number[:, RANGE_STD]
        found[echo[is_near & (2.0 * echoes.amplitude[echo] * heard_m < loudness * decay)]] = True
    return found


def _ways(
    mirrors: Sequence[MirrorWall], numbers: FloatArray, most: int
) -> Iterator[tuple[NDArray[np.int64], FloatArray, float]]:
    """Pings that hear a way over several mirrors, its length there and back, halved, and loudness.

    The loudness is what all of its mirrors return, at the most.
    """
    place_m = numbers[:, [X, Y]]
    pending: list[list[tuple[MirrorWall, FloatArray]]] = [[]]
    while pending:
        way = pending.pop()
        if len(way) > 1:
            ping = _hearing(way, place_m, numbers)
            if len(ping) > 0:
                length_m = 0.5 * np.hypot(*(way[-1][1][ping] - place_m[ping]).T)
                loudness = LOUDER * float(np.exp(sum(mirror.log_mirror for mirror, _ in way)))
                yield ping, length_m, loudness
        if len(way) == most:
            continue
        before_m = way[-1][1] if way else place_m
        for mirror in mirrors:
            if not way or mirror is not way[-1][0]:
                ahead, _ = _axes(mirror)
                across_m = mirror.distance_m - before_m @ ahead
                if (across_m > 0.0).any():
                    image_m = before_m + 2.0 * across_m[:, np.newaxis] * ahead
                    pending.append([*way, (mirror, image_m)])


def _hearing(
    way: Sequence[tuple[MirrorWall, FloatArray]], place_m: FloatArray, numbers: FloatArray
) -> NDArray[np.int64]:
    """Pings from where sound goes all of a way, and leaves and comes back within the beam."""
    leg_m = way[-1][1] - place_m
    ping = np.flatnonzero(np.hypot(*leg_m.T) < 2.0 * numbers[:, GREATEST_RANGE])
    ping = ping[_within_beam(leg_m[ping], numbers[ping])]
    spot_m = place_m[ping]
    for mirror, image_m in reversed(way):
        ahead, along = _axes(mirror)
        leg_m = image_m[ping] - spot_m
        across_m = leg_m @ ahead
        # What goes along a mirror never meets it.
        share = (mirror.distance_m - spot_m @ ahead) / np.where(across_m, across_m, np.inf)
        spot_m = spot_m + share[:, np.newaxis] * leg_m
        on_m = spot_m @ along
        exists = (share > 0.0) & (share < 1.0)
        exists &= (on_m > mirror.begin_m - BEYOND_M) & (on_m < mirror.end_m + BEYOND_M)
        ping, spot_m = ping[exists], spot_m[exists]
    return ping[_within_beam(spot_m - place_m[ping], numbers[ping])]


def _within_beam(vectors_m: FloatArray, numbers: FloatArray) -> BoolArray:
    """Whether directions are within the beams of pings."""
    off_rad = wrapped(np.arctan2(vectors_m[:, 1], vectors_m[:, 0]) - numbers[:, HEADING])
    heard: BoolArray = np.abs(off_rad) < numbers[:, HALF_ANGLE]
    return heard
