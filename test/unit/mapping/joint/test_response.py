"""How a place answers: what silence says at each angle of incidence."""

import numpy as np
import pytest

from usmap_ros.mapping.joint.free_space.fading import FAINTEST
from usmap_ros.mapping.joint.free_space.response import (
    GRAZING_POWER,
    SurfaceViews,
    learn_response,
)
from usmap_ros.mapping.joint.visibility.soundings import INCIDENCES

#: A wall that faces along x; the class of loudness of all looks, and how often a window beside
#: what is looked at is silent.
WALL, LOUD, BESIDE = np.array([[10.0, 10.0, 0.0]]), 15, 0.8
#: Shares of echoes, by class of incidence, of walls that answer from any side, and of such that are
#: bent by a tenth of the wavelength, less than those that come by chance.
ROUGH = [1.0, 1.0, 1.0, 1.0, 0.95, 0.8, 0.6, 0.4]
BENT = [1.0, 1.0, 1.0, 1.0, 0.75, 0.4, 0.2, 0.2]
#: Angles from 67 to 79 degrees.
GRAZING = 6


def looks_at(shares: list[float], looks: list[int]) -> SurfaceViews:
    """Looks at a wall, of which such shares are answered."""
    incidence = np.repeat(np.arange(INCIDENCES), looks)
    heard = np.concatenate(
        [np.arange(count) < share * count for share, count in zip(shares, looks, strict=True)]
    )
    zeros = np.zeros(len(heard), np.int32)
    return SurfaceViews(
        zeros, zeros + LOUD, incidence.astype(np.int32), zeros, heard.astype(np.uint8),
        np.full(len(heard), BESIDE, np.float32),
    )  # fmt: skip


def test_grazing_silence_of_rough_walls_says_most_of_what_it_does_at_40_degrees() -> None:
    learnt = learn_response(looks_at(ROUGH, [400] * INCIDENCES), WALL)[LOUD]
    assert learnt[GRAZING] == pytest.approx(GRAZING_POWER * learnt[3], abs=0.05)
    assert learnt[GRAZING] < -1.0


def test_where_answers_fade_grazing_silence_says_nothing() -> None:
    """Walls that nobody had looked at otherwise were refuted by it, and robots left through them.

    A place counts as rough by what it answers at 45 to 67 degrees.
    """
    learnt = learn_response(looks_at(BENT, [400] * INCIDENCES), WALL)[LOUD]
    assert learnt[GRAZING] == pytest.approx(0.0, abs=0.01)
    assert learnt[3] < -2.5
    assert learnt[4] < -1.0


def test_few_grazing_looks_do_not_tell_whether_answers_fade() -> None:
    looks = [400] * 5 + [40] * 3
    rough, bent = (learn_response(looks_at(shares, looks), WALL)[LOUD] for shares in (ROUGH, BENT))
    assert bent[GRAZING] == pytest.approx(rough[GRAZING], abs=0.3)
    assert bent[GRAZING] < -1.0


def test_what_nobody_saw_aslant_from_one_side_is_not_rough() -> None:
    """Robots that looked ahead alone left through the walls beside them."""
    looks = [400] * 5 + [40, 0, 0]
    several, one = (
        learn_response(looks_at(ROUGH, looks), WALL, one_sided)[LOUD] for one_sided in (0.0, 1.0)
    )
    assert several[GRAZING] < -1.0
    assert one[GRAZING] == pytest.approx(0.0, abs=0.01)
    np.testing.assert_array_equal(several[:4], one[:4])


def test_flat_looks_that_were_many_tell_as_much_from_one_side() -> None:
    several, one = (
        learn_response(looks_at(ROUGH, [400] * INCIDENCES), WALL, one_sided)
        for one_sided in (0.0, 1.0)
    )
    np.testing.assert_array_equal(several, one)


def test_faint_answers_may_fade_where_loud_ones_do_not() -> None:
    """Near walls answered at any angle, and far ones did not: space behind a far one was free."""
    mute, faint = [*ROUGH[:5], 0.2, 0.2, 0.2], LOUD - 6
    near, far = looks_at(ROUGH, [400] * INCIDENCES), looks_at(mute, [400] * INCIDENCES)
    far = far._replace(loud=far.loud - (LOUD - faint))
    both = SurfaceViews(*(np.concatenate(each) for each in zip(near, far, strict=True)))
    learnt = learn_response(both, WALL)
    assert learnt[LOUD, GRAZING] < -1.0
    assert learnt[faint, GRAZING] == pytest.approx(0.0, abs=0.01)
    assert learnt[faint, 3] < -1.0


def test_the_faintest_are_taken_as_what_is_a_little_louder() -> None:
    """Hardly anything answers there aslant, and rough flats knew 1 % less for it."""
    rough, mute = looks_at(ROUGH, [400] * INCIDENCES), [*ROUGH[:5], 0.2, 0.2, 0.2]
    rough = rough._replace(loud=rough.loud - (LOUD - FAINTEST))
    faint = looks_at(mute, [400] * INCIDENCES)
    faint = faint._replace(loud=faint.loud * 0)
    both = SurfaceViews(*(np.concatenate(each) for each in zip(rough, faint, strict=True)))
    assert learn_response(both, WALL)[0, GRAZING] < -1.0
