"""The window of pings: what goes in comes out, in its order, however it is kept."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from usmap_ros.mapping.superposition.ping_bins import Look, look_of
from usmap_ros.mapping.superposition.window import FIRST_ROWS, NUMBERS, Window
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

MakeCone = Callable[..., EchoCone]
PARAMETERS = MappingParameters()


def assert_same(one: Look, other: Look) -> None:
    for name, value in one._asdict().items():
        np.testing.assert_array_equal(value, getattr(other, name), err_msg=name)


def test_all_numbers_of_a_look_are_kept(make_cone: MakeCone) -> None:
    look = look_of(make_cone(), PARAMETERS)
    assert {n for n, value in look._asdict().items() if isinstance(value, float)} == set(NUMBERS)


def test_looks_come_back_as_they_were(make_cone: MakeCone) -> None:
    window, looks = Window(), []
    for number in range(3 * FIRST_ROWS):
        looks.append(look_of(make_cone(x_m=0.01 * number, yaw_rad=0.1 * number), PARAMETERS))
        window.append(looks[-1], f"robot{number}")
        if number % 3 == 0:  # the ring turns while it grows
            window.pop_oldest()
            looks.pop(0)
    assert len(window) == len(looks)
    for kept, look in zip(window, looks, strict=True):
        assert_same(kept, look)
    assert_same(window[2:4][1], looks[3])


def test_looks_of_longer_range_find_room(make_cone: MakeCone) -> None:
    window = Window()
    short = look_of(make_cone(max_range_m=1.5), PARAMETERS)
    long = look_of(make_cone(max_range_m=4.0), PARAMETERS)
    for look in (short, long, short):
        window.append(look, "robot")
    for kept, look in zip(window, (short, long, short), strict=True):
        assert_same(kept, look)


def test_what_a_robot_heard_can_be_left_out(make_cone: MakeCone) -> None:
    window = Window()
    for number in range(6):
        look = look_of(make_cone(x_m=0.1 * number), PARAMETERS)
        window.append(look, f"robot{number % 2}")
    rest = window.without(lambda source: source == "robot1")
    assert list(rest.sources) == ["robot0"] * 3
    assert [look.x_m for look in rest] == pytest.approx([0.0, 0.2, 0.4])


def test_the_newest_can_be_let_go(make_cone: MakeCone) -> None:
    window = Window()
    for x_m in (0.1, 0.2):
        window.append(look_of(make_cone(x_m=x_m), PARAMETERS), "robot")
    window.pop_newest()
    assert [look.x_m for look in window] == [0.1]
    with pytest.raises(IndexError):
        window[1]
