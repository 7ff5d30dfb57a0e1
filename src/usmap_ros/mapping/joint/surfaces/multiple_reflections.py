"""Echoes by way of several mirrors, and the walls that they seem to be.

Sound that a mirror sends on to another one and gets back comes from where the one stands in the
other: behind it, as far as the room is wide, where nothing is.  A way over walls A, B, … is as long
as the straight line to the transducer's image in A, of that in B, … (Allen & Berkley, "Image method
for efficiently simulating small-room acoustics", J. Acoust. Soc. Am. 65 (1979) 943-950), and no
louder than all of their reflectivities allow.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.visibility.echoes import Echoes
from usmap_ros.mapping.joint.visibility.field import (
    ABSORPTION,
    GREATEST_RANGE,
    HALF_ANGLE,
    HEADING,
    RANGE_STD,
    X,
    Y,
)
from usmap_ros.mapping.looks import Looks
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.geometry import wrapped

#: Reflections of a way at the most, and mirrors that are taken for it, those with most echoes.
MOST_REFLECTIONS, MOST_MIRRORS = 3, 12
#: An echo is that of a way if it is so near to where it should be, beyond what its range is
#: uncertain by, m, and no louder than so many times what mirrors on the beam's axis would return.
NEAR_M, LOUDER = 0.03, 1.5
#: Mirrors go on so far beyond the feet that were heard, m.
BEYOND_M = 0.3
#: A wall hides what is farther behind it than this, m, where a foot on it is this near; it is
#: another's image if such a share of its pings would have to hear it through others.
BEHIND_M, FOOT_M, HIDDEN_SHARE = 0.15, 0.15, 0.5


class Mirror(Protocol):
    """A wall as a mirror: see `usmap_ros.mapping.joint.surfaces.mirror_walls.MirrorWall`."""

    @property
    def normal_rad(self) -> float: ...  # noqa: D102 - as there
    @property
    def distance_m(self) -> float: ...  # noqa: D102
    @property
    def begin_m(self) -> float: ...  # noqa: D102
    @property
    def end_m(self) -> float: ...  # noqa: D102
    @property
    def log_mirror(self) -> float: ...  # noqa: D102
    @property
    def pings(self) -> NDArray[np.int64]: ...  # noqa: D102


def seen_directly(walls: Sequence[Mirror], places_m: FloatArray) -> BoolArray:
    """Whether each wall is heard with no other one in the way, as an image is not.

    Parameters
    ----------
    walls : sequence of Mirror
        Those that were heard.
    places_m : (pings, 2) array
        Where pings were heard from.
    """
    hides = np.array([[_hidden(wall, other, places_m) for other in walls] for wall in walls])
    is_hidden = hides > HIDDEN_SHARE
    # What hides nothing but images may be one itself.
    stands = ~is_hidden.any(axis=1)
    seen: BoolArray = ~(is_hidden & stands).any(axis=1)
    return seen


def _hidden(wall: Mirror, other: Mirror, places_m: FloatArray) -> float:
    """Share of a wall's pings that have another one, where it was heard, before its feet."""
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
    return float(np.mean(is_between & (nearest_m < FOOT_M)))


def _axes(wall: Mirror) -> tuple[FloatArray, FloatArray]:
    """Unit vectors across a wall and along it."""
    cosine, sine = np.cos(wall.normal_rad), np.sin(wall.normal_rad)
    return np.array([cosine, sine]), np.array([-sine, cosine])


def reflected(
    mirrors: Sequence[Mirror], looks: Looks, pings: NDArray[np.int64], echoes: Echoes
) -> BoolArray:
    """Whether each echo may have come by way of two or three mirrors.

    Parameters
    ----------
    mirrors : sequence of Mirror
        That stand.
    looks : Looks
        Pings.
    pings : (pings,) integer array
        Their rows.
    echoes : Echoes
        Theirs.
    """
    numbers = looks.numbers[pings]
    of_echo = np.repeat(np.arange(len(pings)), np.diff(echoes.start))
    ranges_m = echoes.range_m
    level = (
        2.0 * echoes.amplitude * ranges_m * np.exp(0.5 * numbers[of_echo, ABSORPTION] * ranges_m)
    )
    near_m = NEAR_M + numbers[of_echo, RANGE_STD]
    found = np.zeros(len(ranges_m), bool)
    loudest = sorted(mirrors, key=lambda mirror: -len(mirror.pings))[:MOST_MIRRORS]
    pending = [[mirror] for mirror in loudest]
    while pending:
        way = pending.pop()
        if len(way) > 1:
            expected_m = _lengths(way, numbers)[of_echo]
            greatest = LOUDER * np.exp(sum(mirror.log_mirror for mirror in way))
            found |= (np.abs(ranges_m - expected_m) < near_m) & (level < greatest)
        if len(way) < MOST_REFLECTIONS:
            pending += [[*way, mirror] for mirror in loudest if mirror is not way[-1]]
    return found


def _lengths(way: Sequence[Mirror], numbers: FloatArray) -> FloatArray:
    """Half the length of a way from each ping's place and back, m; infinite where it has none."""
    place_m = numbers[:, [X, Y]]
    images_m = [place_m]
    for mirror in way:
        ahead, _ = _axes(mirror)
        before_m = mirror.distance_m - images_m[-1] @ ahead
        images_m.append(images_m[-1] + 2.0 * before_m[:, np.newaxis] * ahead)
    lengths_m = 0.5 * np.hypot(*(images_m[-1] - place_m).T)
    exists = lengths_m < numbers[:, GREATEST_RANGE]
    spot_m = place_m
    for mirror, image_m in zip(reversed(way), reversed(images_m), strict=False):
        ahead, along = _axes(mirror)
        leg_m = image_m - spot_m
        if mirror is way[-1]:
            exists &= _heard(leg_m, numbers)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = (mirror.distance_m - spot_m @ ahead) / (leg_m @ ahead)
        exists &= (share > 0.0) & (share < 1.0)
        spot_m = spot_m + np.where(exists, share, 0.0)[:, np.newaxis] * leg_m
        on_m = spot_m @ along
        exists &= (on_m > mirror.begin_m - BEYOND_M) & (on_m < mirror.end_m + BEYOND_M)
    exists &= _heard(spot_m - place_m, numbers)
    return np.where(exists, lengths_m, np.inf)


def _heard(vectors_m: FloatArray, numbers: FloatArray) -> BoolArray:
    """Whether directions are within the beams of pings."""
    off_rad = wrapped(np.arctan2(vectors_m[:, 1], vectors_m[:, 0]) - numbers[:, HEADING])
    heard: BoolArray = np.abs(off_rad) < numbers[:, HALF_ANGLE]
    return heard
