"""Directions in which the walls of a place face."""

import math

import numpy as np
import pytest

from usmap_ros.mapping.joint.mirror_walls import MirrorWall, face_usually
from usmap_ros.mapping.joint.open_space import ORIENTATIONS
from usmap_ros.mapping.joint.usual_directions import lacks_room, log_priors
from usmap_ros.numerics.arrays import BoolArray


def wall(normal_rad: float, hits: int) -> MirrorWall:
    """Make a wall that was heard so often."""
    heard = np.arange(hits)
    return MirrorWall(normal_rad, 2.0, 0.0, 1.0, heard, heard, 0.0, -0.7)


ROOM = [wall(0.3, 40), wall(0.3 + 0.5 * math.pi, 30), wall(0.31 - math.pi, 20), wall(1.1, 6)]


def test_walls_that_are_square_to_most_face_usually() -> None:
    assert face_usually(ROOM, ROOM).tolist() == [True, True, True, False]


def test_surfaces_that_face_as_most_walls_do_are_the_likeliest() -> None:
    kinds = log_priors(ROOM, 0, 0)[:ORIENTATIONS]
    likeliest = kinds[kinds[:, 1] == 0.0][:, 0]
    # Along and across; the three walls agree on 0.302.
    assert np.sin(2.0 * (likeliest - 0.302)) == pytest.approx(0.0, abs=5e-3)
    assert len(likeliest) == 2


def test_others_are_the_likelier_the_more_of_them_were_heard() -> None:
    kinds = log_priors(ROOM, 0, 0)[:ORIENTATIONS]
    oblique = kinds[np.argmin(np.abs(np.sin(kinds[:, 0] - 1.1))), 1]
    assert oblique == pytest.approx(math.log(7.0 / 91.0))
    assert kinds[:, 1].min() == pytest.approx(math.log(1.0 / 91.0))


def test_without_mirrors_surfaces_face_anywhere() -> None:
    assert not log_priors([], 0, 8)[:ORIENTATIONS, 1].any()


def test_without_mirrors_and_columns_nothing_round_is_looked_for() -> None:
    assert log_priors([], 0, 8)[ORIENTATIONS, 1] < -100.0


def test_round_things_are_the_likelier_the_more_columns_there_are_for_each_wall() -> None:
    # Four walls, as lines of what answers from any side and as mirrors, which columns go with.
    for columns, among_lines, among_mirrors in ((1, 1.0 / 3.0, 2.0 / 3.0), (2, 2.0 / 3.0, 1.0)):
        for walls, share in (([], among_lines), (ROOM, among_mirrors)):
            prior = log_priors(walls, columns, 4)[ORIENTATIONS, 1]
            assert prior == pytest.approx(math.log(share))


def test_round_things_are_looked_for_among_mirrors_even_if_no_column_was_found() -> None:
    assert log_priors(ROOM, 0, 0)[ORIENTATIONS, 1] == pytest.approx(math.log(1.0 / 3.0))


def test_nothing_is_likelier_than_the_most_usual_walls() -> None:
    assert log_priors(ROOM, 7, 0)[:, 1].max() == log_priors([], 7, 4)[:, 1].max() == 0.0


#: Distance to a wall's end, cells, and log-likelihood ratio at which a wall is refuted.
USUAL_CELLS, REFUTED = 20.0, -2.0


def gap_of(cells: int) -> BoolArray:
    """Make cells in which no wall can stand, but for a gap across the tenth row."""
    is_refuted = np.ones((60, 60), bool)
    is_refuted[10 : 10 + cells, 10] = False
    return is_refuted


def lacking(is_refuted: BoolArray, said: float, normal_rad: float) -> BoolArray:
    """Ask of all cells whether there is too little room, if so much speaks for walls in each."""
    everywhere = np.full(is_refuted.shape, said, np.float32)
    asked = np.ones_like(is_refuted)
    return lacks_room(everywhere, is_refuted, asked, normal_rad, USUAL_CELLS, REFUTED)


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
    is_refuted, said = gap_of(5), np.zeros((60, 60), np.float32)
    asked = np.zeros_like(is_refuted)
    asked[12, 10] = True
    lacks = lacks_room(said, is_refuted, asked, 0.0, USUAL_CELLS, REFUTED)
    assert np.argwhere(lacks).tolist() == [[12, 10]]
