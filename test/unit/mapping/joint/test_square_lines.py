"""Lines take the direction of a square place if they may have it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from usmap_ros.mapping.joint.surfaces.lines import NO_LINES
from usmap_ros.mapping.joint.surfaces.square_lines import MOST_OFF_RAD, square_direction, squared


def line(angle_rad: float, middle: complex, length: float) -> NDArray[np.float64]:
    """A line that faces in a direction, by its middle and its length."""
    normal = np.exp(1j * angle_rad)
    across, along = (middle * np.conj(normal)).real, (middle * np.conj(1j * normal)).real
    return np.array([normal.real, normal.imag, across, along - 0.5 * length, along + 0.5 * length])


def ends(each: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Where a line begins and ends."""
    normal = complex(each[0], each[1])
    return normal * (each[2] + 1j * each[3:])


@given(
    turn_rad=st.floats(-np.pi, np.pi),
    off_rad=st.floats(-0.15, 0.15),
    x=st.floats(-300.0, 300.0),
    y=st.floats(-300.0, 300.0),
)
def test_a_short_line_turns_about_its_middle_to_how_others_face(
    turn_rad: float, off_rad: float, x: float, y: float
) -> None:
    others = [line(turn_rad, 50.0 + 20.0j, 80.0), line(turn_rad + 0.5 * np.pi, 9.0j, 60.0)]
    short = line(turn_rad + off_rad, complex(x, y), 14.0)
    turned, are_square = squared(np.array([*others, short]))
    assert are_square.all()
    square = [*others, line(turn_rad, complex(x, y), 14.0)]
    assert np.allclose(list(map(ends, turned)), list(map(ends, square)), atol=1e-6)


def test_a_long_line_knows_how_it_faces() -> None:
    long = line(0.1, 30.0j, 60.0)
    turned, are_square = squared(np.array([line(0.0, 0.0, 200.0), long]))
    assert are_square.all()
    assert turned[1] == pytest.approx(long)


def test_what_is_askew_is_not_square() -> None:
    lines = np.array([line(0.0, 0.0, 200.0), line(2.0 * MOST_OFF_RAD, 30.0j, 20.0)])
    turned, are_square = squared(lines)
    assert are_square.tolist() == [True, False]
    assert np.array_equal(turned, lines)


def test_a_hexagon_is_not_square() -> None:
    sides = np.array([line(np.pi / 3.0 * side, 0.0, 40.0) for side in range(3)])
    turned, are_square = squared(sides)
    assert not are_square.any()
    assert np.array_equal(turned, sides)


def test_where_nothing_is_long_nothing_is_square() -> None:
    for lines in (NO_LINES, line(0.0, 0.0, 10.0)[np.newaxis]):
        turned, are_square = squared(lines)
        assert not are_square.any()
        assert np.array_equal(turned, lines)


def test_lines_that_are_square_have_a_direction_and_others_none() -> None:
    lines = np.array([line(0.1, 0.0, 80.0), line(0.1 + 0.5 * np.pi, 0.0, 40.0)])
    direction_rad = square_direction(lines)
    assert direction_rad is not None
    assert np.sin(2.0 * (direction_rad - 0.1)) == pytest.approx(0.0, abs=1e-9)
    askew = np.array([line(np.pi / 4.0 * side, 0.0, 40.0) for side in range(2)])
    assert square_direction(askew) is square_direction(NO_LINES) is None
