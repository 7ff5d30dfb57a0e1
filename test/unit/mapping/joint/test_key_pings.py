"""Key pings: as many as look at everything often enough, and a map that is no other for it."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from usmap_ros.mapping.joint import estimate
from usmap_ros.mapping.joint.fusion import JointFusion
from usmap_ros.mapping.joint.key_pings import key_pings
from usmap_ros.mapping.joint.looks import ENOUGH_LOOKS
from usmap_ros.mapping.ping_table import ping_table_of
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

MakeCone = Callable[..., EchoCone]


def chosen(cones: list[EchoCone], weight: float = 1.0) -> list[int]:
    table = ping_table_of(cones, MappingParameters())
    weights = np.full(len(cones), weight, np.float32)
    return key_pings(table, np.arange(len(cones)), weights).tolist()


def beside(make_cone: MakeCone, count: int, yaw_rad: float = 0.1) -> list[EchoCone]:
    """Pings from almost the same place, that look the same way."""
    return [make_cone(x_m=0.1 + 0.0005 * number, yaw_rad=yaw_rad) for number in range(count)]


def test_no_more_looks_of_a_place_than_are_enough(make_cone: MakeCone) -> None:
    assert len(chosen(beside(make_cone, 40))) == ENOUGH_LOOKS


def test_they_are_spread_over_the_time(make_cone: MakeCone) -> None:
    first, *_, last = chosen(beside(make_cone, 64))
    assert first < 16
    assert last >= 48


def test_pings_that_hardly_count_are_hardly_looks(make_cone: MakeCone) -> None:
    assert len(chosen(beside(make_cone, 40), weight=0.2)) == 5 * ENOUGH_LOOKS
    assert len(chosen(beside(make_cone, 40), weight=0.0)) == 40


def test_who_looks_another_way_adds_looks(make_cone: MakeCone) -> None:
    behind = beside(make_cone, 3, yaw_rad=0.1 + math.pi)
    assert {40, 41, 42} < set(chosen(beside(make_cone, 40) + behind))


def test_maps_are_no_other_for_it(views: list[EchoCone], monkeypatch: pytest.MonkeyPatch) -> None:
    """Robots that go the same way again and again, each time a little beside it."""
    cones = []
    for turn in range(20):
        for number, cone in enumerate(views):
            position_m = cone.pose.position_m + np.array([0.0, 0.0, 0.025 * turn])
            pose = replace(cone.pose, position_m=position_m)
            cones.append(replace(cone, stamp_ns=100 * turn + number, pose=pose))
    assert len(chosen(cones)) < estimate.MOST_KEY_SHARE * len(cones)
    maps = []
    for share in (1.0, 0.0):
        monkeypatch.setattr(estimate, "MOST_KEY_SHARE", share)
        fusion = JointFusion(MappingParameters())
        for cone in cones:
            fusion.fuse(cone, "robot")
        maps.append(fusion.occupancy_map())
    few, every = maps
    np.testing.assert_array_equal(few.predicted(), every.predicted())
    np.testing.assert_array_equal(few.observed, every.observed)
