"""Echoes that go by way of several mirrors."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.mapping.joint.leave_one_out import kept_pings
from usmap_ros.mapping.joint.surfaces.mirror_walls import mirror_walls
from usmap_ros.mapping.joint.surfaces.mirrors import MirrorWall
from usmap_ros.mapping.joint.surfaces.multiple_reflections import (
    are_corners,
    reflected,
    seen_directly,
)
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

#: Width of a corridor along x, m, amplitude reflectivity of its walls, and pings in it.
WIDE_M, MIRROR, PINGS = 1.5, 0.95, 120
Heard = Callable[[float, float], list[tuple[float, float]]]


def corridor_pings(make_cone: Callable[..., EchoCone], heard: Heard) -> list[EchoCone]:
    """What robots in a corridor hear that look at either wall, by how far off that is."""
    beam, cones = BeamPattern.linear(), []
    for number in range(PINGS):
        x_m, y_m = 0.04 * number, 0.75 + 0.3 * math.sin(0.7 * number)
        wall_rad = 0.5 * math.pi * (-1.0) ** number
        off_rad = 0.1 * math.sin(1.3 * number)
        before_m = WIDE_M - y_m if number % 2 == 0 else y_m
        echoes = heard(before_m, float(beam.gain(off_rad)))
        pose = {"x_m": x_m, "y_m": y_m, "yaw_rad": wall_rad + off_rad}
        cones.append(make_cone(*echoes, stamp_ns=number, **pose))
    return cones


def walls_and_reflected(cones: list[EchoCone]) -> tuple[list[float], np.ndarray, np.ndarray]:
    """Distances of the mirrors that are found, ranges, and whether each echo went by several."""
    table, rows, _, echoes = kept_pings({"robot": cones}, MappingParameters()).pings()[:4]
    explained = np.zeros(len(echoes.range_m), bool)
    walls = mirror_walls(table, rows, echoes, explained, ~explained, np.zeros(len(rows), bool))
    several = reflected(walls, table, rows, echoes)
    return sorted(wall.distance_m for wall in walls), echoes.amplitude, several


def by_both(before_m: float, gain: float) -> list[tuple[float, float]]:
    """The wall ahead, and the one behind that stands in it as in a mirror."""
    ranges_m = before_m, before_m + WIDE_M
    return [
        (range_m, gain * mirror / (2.0 * range_m))
        for range_m, mirror in zip(ranges_m, (MIRROR, MIRROR**3), strict=True)
    ]


def test_the_wall_that_stands_in_another_is_none(make_cone: Callable[..., EchoCone]) -> None:
    distances_m, _, several = walls_and_reflected(corridor_pings(make_cone, by_both))
    assert distances_m == pytest.approx([0.0, WIDE_M], abs=0.01)
    # Each ping hears the wall first, and then the other one in it.
    assert several.tolist() == [False, True] * PINGS


def test_what_is_heard_through_a_door_is_a_wall(make_cone: Callable[..., EchoCone]) -> None:
    # A second echo, so that nobody takes the sensor for one that reports the nearest thing only.
    more = (2.85, 0.02)
    walls = corridor_pings(make_cone, lambda before_m, gain: [by_both(before_m, gain)[0], more])
    behind = corridor_pings(make_cone, lambda before_m, gain: [by_both(before_m, gain)[1], more])
    pings = [
        behind[number] if number % 2 == 0 and 40 <= number < 88 else walls[number]
        for number in range(PINGS)
    ]
    distances_m, _, _ = walls_and_reflected(pings)
    assert distances_m[-1] == pytest.approx(2.0 * WIDE_M, abs=0.01)


@pytest.mark.parametrize(("through", "found"), [(5, 2), (20, 3)])
def test_what_hardly_anybody_heard_through_a_door_is_none(
    make_cone: Callable[..., EchoCone], through: int, found: int
) -> None:
    """Of a wall three echoes were left, all of one place, and it was drawn on for 4 m."""
    more = (2.85, 0.02)
    walls = corridor_pings(make_cone, lambda before_m, gain: [by_both(before_m, gain)[0], more])
    both = corridor_pings(make_cone, lambda before_m, gain: [*by_both(before_m, gain), more])
    behind = corridor_pings(make_cone, lambda before_m, gain: [by_both(before_m, gain)[1], more])
    pings = list(walls)
    for which, begin, count in ((behind, 40, through), (both, 40 + 2 * through, 1)):
        pings[begin : begin + 2 * count : 2] = which[begin : begin + 2 * count : 2]
    distances_m = walls_and_reflected(pings)[0]
    assert len({round(distance_m, 1) for distance_m in distances_m}) == found


def test_what_is_louder_than_mirrors_are_is_no_reflection(
    make_cone: Callable[..., EchoCone],
) -> None:
    def loud(before_m: float, gain: float) -> list[tuple[float, float]]:
        first, (range_m, amplitude) = by_both(before_m, gain)
        return [first, (range_m, 2.5 * amplitude / gain)]

    _, amplitudes, several = walls_and_reflected(corridor_pings(make_cone, loud))
    assert len(amplitudes) == 2 * PINGS
    assert not several.any()


def scattered(before_m: float, gain: float) -> list[tuple[float, float]]:
    """As `by_both`, and what the wall scatters adds to its echo, by another amount each time."""
    (range_m, amplitude), *behind = by_both(before_m, gain)
    louder = 1.0 + 0.25 * math.sin(997.0 * before_m)
    following = [(range_m + 0.1 * step, 0.02 / range_m) for step in range(1, 5)]
    return [(range_m, louder * amplitude), *following, *behind]


def test_what_stands_in_walls_that_scatter_proves_them_mirrors(
    make_cone: Callable[..., EchoCone],
) -> None:
    distances_m, _, _ = walls_and_reflected(corridor_pings(make_cone, scattered))
    assert {round(distance_m, 1) for distance_m in distances_m} == {0.0, WIDE_M}


def test_a_wall_of_the_next_room_is_heard_by_nobody_before_this_one() -> None:
    pings = np.arange(50)
    near = MirrorWall(0.0, 2.0, 0.0, 2.0, pings[:20], pings[:20], 0.0, 0.0, 0.0, 0.0, 9.0)
    far = MirrorWall(0.0, 4.0, 0.0, 5.0, pings, pings, 0.0, 0.0, 0.0, 0.0, 9.0)
    # Twenty are before the near wall, and thirty beside it, from where the far one is heard.
    places_m = np.stack([np.ones(50), np.linspace(0.0, 5.0, 50)], axis=1)
    kept = seen_directly([near, far], places_m)
    assert [len(wall.pings) for wall in kept] == [20, 29]
    assert kept[1].begin_m > 2.0
    assert kept[1].end_m == pytest.approx(5.0)


def struck(normal_rad: float, distance_m: float, rows: range, places_m: np.ndarray) -> MirrorWall:
    """A mirror that some pings heard."""
    own = np.array(rows)
    feet_m = places_m[own] @ [-math.sin(normal_rad), math.cos(normal_rad)]
    return MirrorWall(
        normal_rad, distance_m, feet_m.min(), feet_m.max(), own, own, 0.0, 0.0, -0.1, 0.05, 9.0
    )


@pytest.mark.parametrize("went_on", [False, True])
def test_what_is_just_where_a_wall_stands_in_another_is_none(*, went_on: bool) -> None:
    """Through the rest of a wall that was struck in part a robot left for it, over 2.5 m²."""
    west, east = np.arange(0.0, 1.0, 0.1), np.arange(2.0, 2.5, 0.05)
    along = [*np.column_stack([west, 0.0 * west]), *np.column_stack([east, 0.0 * east])]
    places_m = np.array([*along, *np.column_stack([0.1 * east, 0.0 * east])])
    # A wall to the north that the western pings struck; what the eastern ones heard is the wall
    # to the south-west in it, just over where it was not struck.
    north, south = 0.5 * math.pi, -0.5 * math.pi - 0.6
    walls = [
        struck(north, 1.5, range(10), places_m),
        struck(south, 1.2, range(20, 30), places_m),
        struck(0.5 * math.pi + 0.6, 1.2 + 3.0 * math.cos(0.6), range(10, 20), places_m),
    ]
    if went_on:
        # Somebody went through there: it is another room.
        places_m = np.array([*places_m, [1.8, 1.8]])
    seen = seen_directly(walls, places_m)
    assert len(seen) == (3 if went_on else 2)
    assert seen[:2] == walls[:2]


def test_a_circle_that_two_mirrors_have_behind_their_corner_is_the_corner() -> None:
    """Echoes by way of both walls made columns that let sound out of a room."""
    pings, places_m = np.arange(20), [(4.0, 3.0), (4.1, 3.3), (3.6, 2.8), (4.3, 2.8), (4.1, 3.3)]
    east = MirrorWall(0.0, 4.0, 0.0, 2.0, pings, pings, 0.0, 0.0, 0.0, 0.0, 9.0)
    north = MirrorWall(0.5 * math.pi, 3.0, -3.0, -1.0, pings, pings, 0.0, 0.0, 0.0, 0.0, 9.0)
    radii_m = np.array([0.3, math.hypot(0.1, 0.3), math.hypot(0.4, 0.2), math.hypot(0.3, 0.2), 0.1])
    # Only the second one is behind both and passes through where they meet.
    told = are_corners(np.array(places_m), radii_m, [east, north])
    assert told.tolist() == [False, True, False, False, False]
    assert not are_corners(np.array(places_m), radii_m, [east]).any()
    far = MirrorWall(0.5 * math.pi, 3.0, 3.0, 5.0, pings, pings, 0.0, 0.0, 0.0, 0.0, 9.0)
    assert not are_corners(np.array(places_m), radii_m, [east, far]).any()
