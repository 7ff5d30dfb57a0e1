"""Several pings stacked: what goes in comes out, however many range bins each has."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from usmap_ros.mapping.ping_bins import ping_bins_of
from usmap_ros.mapping.ping_table import NUMBERS, ping_in_row, stacked
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

MakeCone = Callable[..., EchoCone]
PARAMETERS = MappingParameters()


def test_all_numbers_of_a_look_are_kept(make_cone: MakeCone) -> None:
    ping = ping_bins_of(make_cone(), PARAMETERS)
    assert {n for n, value in ping._asdict().items() if isinstance(value, float)} == set(NUMBERS)


def test_looks_come_back_as_they_were(make_cone: MakeCone) -> None:
    pings = [
        ping_bins_of(make_cone((1.2, 0.3), x_m=0.01 * n, max_range_m=1.5 + n), PARAMETERS)
        for n in range(4)
    ]
    several = stacked(pings)
    for row, ping in enumerate(pings):
        kept = ping_in_row(several, row)
        for name, value in ping._asdict().items():
            np.testing.assert_array_equal(value, getattr(kept, name), err_msg=name)


def test_no_looks_are_no_rows() -> None:
    assert len(stacked([]).bins) == 0
