"""Elementary functions in single precision against those of NumPy in double precision."""

from __future__ import annotations

import numpy as np
import pytest

from usmap_ros.numerics.compiled import compiled
from usmap_ros.numerics.elementary import atan2_32, exp32, log32


@compiled
def exponentials(x: np.ndarray, values: np.ndarray) -> None:
    for index in range(len(x)):
        values[index] = exp32(x[index])


@compiled
def logarithms(x: np.ndarray, values: np.ndarray) -> None:
    for index in range(len(x)):
        values[index] = log32(x[index])


@compiled
def directions(y: np.ndarray, x: np.ndarray, values: np.ndarray) -> None:
    for index in range(len(x)):
        values[index] = atan2_32(y[index], x[index])


def test_exponentials_are_right_to_a_millionth() -> None:
    x = np.linspace(-86.0, 87.0, 5001).astype(np.float32)
    values = np.empty_like(x)
    exponentials(x, values)
    np.testing.assert_allclose(values, np.exp(x.astype(float)), rtol=1e-6)


def test_exponentials_beyond_what_can_be_told_are_bounded() -> None:
    x = np.array([-1e6, -100.0, 100.0, 1e6], np.float32)
    values = np.empty_like(x)
    exponentials(x, values)
    assert np.isfinite(values).all()
    assert (values[:2] < 1e-37).all()
    assert (values[2:] > 1e38).all()


@pytest.mark.parametrize(("low", "high"), [(1e-30, 1e30), (0.5, 2.0), (0.999, 1.001)])
def test_logarithms_are_right_to_a_millionth(low: float, high: float) -> None:
    x = np.geomspace(low, high, 5001).astype(np.float32)
    values = np.empty_like(x)
    logarithms(x, values)
    np.testing.assert_allclose(values, np.log(x.astype(float)), rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("radius", [1e-3, 1.0, 1e4])
def test_directions_are_right_to_a_millionth(radius: float) -> None:
    angle = np.linspace(-np.pi, np.pi, 5001)
    y, x = ((radius * at).astype(np.float32) for at in (np.sin(angle), np.cos(angle)))
    values = np.empty_like(x)
    directions(y, x, values)
    np.testing.assert_allclose(values, np.arctan2(y.astype(float), x), atol=1e-6)


def test_no_place_has_a_direction_all_the_same() -> None:
    assert atan2_32(0.0, 0.0) == 0.0
