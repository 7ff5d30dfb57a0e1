"""What a floor returns from everywhere is told from things, and hides no more than it does."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from usmap_ros.mapping.joint.kept_pings import KeptPings
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.clutter import APART_M, LEAST_PINGS, clutter_of, without_clutter
from usmap_ros.pings.cone import EchoCone

MakeCone = Callable[..., EchoCone]

#: Ranges that the floor is heard from, and its mean amplitude.
FLOOR_M, FLOOR = np.arange(0.5, 1.2, 0.04), 0.02
LOUD, LIMIT = 0.5, 0.002


def floor_pings(make_cone: MakeCone, apart_m: float = APART_M) -> list[EchoCone]:
    """Pings above a floor, each of which hears a thing as well, and nothing squarely."""
    rng, cones = np.random.default_rng(5), []
    for number in range(2 * LEAST_PINGS):
        speckle = FLOOR * np.sqrt(rng.exponential(size=len(FLOOR_M)))
        thing = 0.51 + 0.01 * number, LOUD
        echoes = sorted([*zip(FLOOR_M, speckle, strict=True), thing])
        cones.append(make_cone(*echoes, x_m=apart_m * number, limit=LIMIT, stamp_ns=number))
    return cones


def test_a_floor_is_no_thing(make_cone: MakeCone) -> None:
    cones = floor_pings(make_cone)
    left = [without_clutter(cone, clutter_of(cones)) for cone in cones]
    assert all(LOUD in cone.amplitudes for cone in left)
    assert np.mean([len(cone.ranges_m) for cone in left]) < 1.1


def test_a_floor_hides_what_is_hardly_louder(make_cone: MakeCone) -> None:
    cones = floor_pings(make_cone)
    limits = without_clutter(cones[0], clutter_of(cones)).limit_amplitudes()
    at_m = 0.1 + cones[0].limit_step_m * (np.arange(len(limits)) + 0.5)
    there = (at_m > 0.6) & (at_m < 1.1)
    assert np.all((limits[there] > 5.0 * FLOOR) & (limits[there] < LOUD))
    np.testing.assert_array_equal(limits[at_m < 0.3], cones[0].limit_amplitudes()[at_m < 0.3])
    # Farther off most pings hear nothing of it, and it is as it was, only fainter.
    beyond = limits[at_m > 1.3]
    assert beyond[0] > 5.0 * LIMIT
    assert np.all(np.diff(beyond) <= 0.0)


def faint_floor_pings(make_cone: MakeCone, stretches: int = 1) -> list[EchoCone]:
    """The same of a floor so faint that every other ping hears nothing of it where it is.

    It lies in the first of so many stretches of the way, and in each that follows after as many.
    """
    rng, cones = np.random.default_rng(6), []
    for number in range(4 * LEAST_PINGS):
        speckle = 0.9 * LIMIT * np.sqrt(rng.exponential(size=len(FLOOR_M)))
        heard = (speckle > LIMIT) & (number // 15 % stretches == 0)
        thing = 0.51 + 0.01 * number, LOUD
        echoes = sorted([*zip(FLOOR_M[heard], speckle[heard], strict=True), thing])
        cones.append(make_cone(*echoes, x_m=APART_M * number, limit=LIMIT, stamp_ns=number))
    return cones


def test_a_faint_floor_is_no_thing(make_cone: MakeCone) -> None:
    cones = faint_floor_pings(make_cone)
    assert np.mean([len(cone.ranges_m) for cone in cones]) > 4.0
    left = [without_clutter(cone, clutter_of(cones)) for cone in cones]
    assert all(LOUD in cone.amplitudes for cone in left)
    assert np.mean([len(cone.ranges_m) for cone in left]) < 1.1


def test_a_faint_floor_hides_things_only_where_it_is_heard(make_cone: MakeCone) -> None:
    cones = faint_floor_pings(make_cone)
    clutter = clutter_of(cones)
    for cone in cones[:20]:
        limits = without_clutter(cone, clutter).limit_amplitudes()
        at_m = 0.1 + cone.limit_step_m * (np.arange(len(limits)) + 0.5)
        floor_m = cone.ranges_m[cone.amplitudes < LOUD]
        apart_m = np.abs(at_m[:, np.newaxis] - floor_m).min(axis=1, initial=9.0)
        assert np.all(limits[apart_m < 0.02] > 5.0 * LIMIT)
        assert np.all(limits[apart_m > 0.1] < 3.0 * LIMIT)


def test_walls_that_some_stretches_hear_are_no_faint_floor(make_cone: MakeCone) -> None:
    assert clutter_of(faint_floor_pings(make_cone, stretches=2)) == {}


def test_what_one_robot_hears_of_a_floor_is_known_of_all(make_cone: MakeCone) -> None:
    kept = KeptPings(MappingParameters())
    *cones, last = floor_pings(make_cone)
    for cone in cones:
        kept.add(cone, "a")
    kept.add(replace(last, child_frame_id="other/sonar"), "b")
    assert kept.pings().echoes.start[-1] < 1.1 * len(kept)


def test_other_kinds_of_sensors_hear_other_floors(make_cone: MakeCone) -> None:
    clutter = clutter_of(floor_pings(make_cone))
    other = make_cone((0.8, FLOOR), max_range_m=5.0)
    assert without_clutter(other, clutter) is other


@pytest.mark.parametrize("count", [LEAST_PINGS - 1, 2 * LEAST_PINGS])
def test_few_pings_and_pings_from_one_place_tell_nothing(count: int, make_cone: MakeCone) -> None:
    apart_m = APART_M if count < LEAST_PINGS else 0.001
    assert clutter_of(floor_pings(make_cone, apart_m)[:count]) == {}


def test_a_wall_that_robots_follow_is_no_floor(make_cone: MakeCone) -> None:
    wall = [(0.8 + 0.04 * after, LOUD * 0.7**after) for after in range(9)]
    assert clutter_of([make_cone(*wall, x_m=APART_M * n) for n in range(2 * LEAST_PINGS)]) == {}


def test_things_all_about_are_no_floor(make_cone: MakeCone) -> None:
    rng = np.random.default_rng(3)
    cones = [
        make_cone(*np.sort(rng.uniform(0.3, 2.5, 8)), x_m=APART_M * number)
        for number in range(2 * LEAST_PINGS)
    ]
    assert clutter_of(cones) == {}


def test_rough_walls_around_are_no_floor(make_cone: MakeCone) -> None:
    rng, cones = np.random.default_rng(7), []
    for number in range(2 * LEAST_PINGS):
        ranges_m = np.arange(rng.uniform(0.3, 1.1), 3.0, 0.04)
        speckle = FLOOR * np.sqrt(rng.exponential(size=len(ranges_m)))
        # The nearest point is struck squarely.
        speckle[0] = LOUD
        echoes = zip(ranges_m, speckle, strict=True)
        cones.append(make_cone(*echoes, x_m=APART_M * number, limit=LIMIT, stamp_ns=number))
    assert clutter_of(cones) == {}


def test_robots_that_carry_sensors_at_other_heights_hear_a_floor(make_cone: MakeCone) -> None:
    near = floor_pings(make_cone)
    far = [
        replace(cone, child_frame_id="high/sonar", ranges_m=cone.ranges_m + np.float32(0.2))
        for cone in near
    ]
    assert clutter_of([*near, *far])


def test_who_is_not_believed_is_not_asked_of_floors(make_cone: MakeCone) -> None:
    kept = KeptPings(MappingParameters())
    for cone in floor_pings(make_cone):
        kept.add(cone, "liar")
    assert kept.sensors().clutter
    kept.believe({"liar": 0.0})
    assert not kept.sensors().clutter
