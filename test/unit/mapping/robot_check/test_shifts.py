"""Who is elsewhere than it says, by what others bear out of it at places that are tried."""

import numpy as np
import pytest

from usmap_ros.mapping.robot_check.shifts import SHIFTS_M, RobotPairs

#: A place among those that are tried: 0.9 m to the north.
THERE = int(np.argmin(np.hypot(*(SHIFTS_M - (0.0, 0.9)).T)))


@pytest.mark.parametrize(
    ("told", "there", "is_moved"),
    [(-10.0, 30.0, True), (0.0, 45.0, False), (-5.0, 53.0, False), (7.0, 270.0, True)],
    ids=["contradicted", "alone", "hardly contradicted", "borne out far better"],
)
def test_one_who_is_alone_where_it_is_may_be_there(
    told: float, there: float, is_moved: bool
) -> None:
    """Healthy robots in a corner of a room of parallel walls were said to be elsewhere."""
    pairs, said = RobotPairs({}, lambda: None), np.zeros(len(SHIFTS_M))
    said[0], said[THERE] = told, there
    pairs.names, pairs._said = ["one", "other"], {("one", "other"): said}
    assert (pairs.shift("one") is not None) == is_moved
