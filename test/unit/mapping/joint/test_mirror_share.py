"""Which share of surfaces may be mirrors that nobody has struck squarely."""

import math

import numpy as np
import pytest

from usmap_ros.mapping.joint.free_space.mirror_share import (
    ENOUGH_PINGS,
    LEAST_ECHOES,
    LOUDER,
    MANY_THINGS,
    OF_MIRRORS,
    OF_POLES,
    expected_share,
    facing_who_heard,
    mirror_share,
    told_by_walls,
    unexplained_share,
)
from usmap_ros.mapping.joint.free_space.response import NO_NORMAL, SurfaceViews
from usmap_ros.mapping.joint.free_space.silence import CAUTION, LONE, WALLED
from usmap_ros.mapping.joint.visibility.soundings import INCIDENCES, LOUDNESSES, SECTORS
from usmap_ros.numerics.arrays import FloatArray

#: Square, and at 20 to 50 degrees.
SQUARE, ASLANT = 1, 4
LOG_SILENT = np.full((LOUDNESSES, INCIDENCES), math.log(0.1))
#: A step of loudness that says nothing, and the first that does.
INAUDIBLE, FAINT = 6, 7
LOG_SILENT[: INAUDIBLE + 1] = math.log(0.9)


def room(
    answers_aslant: float,
    walls: int,
    is_struck: bool = True,
    least: float = 0.0,
    faint: float = 0.0,
) -> float:
    """Share of mirrors in a room of walls, each of 40 cells that five looks strike either way.

    A share of the looks is so faint that nothing aslant is heard.
    """
    cells = 40 * walls
    surface = np.repeat(np.arange(cells, dtype=np.int32), 10)
    incidence = np.tile(np.repeat([SQUARE, ASLANT], 5), cells).astype(np.int32)
    if not is_struck:
        incidence[:] = ASLANT
    rng = np.random.default_rng(1)
    heard = rng.random(len(surface)) < np.where(incidence == SQUARE, 0.9, answers_aslant)
    classes = np.full(len(surface), FAINT + LOUDER, np.int32)
    classes[rng.random(len(surface)) < faint] = FAINT
    heard &= (classes > FAINT) | (incidence == SQUARE)
    looked = SurfaceViews(
        surface, classes, incidence, classes * 0, heard.astype(np.uint8),
        np.ones(len(surface), np.float32),
    )  # fmt: skip
    number = np.repeat(np.arange(walls), 40)
    surfaces = np.stack([np.arange(cells), 20.0 * number, 0.3 * number], axis=1)
    return mirror_share(looked, surfaces, LOG_SILENT, 0.0, least)


def test_walls_that_answer_aslant_are_no_mirrors() -> None:
    assert room(0.8, 8) < 0.05
    assert room(0.0, 8) > 0.6


def test_walls_that_are_too_faint_aslant_are_no_mirrors() -> None:
    """From afar rough walls answer square looks alone: half of a room of them was unknown."""
    assert room(0.8, 8, faint=0.95) == pytest.approx(room(0.8, 8), rel=0.3)
    # Where there is nothing but faint looks these tell as before.
    assert room(0.8, 8, faint=1.0) > 0.6


def test_few_walls_say_less_than_many() -> None:
    assert room(0.8, 2) > 2.0 * room(0.8, 30)


def test_a_few_walls_that_are_none_are_enough_for_mirrors_to_be_rare() -> None:
    """Rarer than what is refuted: or one robot among rough walls would know half of what it saw."""
    assert CAUTION * room(0.8, 3) < math.exp(WALLED.mirrors_refuted)


def test_one_mirror_among_many_walls_that_are_none_is_enough_for_others_to_be_expected() -> None:
    shares = CAUTION * room(0.8, 8, least=1.0), CAUTION * room(0.8, 8)
    assert shares[0] > math.exp(WALLED.mirrors_refuted) > shares[1]
    assert room(0.0, 8, least=1.0) == room(0.0, 8)


def test_walls_found_say_nothing_of_mirrors_if_none_would_have_been_struck() -> None:
    unheard = expected_share(0.0, 0.0, 0.5)
    assert expected_share(0.0, 30.0, 0.001) == pytest.approx(unheard, rel=0.1)
    assert expected_share(0.0, 30.0, 0.8) < 0.2 * unheard
    assert room(0.8, 30, is_struck=False) > 2.0 * room(0.8, 30)


def test_a_wall_that_was_found_aslant_alone_is_no_mirror() -> None:
    """Half of a room was unknown: two walls that answered faintly, struck by nobody."""
    faintly, clearly = (room(answers, 4, is_struck=False) for answers in (0.1, 0.8))
    assert faintly == pytest.approx(clearly)
    assert room(0.1, 4) > 3.0 * room(0.8, 4)


def test_what_stands_alone_tells_where_most_does() -> None:
    nothing = np.zeros(0, np.int32)
    looked = SurfaceViews(
        nothing, nothing, nothing, nothing, nothing.astype(np.uint8), nothing.astype(np.float32)
    )
    poles = np.tile([3.0, 3.0, NO_NORMAL], (20, 1))
    assert mirror_share(looked, poles, LOG_SILENT, 1.0) < 0.03
    assert mirror_share(looked, poles, LOG_SILENT, 0.0) == pytest.approx(
        expected_share(0.0, 0.0, 0.5), rel=1e-6
    )


def lone_things(
    *sides: tuple[list[int], list[int]], pings: int = 200, one_sided: float = 0.0
) -> FloatArray:
    """How things on no line face, by the sectors that they were heard and not heard from."""
    table = [
        (thing, sector, heard)
        for thing, both in enumerate(sides)
        for heard, sectors in zip((1, 0), both, strict=True)
        for sector in sectors
    ]
    surface, sector, heard = np.array(table, np.int32).T
    looked = SurfaceViews(
        surface, sector * 0 + 10, sector * 0, sector, heard.astype(np.uint8),
        np.ones(len(table), np.float32),
    )  # fmt: skip
    surfaces = np.tile([3.0, 3.0, NO_NORMAL], (len(sides), 1))
    return facing_who_heard(looked, surfaces, pings, one_sided)[:, 2]


def test_what_was_heard_from_one_side_may_be_a_mirror_that_faces_it() -> None:
    """Ends of a corridor of mirrors were taken for poles, and its silent sides for open space."""
    north, south = (2.0 * math.pi * (sector + 0.5) / SECTORS for sector in (3, 9))
    facing = lone_things(([3, 3, 3], []), ([9, 9], [0, 3]))
    np.testing.assert_allclose(np.sin(facing - [north, south]), 0.0, atol=1e-9)


def test_one_thing_that_was_heard_from_aside_tells_that_others_would_be() -> None:
    pole, heard_once = ([0, 3, 5], [4]), ([3, 3, 3], [])
    assert (lone_things(pole, heard_once, heard_once) == NO_NORMAL).all()


def test_things_that_are_silent_from_aside_outweigh_one_that_is_not() -> None:
    pole, mirror = ([0, 3, 5], [4]), ([3, 3, 3], [0, 0, 5, 6])
    facing = lone_things(pole, mirror, mirror)
    assert facing[0] == NO_NORMAL
    assert (facing[1:] != NO_NORMAL).all()


def test_where_most_was_heard_from_one_side_nothing_alone_tells_of_others() -> None:
    """Two poles that chance made in a corridor were to answer from any side, and so its walls."""
    pole, heard_once = ([0, 3, 5], [4]), ([3, 3, 3], [])
    assert (lone_things(pole, heard_once, one_sided=0.6) != NO_NORMAL).all()
    assert (lone_things(pole, heard_once, one_sided=0.4) == NO_NORMAL).all()


def test_few_pings_that_pass_poles_do_not_take_them_for_mirrors() -> None:
    """A window of 40 pings among poles knew a tenth of what it had known: each was heard once."""
    passed = ([3, 3], []), ([4], []), ([9, 9], [9])
    assert (lone_things(*passed, pings=40) == NO_NORMAL).all()
    assert (lone_things(*passed) != NO_NORMAL).all()


@pytest.mark.parametrize(
    ("explained", "pings", "lone_share", "expected"),
    [
        (1.0 - OF_POLES, 60, 1.0, 0.0),
        (0.7, 60, 1.0, (0.3 - OF_POLES) / (OF_MIRRORS - OF_POLES)),
        (0.7, 60, 0.5, 0.5 * (0.3 - OF_POLES) / (OF_MIRRORS - OF_POLES)),
        (0.54, ENOUGH_PINGS - 1, 1.0, 1.0),
        (0.0, ENOUGH_PINGS - 1, 1.0, 1.0),
        (0.4, ENOUGH_PINGS, 1.0, 1.0),
        (0.9, ENOUGH_PINGS, 1.0, 0.0),
    ],
)
def test_what_nothing_explains_may_be_mirrors(
    explained: float, pings: int, lone_share: float, expected: float
) -> None:
    chances = np.where(np.arange(1000) < 1000 * explained, 0.8, 0.0).astype(np.float32)
    share = unexplained_share(chances, np.ones(1000), MANY_THINGS, pings, lone_share)
    assert share == pytest.approx(expected, abs=1e-9)


def test_among_poles_nothing_explains_what_is_far() -> None:
    """Of a room of mirrors what is near is left over, too: a leak of 9 m² while that did not count.

    Few pings hear what is far off, whatever it is.
    """
    chances = np.where(np.arange(100) < 60, 0.8, 0.0).astype(np.float32)
    ranges_m = np.linspace(0.5, 4.0, 100)
    assert unexplained_share(chances, ranges_m, MANY_THINGS, 90, 1.0) == 0.0
    assert unexplained_share(chances, ranges_m[::-1], MANY_THINGS, 90, 1.0) == 1.0


def test_where_most_of_all_is_left_something_else_is_there_near_or_far() -> None:
    """Chance explained what was near in a corridor, whose walls were 24 % lost."""
    chances = np.where(np.arange(200) < 80, 0.8, 0.0).astype(np.float32)
    ranges_m = np.linspace(0.5, 4.0, 200)
    assert (chances[ranges_m <= np.median(ranges_m)] == 0.0).mean() == 0.2
    assert unexplained_share(chances, ranges_m, MANY_THINGS, ENOUGH_PINGS, 1.0) == 1.0
    assert unexplained_share(chances, ranges_m, MANY_THINGS, ENOUGH_PINGS - 1, 1.0) < 0.2


def test_few_things_do_not_say_that_a_place_is_one_of_poles() -> None:
    chances = np.where(np.arange(100) < 89, 0.8, 0.0).astype(np.float32)
    shares = [unexplained_share(chances, np.ones(100), things, 90, 1.0) for things in range(2, 12)]
    assert shares[:3] == [1.0] * 3
    assert shares == sorted(shares, reverse=True)
    assert shares[MANY_THINGS - 2 :] == [0.0] * 6
    assert unexplained_share(chances, np.ones(100), 2, ENOUGH_PINGS, 1.0) == 0.0


def test_of_few_echoes_hardly_any_may_be_left_unexplained() -> None:
    chances = np.ones(LEAST_ECHOES, np.float32)
    chances[:3] = 0.0
    ranges_m = np.linspace(4.0, 0.5, LEAST_ECHOES)
    assert unexplained_share(chances, ranges_m, MANY_THINGS, 10, 1.0) == 0.0
    assert unexplained_share(chances[:-1], ranges_m[:-1], MANY_THINGS, 10, 1.0) > math.exp(
        LONE.mirrors_refuted
    )
    assert unexplained_share(chances[:-1], ranges_m[:-1], MANY_THINGS, 10, 0.0) == 0.0
    assert unexplained_share(chances[3:], ranges_m[3:], MANY_THINGS, 10, 1.0) == 0.0
    assert unexplained_share(chances[:-1], ranges_m[:-1], MANY_THINGS, ENOUGH_PINGS, 1.0) == 0.0


@pytest.mark.parametrize(
    ("walls", "wide", "told"), [(1, 0.0, 0.8), (1, 1.0, 0.0), (4, 1.0, 0.8), (1, 0.5, 0.4)]
)
def test_one_wall_tells_nothing_of_others_where_most_was_not_heard(
    walls: int, wide: float, told: float
) -> None:
    """Robots left a corridor of which one end was heard, and its sides at flat angles only."""
    assert told_by_walls(0.8, walls, wide) == pytest.approx(told)
