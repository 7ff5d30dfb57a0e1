"""How far looks from one side of a surface repeat each other."""

import numpy as np
import pytest

from usmap_ros.mapping.joint.free_space.overdispersion import USUAL_SHAPE, most_likely_shape
from usmap_ros.mapping.joint.visibility.soundings import SECTORS, sector_of


@pytest.mark.parametrize("shape", [1.0, 2.0, 4.0])
def test_shape_is_found_from_sides_that_answer_by_a_gamma_distribution(shape: float) -> None:
    rng = np.random.default_rng(5)
    said = rng.uniform(0.5, 30.0, 4000)
    heard = rng.poisson(rng.gamma(shape, 1.0 / shape, 4000) * said) > 0
    assert most_likely_shape(said, heard) == pytest.approx(shape, rel=0.15)


def test_the_usual_shape_is_taken_where_nothing_was_heard_of() -> None:
    shape = most_likely_shape(np.zeros(0), np.zeros(0, bool))
    assert shape == pytest.approx(USUAL_SHAPE, rel=0.05)


def test_sides_that_are_silent_in_spite_of_many_looks_lower_the_shape() -> None:
    said, mute = np.full(100, 12.0), np.arange(100) < 20
    assert most_likely_shape(said, ~mute) < most_likely_shape(said, np.ones(100, bool))


def test_sectors_go_round_once() -> None:
    turns = ((np.arange(SECTORS) + 0.5) / SECTORS).astype(np.float32)
    assert [sector_of(each) for each in turns] == list(range(SECTORS))
    assert [sector_of(each + 1.0) for each in turns] == list(range(SECTORS))
