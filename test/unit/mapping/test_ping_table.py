"""Several pings in one table: each is as it is alone, however many range bins it has."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from usmap_ros.mapping.ping_bins import NEVER
from usmap_ros.mapping.ping_table import NUMBERS, ping_in_row, ping_table_of
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

MakeCone = Callable[..., EchoCone]
PARAMETERS = MappingParameters()


def test_all_numbers_of_a_look_are_kept(make_cone: MakeCone) -> None:
    ping = ping_in_row(ping_table_of([make_cone()], PARAMETERS), 0)
    assert {n for n, value in ping._asdict().items() if isinstance(value, float)} == set(NUMBERS)


def test_pings_among_others_are_as_they_are_alone(make_cone: MakeCone) -> None:
    cones = [
        make_cone(*[(1.2, 0.3)] * n, x_m=0.01 * n, max_range_m=1.5 + n, limit=0.01 + 0.01 * n)
        for n in range(4)
    ]
    bearings = np.array([np.nan, 0.2, -0.1], np.float32)
    cones[3] = replace(cones[3], bearings_rad=bearings, bearing_stds_rad=0.1 + bearings**2)
    several = ping_table_of(cones, PARAMETERS)
    for row, cone in enumerate(cones):
        alone = ping_in_row(ping_table_of([cone], PARAMETERS), 0)
        among = ping_in_row(several, row)
        for name, value in alone._asdict().items():
            np.testing.assert_array_equal(value, getattr(among, name), err_msg=name)
        beyond = len(among.kind)
        assert not several.power[row, beyond:].any()
        assert (several.next_echo[row, beyond:] == NEVER).all()


def test_no_looks_are_no_rows() -> None:
    assert len(ping_table_of([], PARAMETERS).bins) == 0
