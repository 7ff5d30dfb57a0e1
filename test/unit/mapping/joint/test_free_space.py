"""What is free is connected with where robots were."""

import numpy as np

from usmap_ros.mapping.joint.free_space import connected


def test_free_cells_that_nothing_leads_to_are_none() -> None:
    free, occupied = np.zeros((7, 20), bool), np.zeros((7, 20), bool)
    free[2:5, 1:5] = free[2:5, 6:9] = free[2:5, 10:13] = free[2:5, 16:19] = True
    # A wall between the second and the third; more than a cell or two between the last two.
    occupied[:, 9] = True
    stood = np.zeros_like(free)
    stood[3, 2] = True
    assert np.flatnonzero(connected(free, stood, occupied)[3]).tolist() == [1, 2, 3, 4, 6, 7, 8]
