"""Which share of surfaces may be mirrors that nobody has struck squarely."""

import math

import numpy as np
import pytest

from usmap_ros.mapping.joint.free_space.mirror_share import expected_share, mirror_share
from usmap_ros.mapping.joint.free_space.response import NO_NORMAL, Looked
from usmap_ros.mapping.joint.free_space.silence import WALLED
from usmap_ros.mapping.joint.visibility.soundings import INCIDENCES, LOUDNESSES

#: Square, and at 20 to 50 degrees.
SQUARE, ASLANT = 1, 4
LOG_SILENT = np.full((LOUDNESSES, INCIDENCES), math.log(0.1))


def room(answers_aslant: float, walls: int, is_struck: bool = True) -> float:
    """Share of mirrors in a room of walls, each of 40 cells that five looks strike either way."""
    cells = 40 * walls
    surface = np.repeat(np.arange(cells, dtype=np.int32), 10)
    incidence = np.tile(np.repeat([SQUARE, ASLANT], 5), cells).astype(np.int32)
    if not is_struck:
        incidence[:] = ASLANT
    heard = np.random.default_rng(1).random(len(surface)) < np.where(
        incidence == SQUARE, 0.9, answers_aslant
    )
    classes = np.full(len(surface), 10, np.int32)
    looked = Looked(
        surface, classes, incidence, classes * 0, heard.astype(np.uint8),
        np.ones(len(surface), np.float32),
    )  # fmt: skip
    number = np.repeat(np.arange(walls), 40)
    surfaces = np.stack([np.arange(cells), 20.0 * number, 0.3 * number], axis=1)
    return mirror_share(looked, surfaces, LOG_SILENT, 0.0)


def test_walls_that_answer_aslant_are_no_mirrors() -> None:
    assert room(0.8, 8) < 0.05
    assert room(0.0, 8) > 0.6


def test_few_walls_say_less_than_many() -> None:
    assert room(0.8, 2) > 2.0 * room(0.8, 30)


def test_a_few_walls_that_are_none_are_enough_for_mirrors_to_be_rare() -> None:
    """Rarer than what is refuted: or one robot among rough walls would know half of what it saw."""
    assert room(0.8, 3) < math.exp(WALLED[0])


def test_walls_found_say_nothing_of_mirrors_if_none_would_have_been_struck() -> None:
    unheard = expected_share(0.0, 0.0, 0.5)
    assert expected_share(0.0, 30.0, 0.001) == pytest.approx(unheard, rel=0.1)
    assert expected_share(0.0, 30.0, 0.8) < 0.2 * unheard
    assert room(0.8, 30, is_struck=False) > 2.0 * room(0.8, 30)


def test_what_stands_alone_tells_where_most_does() -> None:
    nothing = np.zeros(0, np.int32)
    looked = Looked(
        nothing, nothing, nothing, nothing, nothing.astype(np.uint8), nothing.astype(np.float32)
    )
    poles = np.tile([3.0, 3.0, NO_NORMAL], (20, 1))
    assert mirror_share(looked, poles, LOG_SILENT, 1.0) < 0.03
    assert mirror_share(looked, poles, LOG_SILENT, 0.0) == pytest.approx(
        expected_share(0.0, 0.0, 0.5), rel=1e-6
    )
