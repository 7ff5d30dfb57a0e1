"""Directions in which the walls of a place face."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from usmap_ros.mapping.joint.free_space.kinds import (
    ACROSS,
    ALONG,
    GROUPS,
    KINDS,
    MIRRORS,
    ORIENTATIONS,
    OTHERS,
    ROUND,
)
from usmap_ros.mapping.joint.free_space.refutation import refute_for_room
from usmap_ros.mapping.joint.free_space.silence import MIRRORED
from usmap_ros.mapping.joint.free_space.usual_directions import (
    A_METRE_ASKEW,
    A_SHORT_ONE,
    ANY_WIDTH_M,
    COLUMN_M,
    EXPECTED_M,
    FACES_SO,
    LONG_M,
    SHORT_M,
    STANDS,
    facing,
    lacks_room,
    lengths,
    log_priors,
    sides,
    widest_gap_m,
)
from usmap_ros.mapping.joint.surfaces.lines import NO_LINES
from usmap_ros.mapping.joint.surfaces.mirrors import MirrorWall, face_usually
from usmap_ros.mapping.joint.surfaces.walls import Walls
from usmap_ros.numerics.arrays import BoolArray, FloatArray


def wall(normal_rad: float, length_m: float) -> MirrorWall:
    """Make a wall of some length, that was heard once each decimetre."""
    heard = np.arange(round(10 * length_m))
    return MirrorWall(normal_rad, 2.0, 0.0, length_m, heard, heard, 0.0, 0.0, -0.7, 0.1, 9.0)


ROOM = [wall(0.3, 4.0), wall(0.3 + 0.5 * math.pi, 3.0), wall(0.31 - math.pi, 2.0), wall(1.1, 0.6)]
#: How much of them is parallel or square to most, and one that is askew may be, m.
MOST_M = 9.0 + EXPECTED_M + 0.6 * A_METRE_ASKEW


def priors(
    walls: list[MirrorWall], alone_m: float = 0.0, columns: float = 0.0, things: int = 8
) -> FloatArray:
    """What is asked for in a room of mirrors, or among other things."""
    return log_priors(facing(walls, NO_LINES, 0.05), len(walls), columns, things, alone_m, 0.2)


def test_walls_that_are_square_to_most_face_usually() -> None:
    assert face_usually(ROOM, ROOM).tolist() == [True, True, True, False]


def test_surfaces_that_face_as_most_walls_do_are_the_likeliest() -> None:
    kinds = priors(ROOM)[:ORIENTATIONS]
    likeliest = kinds[kinds[:, 1] == 0.0][:, 0]
    # Along and across; the three walls agree on 0.302.
    assert np.sin(2.0 * (likeliest - 0.302)) == pytest.approx(0.0, abs=5e-3)
    assert len(likeliest) == 2


def test_others_are_the_likelier_the_more_of_them_were_found() -> None:
    kinds = priors(ROOM)[:ORIENTATIONS]
    oblique = kinds[np.argmin(np.abs(np.sin(kinds[:, 0] - 1.1))), 1]
    # Askew ones may face any way; most walls that are parallel or square have 9 m.
    expected_m = EXPECTED_M + 0.6 * A_METRE_ASKEW
    assert oblique == pytest.approx(math.log((0.6 + expected_m) / (9.0 + expected_m)))
    assert kinds[:, 1].min() == pytest.approx(math.log(expected_m / (9.0 + expected_m)))


def test_how_often_a_wall_was_struck_does_not_make_walls_like_it_usual() -> None:
    often = [replace(one, echoes=np.arange(900)) for one in ROOM[:3]]
    heard_often, heard = (priors(walls) for walls in ([*often, ROOM[3]], ROOM))
    assert heard_often[:, 1] == pytest.approx(heard[:, 1])


def test_among_things_that_stand_alone_surfaces_face_anywhere_more_often() -> None:
    least = [priors(ROOM, alone_m)[:ORIENTATIONS, 1].min() for alone_m in (0.0, 2.0, 8.0)]
    assert least[0] < least[1] < least[2] < 0.0


def test_where_no_walls_were_found_surfaces_face_anywhere() -> None:
    assert not priors([])[:ORIENTATIONS, 1].any()


def test_surfaces_that_nobody_found_face_as_the_walls_that_were_found() -> None:
    """Two walls that answer from any side, of 4 m and 3 m, square to each other."""
    lines = np.array([[1.0, 0.0, 40.0, 0.0, 80.0], [0.0, 1.0, 30.0, 0.0, 60.0]])
    kinds = log_priors(facing([], lines, 0.05), 0, 0.0, 2, 0.0, 0.2)
    mirrors = kinds[ORIENTATIONS:ROUND]
    # So do those that answer from any side: what was asked of others left half a room unknown.
    assert kinds[:ORIENTATIONS, 1] == pytest.approx(mirrors[:, 1] - math.log(0.2))
    usual = np.abs(np.sin(2.0 * mirrors[:, 0])) < 0.01
    assert mirrors[usual, 1] == pytest.approx([math.log(0.2)] * 2)
    assert mirrors[~usual, 1] == pytest.approx(math.log(0.2 * EXPECTED_M / (7.0 + EXPECTED_M)))
    assert set(mirrors[:, 2]) == {MIRRORS}
    among_mirrors = set(priors(ROOM)[:, 2])
    assert OTHERS in among_mirrors
    assert MIRRORS not in among_mirrors


def test_without_mirrors_and_columns_nothing_round_is_looked_for() -> None:
    assert priors([])[ROUND, 1] < -100.0


@pytest.mark.parametrize("columns", [1, 2])
def test_round_things_are_the_likelier_the_more_columns_there_are(columns: int) -> None:
    # Of four walls, or other things; and beside mirrors, three of which are square to each other.
    among_things = priors([], columns=columns, things=4)[ROUND, 1]
    assert among_things == pytest.approx(math.log(columns / 3.0))
    among_mirrors = priors(ROOM, columns=columns)[ROUND, 1]
    assert among_mirrors == pytest.approx(math.log(COLUMN_M * (columns + 1) / MOST_M))


def test_a_few_suspected_columns_do_not_keep_a_room_of_mirrors_unknown() -> None:
    """A tee had four, and none: 0.16 of what was in sight was unknown for them alone."""
    walls = [wall(0.5 * math.pi * number, 4.0) for number in range(7)]
    assert priors(walls, columns=2.1)[ROUND, 1] < MIRRORED[0]


def test_round_things_are_looked_for_among_mirrors_even_if_no_column_was_found() -> None:
    assert priors(ROOM)[ROUND, 1] == pytest.approx(math.log(COLUMN_M / MOST_M))


def test_nothing_is_likelier_than_the_most_usual_walls() -> None:
    assert priors(ROOM, columns=7)[:, 1].max() == priors([], columns=7)[:, 1].max() == 0.0


#: Distance to an end, cells, of all walls, and log-likelihood ratio at which one is refuted.
ALL_LONG, REFUTED = np.array([[20.0, 1.0]]), -2.0


def gap_of(cells: int) -> BoolArray:
    """Make cells in which no wall can stand, but for a gap across the tenth row."""
    is_refuted = np.ones((60, 60), bool)
    is_refuted[10 : 10 + cells, 10] = False
    return is_refuted


def nothing() -> NDArray[np.uint8]:
    """Make cells in which nothing stands."""
    return np.zeros((60, 60), np.uint8)


def lacking(
    is_refuted: BoolArray,
    said: float | FloatArray = 0.0,
    normal_rad: float = 0.0,
    widest: float = ANY_WIDTH_M,
    kinds: FloatArray = ALL_LONG,
    asked: BoolArray | None = None,
    stands: NDArray[np.uint8] | None = None,
) -> BoolArray:
    """Ask whether there is too little room; of all cells, where nothing stands, unless stated."""
    asked = np.ones_like(is_refuted) if asked is None else asked
    stands = nothing() if stands is None else stands
    everywhere = np.broadcast_to(np.float32(said), is_refuted.shape).copy()
    return lacks_room(everywhere, is_refuted, asked, stands, normal_rad, kinds, REFUTED, widest)


@pytest.mark.parametrize("normal_rad", [0.0, 0.5 * math.pi])
def test_a_wall_needs_room_between_what_is_refuted(normal_rad: float) -> None:
    # In the middle it is half as far to either end: 2 log(1 - exp(-9.5 / 20)) = -1.95.
    for cells, lacks in ((17, True), (21, False)):
        along = gap_of(cells) if normal_rad == 0.0 else gap_of(cells).T
        middle = (10 + cells // 2, 10) if normal_rad == 0.0 else (10, 10 + cells // 2)
        assert lacking(along, 0.0, normal_rad)[middle] == lacks


def test_a_wall_may_begin_where_what_is_refuted_ends_but_seldom_does() -> None:
    is_refuted = np.zeros((60, 60), bool)
    is_refuted[:8] = True
    # 1 - exp(-2.5 / 20) is less than exp(-2), 1 - exp(-3.5 / 20) is more.
    assert lacking(is_refuted, 0.0, 0.0)[10].all()
    assert not lacking(is_refuted, 0.0, 0.0)[11:].any()


def test_silence_and_little_room_together_refute_a_wall() -> None:
    middle = (20, 10)
    assert not lacking(gap_of(21), 0.0, 0.0)[middle]
    assert lacking(gap_of(21), -0.3, 0.0)[middle]


def test_room_says_nothing_against_a_wall_that_was_heard() -> None:
    assert lacking(gap_of(5), 0.0, 0.0)[12, 10]
    assert not lacking(gap_of(5), 0.1, 0.0).any()


def test_only_what_is_asked_for_lacks_room() -> None:
    asked = np.zeros((60, 60), bool)
    asked[12, 10] = True
    assert np.argwhere(lacking(gap_of(5), asked=asked)).tolist() == [[12, 10]]


def test_room_says_nothing_of_how_far_a_wall_goes_on() -> None:
    """A partition that was struck squarely near its end alone went on as free space."""
    stands = nothing()
    assert lacking(gap_of(15))[17, 10]
    stands[11:14, 10] = FACES_SO
    assert not lacking(gap_of(15), stands=stands).any()
    # What was hardly heard of it is no wall yet.
    for heard, lacks in ((1.9, True), (2.1, False)):
        said = np.zeros((60, 60))
        said[12, 10] = heard
        assert lacking(gap_of(15), said)[17, 10] == lacks


def test_a_wall_may_end_where_it_meets_another_one() -> None:
    """The side of an alcove began at the corridor's wall, and was free."""
    crossing, is_refuted = nothing(), np.zeros((60, 60), bool)
    is_refuted[:8] = True
    assert lacking(is_refuted)[9, 10]
    crossing[8] = STANDS
    assert not lacking(is_refuted, stands=crossing)[9:].any()
    # Of what is on its other side it says nothing.
    assert lacking(is_refuted, stands=np.roll(crossing, 4, axis=0))[9, 10]


def refute(is_refuted: BoolArray, closed: BoolArray | None = None, *, along: bool = True) -> None:
    """Refute walls for room where nothing stands, nor may but in cells that are closed.

    Those along the usual direction are asked for or not.
    """
    empty = np.zeros((60, 60), bool)
    silence: Any = SimpleNamespace(
        kinds=np.zeros((KINDS, 3)), long_and_short=ALL_LONG, refuted=REFUTED
    )
    refute_for_room(
        is_refuted, np.zeros((60, 60, GROUPS), np.float32), np.array([~empty & along, ~empty]),
        Walls(empty, empty, empty, NO_LINES, NO_LINES), empty if closed is None else closed,
        silence, ANY_WIDTH_M,
    )  # fmt: skip


@pytest.mark.parametrize("may_stand", [False, True])
def test_a_wall_may_end_where_something_may_stand(*, may_stand: bool) -> None:
    """The side of an alcove was free, beside the corner that the wall behind it went on to."""
    is_refuted = np.ones((60, 60, GROUPS), bool)
    is_refuted[:, :, ALONG] = gap_of(17)
    closed = np.zeros((60, 60), bool)
    closed[26, 10] = may_stand
    refute(is_refuted, closed)
    assert is_refuted[18, 10, ALONG] != may_stand


@pytest.mark.parametrize("along", [False, True])
def test_room_refutes_walls_that_are_asked_for(*, along: bool) -> None:
    is_refuted = np.zeros((60, 60, GROUPS), bool)
    is_refuted[:, :, [ALONG, ACROSS]] = gap_of(17)[:, :, np.newaxis]
    assert not is_refuted[18, 10].any()
    refute(is_refuted, along=along)
    assert is_refuted[18, 10, ALONG] == along
    assert is_refuted[18, 10, ACROSS]


@pytest.mark.parametrize("width", [1, 3])
def test_a_wall_ends_where_no_block_of_nine_cells_holds_one(width: int) -> None:
    """Sound that was thought to cross a wall at its foot freed all of it, two metres long."""
    is_refuted = np.zeros((60, 60, GROUPS), bool)
    is_refuted[20:23, 10 : 10 + width] = True
    refute(is_refuted)
    assert is_refuted[17, 10, ALONG] == (width == 3)


def test_mirrors_on_one_line_are_one_side_of_a_room() -> None:
    """A room of four mirrors, two of them on one line, lacked a side, and robots left there."""
    # Its line is turned about the middle of the first one.
    beside = replace(ROOM[0], normal_rad=0.32, begin_m=5.0, end_m=6.0)
    turned_m = 2.0 * math.cos(0.02) + 5.5 * math.sin(0.02)
    assert sides([]) == 0
    assert sides([*ROOM, replace(beside, distance_m=turned_m)]) == len(ROOM)
    assert sides([*ROOM, replace(beside, distance_m=2.5)]) == len(ROOM) + 1


def test_the_more_sides_of_a_room_are_missing_the_less_a_wide_gap_says() -> None:
    """Few pings in a room of mirrors struck three of its sides, and the fourth was free."""
    widest_m = [widest_gap_m(mirrors) for mirrors in range(6)]
    assert widest_m == sorted(widest_m)
    assert widest_m[1] < 1.0 < widest_m[2] <= widest_m[3] < 2.0
    assert widest_m[4] > 100.0
    for widest, lacks in ((14.0, False), (16.0, True)):
        assert lacking(gap_of(15), widest=widest)[17, 10] == lacks
    # Where only one end is known there is no gap.
    is_refuted = np.zeros((60, 60), bool)
    is_refuted[:8] = True
    assert lacking(is_refuted, widest=14.0)[10].all()


def test_walls_beyond_what_is_refuted_are_others() -> None:
    is_refuted, stands = gap_of(15), nothing()
    is_refuted[30:40, 10] = False
    stands[32:38, 10] = FACES_SO
    assert lacking(is_refuted, stands=stands)[17, 10]


def test_where_things_are_short_too_something_short_may_stand_where_there_is_little_room() -> None:
    for share, lacks in ((0.0, True), (0.05, True), (0.3, False)):
        kinds = np.array([[20.0, 1.0 - share], [4.0, share]])
        assert lacking(gap_of(15), kinds=kinds)[17, 10] == lacks
    # But in a gap of a cell or two there is room for nothing.
    kinds = np.array([[20.0, 0.5], [4.0, 0.5]])
    assert lacking(gap_of(2), kinds=kinds)[10:12, 10].all()


def test_boxes_and_what_stands_alone_make_short_things_usual() -> None:
    # Walls of 4 m, and boxes of 0.5 m, on cells of 5 cm.
    walls = np.array([[1.0, 0.0, 10.0, 0.0, 80.0]] * 4)
    boxes = np.array([[1.0, 0.0, 30.0, 5.0, 15.0]] * 6)
    bare = lengths(walls, 0.0, 0.05)
    assert bare[:, 0].tolist() == pytest.approx([LONG_M / 0.05, SHORT_M / 0.05])
    among = lengths(np.concatenate([walls, boxes]), 0.0, 0.05)
    # For each side that was found there is one that was not.
    alone = lengths(walls, A_SHORT_ONE * 3.0, 0.05)
    assert among[1, 1] == pytest.approx(alone[1, 1])
    assert among[1, 1] > 2.0 * bare[1, 1]
    assert bare[:, 1].sum() == pytest.approx(1.0)
