"""Indices of spans."""

import numpy as np

from usmap_ros.numerics.arrays import spans


def test_spans_follow_one_another_and_may_be_empty() -> None:
    assert spans(np.array([5, 9, 0]), np.array([3, 0, 2])).tolist() == [5, 6, 7, 0, 1]
    nothing = np.zeros(0, np.int64)
    assert spans(nothing, nothing).tolist() == []
