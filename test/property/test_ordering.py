"""Shell's sort, as compiled loops use it, gives NumPy's stable order."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from usmap_ros.numerics.arrays import FloatArray, IntArray
from usmap_ros.numerics.compiled import compiled
from usmap_ros.numerics.ordering import ascending


@compiled
def _order(keys: FloatArray) -> IntArray:
    return ascending(keys)


@given(st.lists(st.floats(-8.0, 8.0).map(lambda x: round(x, 1)), max_size=300))
def test_numbers_ascend_and_equal_ones_stay_in_their_order(values: list[float]) -> None:
    keys = np.array(values, dtype=np.float64)
    np.testing.assert_array_equal(_order(keys), np.argsort(keys, kind="stable"))
