"""Pings that are far from all others stay out of the map, and lock out nobody."""

from dataclasses import replace

import numpy as np
import pytest

from usmap_ros.mapping.common_frame import ENOUGH_PINGS
from usmap_ros.mapping.far_off import FarOff, FarOffError, Ping
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone


def ping(cone: EchoCone, number: int, x_m: float, y_m: float = 0.0) -> EchoCone:
    """One of pings that come three times a second."""
    position_m = np.array([x_m, y_m, 0.0])
    stamp_ns = cone.stamp_ns + round(number / 3.0 * 1e9)
    return replace(cone, stamp_ns=stamp_ns, pose=replace(cone.pose, position_m=position_m))


def mapped(far: FarOff, pings: list[Ping]) -> tuple[list[Ping], int]:
    """What is mapped of pings, and how many are set apart at first."""
    taken: list[Ping] = []
    refused = 0
    for topic, cone in pings:
        try:
            taken += far.add(topic, cone)
        except FarOffError:
            refused += 1
        again = far.decide()
        taken = taken if again is None else again
    return taken, refused


def many(cone: EchoCone, topic: str, count: int, x_m: float, y_m: float = 0.0) -> list[Ping]:
    return [(topic, ping(cone, number, x_m, y_m)) for number in range(count)]


def test_one_far_first_ping_locks_nobody_out(cone: EchoCone) -> None:
    far = FarOff(MappingParameters())
    home = many(cone, "/a/cone", 40, 0.0)
    taken, refused = mapped(far, [("/b/cone", ping(cone, 0, 400.0, 400.0)), *home])
    assert taken == home
    assert refused == ENOUGH_PINGS - 1


def test_one_far_ping_among_others_is_set_apart(cone: EchoCone) -> None:
    far = FarOff(MappingParameters())
    home = many(cone, "/a/cone", 40, 0.0)
    taken, refused = mapped(far, [*home[:20], ("/a/cone", ping(cone, 20, 240.0)), *home[20:]])
    assert taken == home
    assert refused == 1
    assert far.finish() == []
    with pytest.raises(FarOffError, match="is 235 m away from all pings that are mapped"):
        far.add("/a/cone", ping(cone, 50, 240.0))


def test_who_goes_on_pinging_elsewhere_is_taken_up(cone: EchoCone) -> None:
    far = FarOff(MappingParameters())
    mapped(far, many(cone, "/a/cone", 40, 0.0))
    there = many(cone, "/b/cone", 40, 120.0)
    taken, _ = mapped(far, there)
    assert taken == there


def test_a_place_that_would_leave_a_map_of_nothing_between_is_not_taken_up(cone: EchoCone) -> None:
    far = FarOff(MappingParameters())
    mapped(far, many(cone, "/a/cone", 40, 0.0))
    assert mapped(far, many(cone, "/b/cone", 40, 230.0, 230.0)) == ([], 40)
    assert far.finish() == []
    # Along one line, there is less between.
    assert len(mapped(far, many(cone, "/c/cone", 40, 230.0))[0]) == 40


def test_who_was_elsewhere_all_the_time_is_taken_up_at_the_end(cone: EchoCone) -> None:
    far = FarOff(MappingParameters())
    here, there = many(cone, "/a/cone", 10, 0.0), many(cone, "/b/cone", 8, 120.0)
    mapped(far, [*here, *there])
    assert far.decide(is_over=True) is None
    assert far.finish() == there


def test_two_places_that_no_map_has_room_for_are_not_both_mapped(cone: EchoCone) -> None:
    far = FarOff(MappingParameters())
    lost = many(cone, "/lost/cone", 200, 5000.0, 5000.0)
    others = [*many(cone, "/a/cone", 40, 0.0), *many(cone, "/b/cone", 40, 8.0)]
    taken, _ = mapped(far, sorted([*lost[:40], *others], key=lambda one: one[1].stamp_ns))
    assert {topic for topic, _ in taken} == {"/a/cone", "/b/cone"}
    taken, refused = mapped(far, lost[40:])
    assert not taken
    assert refused == 160


def test_who_drives_there_is_not_far_off(cone: EchoCone) -> None:
    far = FarOff(MappingParameters())
    way = [("/a/cone", ping(cone, number, 2.0 * number)) for number in range(100)]
    assert mapped(far, way) == (way, 0)


def test_a_thousand_places_take_no_more_memory_than_some(cone: EchoCone) -> None:
    far = FarOff(MappingParameters())
    mapped(far, many(cone, "/a/cone", 40, 0.0))
    lost = [("/b/cone", ping(cone, n, 1000.0 * (n + 1))) for n in range(1000)]
    assert mapped(far, lost) == ([], 1000)
    assert len(mapped(far, many(cone, "/c/cone", 40, -120.0))[0]) == 40
