"""New pings that tell something, and those that say again what is known."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from usmap_ros.mapping.joint import live_map
from usmap_ros.mapping.joint.area_state import AreaState
from usmap_ros.mapping.joint.explanation import explained
from usmap_ros.mapping.joint.fusion import JointFusion
from usmap_ros.mapping.joint.kept_pings import KeptPings, Pings
from usmap_ros.mapping.joint.looks import ENOUGH_LOOKS, Looks
from usmap_ros.mapping.joint.more_pings import MorePings
from usmap_ros.mapping.joint.telling_pings import telling
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

PARAMETERS = MappingParameters()
#: What stands around the robots, and something else in front of it.
OBJECTS = [(0.3, 0.2, 0.6), (-0.4, -0.1, 0.4)]
ANOTHER = (0.9, 0.6, 0.6)

MakeCone = Callable[..., EchoCone]


def way(cone_of_objects: MakeCone, turns: int, objects: list[tuple[float, ...]]) -> list[EchoCone]:
    """Pings of a robot that goes round and round and looks inwards."""
    angles = np.linspace(0.0, 2.0 * np.pi * turns, 24 * turns, endpoint=False)
    return [
        cone_of_objects(
            *objects, stamp_ns=number,
            x_m=1.7 * np.cos(angle), y_m=1.6 * np.sin(angle) + 0.03 * (number // 24 % 8),
            yaw_rad=angle + np.pi,
        )
        for number, angle in enumerate(angles)
    ]  # fmt: skip


def pings_of(cones: list[EchoCone]) -> Pings:
    kept = KeptPings(PARAMETERS)
    for cone in cones:
        kept.add(cone, "robot")
    return kept.pings()


@pytest.fixture(scope="module")
def known(cone_of_objects: MakeCone) -> AreaState:
    """Give what eight times round tell."""
    kept = KeptPings(PARAMETERS)
    for cone in way(cone_of_objects, 8, OBJECTS):
        kept.add(cone, "robot")
    (area,) = explained(kept, PARAMETERS).areas
    return area


def told(cones: list[EchoCone], known: AreaState) -> list[int]:
    """Stamps of the pings that tell something."""
    pings = pings_of(cones)
    found, _ = telling(pings, known, PARAMETERS)
    return sorted(int(np.flatnonzero(pings.rows == row)[0]) for row in found.rows)


def test_who_looks_again_and_hears_the_same_tells_nothing(
    cone_of_objects: MakeCone, known: AreaState
) -> None:
    assert told(way(cone_of_objects, 1, OBJECTS), known) == []


def test_who_hears_something_new_tells_it(cone_of_objects: MakeCone, known: AreaState) -> None:
    alone = way(cone_of_objects, 1, [ANOTHER])
    hear = {number for number, cone in enumerate(alone) if len(cone.ranges_m)}
    assert 4 < len(hear) < len(alone)
    tell = set(told(way(cone_of_objects, 1, [*OBJECTS, ANOTHER]), known))
    # But for who hears it from as far away as another thing.
    assert len(hear - tell) <= 2


def test_who_misses_what_was_loud_tells_it(cone_of_objects: MakeCone, known: AreaState) -> None:
    """What stood there has gone."""
    gone, stays = OBJECTS
    heard = way(cone_of_objects, 1, [gone])
    hear = {number for number, cone in enumerate(heard) if len(cone.ranges_m)}
    assert hear
    assert hear & set(told(way(cone_of_objects, 1, [stays]), known))


def test_who_looks_where_few_looked_tells_something(
    cone_of_objects: MakeCone, known: AreaState
) -> None:
    outwards = cone_of_objects(x_m=1.7, yaw_rad=0.0)
    pings = pings_of([outwards])
    found, after = telling(pings, known, PARAMETERS)
    assert len(found.rows) == 1
    assert after.looks.counts.sum() > known.looks.counts.sum()
    assert after.cells is known.cells


def test_looks_are_enough_after_some(cone_of_objects: MakeCone, known: AreaState) -> None:
    outwards = [
        cone_of_objects(x_m=1.7 + 0.001 * number, stamp_ns=number, yaw_rad=0.05)
        for number in range(3 * int(ENOUGH_LOOKS))
    ]
    after = known
    for cone in outwards:
        _, after = telling(pings_of([cone]), after, PARAMETERS)
    assert told(outwards[-1:], known) == [0]
    assert told(outwards[-1:], after) == []


def test_first_things_alone_always_tell(cone_of_objects: MakeCone, known: AreaState) -> None:
    pings = pings_of(way(cone_of_objects, 1, OBJECTS))
    pings = pings._replace(first_only=np.ones(len(pings.rows), bool))
    found, _ = telling(pings, known, PARAMETERS)
    assert len(found.rows) == len(pings.rows)


def test_looks_stay_where_they_are_when_there_is_more_to_look_at(make_cone: MakeCone) -> None:
    here, there = (
        pings_of([make_cone(x_m=x_m, y_m=-0.4 * x_m)]).table.numbers for x_m in (0.2, 7.3)
    )
    one = np.ones(1, np.float32)
    first = Looks.of_none(here).of_all(here, one)
    both = first.reaching(there).of_all(there, one)
    other_way = Looks.of_none(there).of_all(there, one).reaching(here).of_all(here, one)
    assert both.first == other_way.first
    np.testing.assert_array_equal(both.counts, other_way.counts)
    assert both.counts.sum() > 1.5 * first.counts.sum()
    assert first.reaching(here) is first


def test_a_map_in_time_visits_none_of_them(
    cone_of_objects: MakeCone, monkeypatch: pytest.MonkeyPatch
) -> None:
    visited = []

    class More(MorePings):
        def __init__(self, pings: Pings, parameters: MappingParameters) -> None:
            visited.append(len(pings.rows))
            super().__init__(pings, parameters)

    monkeypatch.setattr(live_map, "MorePings", More)
    cones = way(cone_of_objects, 9, OBJECTS)
    fusion = JointFusion(PARAMETERS)
    for cone in cones[:-24]:
        fusion.fuse(cone, "robot")
    before = fusion.live_snapshot()()
    for cone in cones[-24:]:
        fusion.fuse(cone, "robot")
    in_time = fusion.live_snapshot(in_time=True)()
    assert visited == []
    assert in_time.stamp_ns == cones[-1].stamp_ns
    np.testing.assert_array_equal(in_time.log_odds, before.log_odds)


def test_some_pings_have_their_own_echoes(make_cone: MakeCone) -> None:
    cones = [
        replace(make_cone(*((1.0 + 0.1 * echo, 0.5) for echo in range(number))), stamp_ns=number)
        for number in range(4)
    ]
    pings = pings_of(cones)
    some = pings.among(np.array([1, 3]))
    assert some.sources == ["robot", "robot"]
    assert some.echoes.start.tolist() == [0, 1, 4]
    np.testing.assert_array_equal(some.echoes.range_m[1:], pings.echoes.range_m[3:6])
    np.testing.assert_array_equal(pings.among(np.arange(4)).echoes.range_m, pings.echoes.range_m)
