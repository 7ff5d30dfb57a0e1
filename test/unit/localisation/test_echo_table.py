"""Echoes of many pings as arrays."""

import numpy as np
from pings_among_poles import cone

from usmap_ros.localisation.echo_table import first_of_each_ping, tabulate
from usmap_ros.numerics.geometry import Pose


def test_the_first_echo_of_each_ping_is_its_nearest() -> None:
    heard = [[1.0, 1.4, 2.0], [], [0.7], [2.1, 2.3]]
    pings = [
        cone(Pose.planar(0.0, 0.0, 0.0), np.array(ranges_m), number)
        for number, ranges_m in enumerate(heard)
    ]
    first = first_of_each_ping(tabulate(pings, np.array([1.0, 1.0, 0.5, 1.0])))
    assert first.ping.tolist() == [0, 2, 3]
    np.testing.assert_allclose(first.range_m, [1.0, 0.7, 2.1], atol=1e-3)
    np.testing.assert_allclose(first.weight, [1.0, 0.5, 1.0])
