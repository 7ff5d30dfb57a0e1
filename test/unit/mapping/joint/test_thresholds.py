"""What silence has to say to refute surfaces, by what a place is like."""

import math

import pytest

from usmap_ros.mapping.joint.free_space.silence import (
    LEAST_MIRRORED,
    LONE,
    MIRRORED,
    WALLED,
    thresholds_of,
)


@pytest.mark.parametrize(("walled", "of_place"), [(0.0, LONE), (1.0, WALLED)])
def test_what_answers_from_any_side_needs_no_more_silence_than_mirrors(
    walled: float, of_place: tuple[float, float, float]
) -> None:
    found = thresholds_of(walled, has_mirrors=False, wide=0.0)
    assert found == pytest.approx(of_place)
    assert found.mirrors_refuted < found.refuted < 0.0


def test_where_walls_are_that_nobody_has_heard_it_needs_as_much() -> None:
    room, hall = (thresholds_of(1.0, has_mirrors=False, wide=wide) for wide in (0.0, 1.0))
    assert hall.refuted == hall.mirrors_refuted == room.mirrors_refuted
    half = thresholds_of(1.0, has_mirrors=False, wide=0.5)
    assert half.refuted == pytest.approx(0.5 * (room.refuted + hall.refuted))


@pytest.mark.parametrize("walled", [0.0, 0.5, 1.0])
def test_where_mirrors_were_found_none_is_refuted_by_being_rare_alone(walled: float) -> None:
    """A robot left through a wall of glass that it had not struck: bricks stood beside."""
    found = thresholds_of(walled, has_mirrors=True, wide=0.0)
    assert found.refuted == found.mirrors_refuted >= MIRRORED[0]
    assert found.unknown <= MIRRORED[1]
    assert found.mirrors_refuted < math.log(LEAST_MIRRORED)
