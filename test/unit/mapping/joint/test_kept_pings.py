"""Which pings an estimate is made from, in which order, and in which groups."""

from collections.abc import Callable

import numpy as np
import pytest

from usmap_ros.mapping.joint.kept_pings import MOST_FROM_A_PLACE, KeptPings
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

MakeCone = Callable[..., EchoCone]


@pytest.fixture
def kept() -> KeptPings:
    return KeptPings(MappingParameters())


def stamps(kept: KeptPings) -> list[int]:
    return [cone.stamp_ns for cone, _ in kept.cones()]


def test_of_pings_from_one_place_the_newest_few_are_kept(
    kept: KeptPings, make_cone: MakeCone
) -> None:
    for stamp_ns in range(10):
        kept.add(make_cone(1.0, stamp_ns=stamp_ns), "robot")
    assert stamps(kept) == list(range(10 - MOST_FROM_A_PLACE, 10))
    assert kept.pings().weights.sum() == pytest.approx(1.0)


def test_robots_do_not_displace_each_others_pings(kept: KeptPings, make_cone: MakeCone) -> None:
    for stamp_ns in range(10):
        kept.add(make_cone(1.0, stamp_ns=stamp_ns), f"robot{stamp_ns % 2}")
    assert len(kept) == 2 * MOST_FROM_A_PLACE


def test_pings_from_other_places_and_headings_all_count(
    kept: KeptPings, make_cone: MakeCone
) -> None:
    for number in range(20):
        kept.add(make_cone(1.0, x_m=0.1 * (number % 5), yaw_rad=0.2 * (number // 5)), "robot")
    np.testing.assert_array_equal(kept.pings().weights, 1.0)


def test_pings_are_in_the_order_of_their_stamps(kept: KeptPings, make_cone: MakeCone) -> None:
    for number in (3, 1, 2):
        kept.add(make_cone(1.0, 1.5, x_m=0.5 * number, stamp_ns=number), "robot")
    table, rows, _, echoes = kept.pings()[:4]
    np.testing.assert_allclose(table.numbers[rows, 0], [0.5, 1.0, 1.5])
    np.testing.assert_array_equal(echoes.start, [0, 2, 4, 6])


def test_islands_are_what_cannot_see_the_same_cells(kept: KeptPings, make_cone: MakeCone) -> None:
    for x_m in (0.0, 100.0, 5.0, 104.0, -60.0):
        kept.add(make_cone(1.0, x_m=x_m, max_range_m=3.0), "robot")
    assert kept.islands() == [[0, 2], [1, 3], [4]]


def test_a_copy_stays_as_it_is(kept: KeptPings, make_cone: MakeCone) -> None:
    kept.add(make_cone(1.0, stamp_ns=1), "robot")
    copy = kept.copy()
    kept.add(make_cone(1.0, stamp_ns=2), "robot")
    kept.drop_oldest(1)
    assert (stamps(copy), stamps(kept)) == ([1], [2])
    assert copy.pings().weights == kept.pings().weights == 1.0


def test_no_pings_are_no_islands(kept: KeptPings) -> None:
    assert kept.islands() == []
    assert kept.memory_bytes == 0


def test_a_sensor_that_begins_to_report_more_than_the_first_thing_is_believed(
    kept: KeptPings, make_cone: MakeCone
) -> None:
    for number in range(40):
        kept.add(make_cone(1.0, x_m=0.1 * number, stamp_ns=number), "robot")
    assert kept.pings().first_only.all()
    for number in range(40, 60):
        kept.add(make_cone(1.0, 1.5, x_m=0.1 * number, stamp_ns=number), "robot")
    assert not kept.pings().first_only.any()
    kept.drop_newest()
    kept.drop_oldest(30)
    assert not kept.pings([0]).first_only.any()
