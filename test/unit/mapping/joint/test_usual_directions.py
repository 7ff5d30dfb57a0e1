"""Directions in which the walls of a place face."""

import math

import numpy as np
import pytest

from usmap_ros.mapping.joint.mirror_walls import MirrorWall, face_usually
from usmap_ros.mapping.joint.open_space import ORIENTATIONS
from usmap_ros.mapping.joint.usual_directions import is_too_short, log_priors


def wall(normal_rad: float, hits: int) -> MirrorWall:
    """Make a wall that was heard so often."""
    heard = np.arange(hits)
    return MirrorWall(normal_rad, 2.0, 0.0, 1.0, heard, heard, 0.0, -0.7)


ROOM = [wall(0.3, 40), wall(0.3 + 0.5 * math.pi, 30), wall(0.31 - math.pi, 20), wall(1.1, 6)]


def test_walls_that_are_square_to_most_face_usually() -> None:
    assert face_usually(ROOM, ROOM).tolist() == [True, True, True, False]


def test_surfaces_that_face_as_most_walls_do_are_the_likeliest() -> None:
    kinds = log_priors(ROOM)[:ORIENTATIONS]
    likeliest = kinds[kinds[:, 1] == 0.0][:, 0]
    # Along and across; the three walls agree on 0.302.
    assert np.sin(2.0 * (likeliest - 0.302)) == pytest.approx(0.0, abs=5e-3)
    assert len(likeliest) == 2


def test_others_are_the_likelier_the_more_of_them_were_heard() -> None:
    kinds = log_priors(ROOM)[:ORIENTATIONS]
    oblique = kinds[np.argmin(np.abs(np.sin(kinds[:, 0] - 1.1))), 1]
    assert oblique == pytest.approx(math.log(7.0 / 91.0))
    assert kinds[:, 1].min() == pytest.approx(math.log(1.0 / 91.0))


def test_without_mirrors_surfaces_face_anywhere_and_none_is_round() -> None:
    kinds = log_priors([])
    assert not kinds[:ORIENTATIONS, 1].any()
    assert (kinds[ORIENTATIONS:, 1] < -100.0).all()


def test_where_columns_were_found_there_may_be_others() -> None:
    for columns_a_line, prior in ((0.25, math.log(0.25)), (1.0, 0.0), (3.0, 0.0)):
        assert log_priors([], columns_a_line)[ORIENTATIONS:, 1].tolist() == [prior]


def test_with_mirrors_round_things_are_as_likely_as_any() -> None:
    assert log_priors(ROOM)[ORIENTATIONS:, 1].tolist() == [0.0]


@pytest.mark.parametrize("normal_rad", [0.0, 0.5 * math.pi])
def test_a_wall_needs_its_length_between_what_is_refuted(normal_rad: float) -> None:
    # Refuted but for a gap of five cells along a wall that faces the first way.
    is_refuted = np.ones((20, 20), bool)
    is_refuted[8:13, 10] = False
    along = is_refuted if normal_rad == 0.0 else is_refuted.T
    gap = ~along
    assert is_too_short(along, normal_rad, 6)[gap].all()
    assert not is_too_short(along, normal_rad, 5)[gap].any()


def test_a_wall_may_stand_where_only_one_side_is_refuted() -> None:
    is_refuted = np.zeros((20, 20), bool)
    is_refuted[:8] = True
    assert not is_too_short(is_refuted, 0.0, 8)[~is_refuted].any()
