"""Echoes of many pings as arrays."""

from dataclasses import replace

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


def test_an_echo_that_sets_in_is_likelier_of_a_landmark_than_one_in_a_tail() -> None:
    ranges_m = np.array([1.0, 1.1, 1.2, 2.0])
    heard = cone(Pose.planar(0.0, 0.0, 0.0), ranges_m)
    of_one_loudness = np.exp(-0.23 * heard.attenuation_db_m * ranges_m) / ranges_m**2
    dropping = of_one_loudness * np.array([1.0, 0.3, 0.1, 0.3])
    loud = replace(heard, amplitudes=dropping.astype(np.float32))
    onset = tabulate([loud], np.ones(1)).onset
    assert (onset[[0, 3]] > 1.0).all()
    assert onset[1] < 0.3
    assert onset[2] < onset[1]
