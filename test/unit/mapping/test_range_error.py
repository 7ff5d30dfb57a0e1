"""What is wrong with all ranges shows in how well echoes meet."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from usmap_ros.mapping.focus import (
    LEAST_PINGS,
    Ping,
    arcs_of,
    from_several_places,
    meetings,
)
from usmap_ros.mapping.joint.kept_pings import KeptPings
from usmap_ros.mapping.range_error import (
    LEAST_LATE_M,
    LEAST_SCALE,
    NOTHING,
    RangeError,
    range_error,
    with_ranges,
)
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

Make = Callable[..., EchoCone]
#: Poles, m.
POLES_M = [(1.0, 1.2), (3.1, 0.4), (4.2, 2.6), (2.0, 3.9), (0.2, 2.8), (3.0, 2.0)]
#: Sound is slower than stated.
SLOWER = RangeError(0.97)


def heard_of(
    points_m: list[tuple[float, float]],
    make_cone: Make,
    wrong: RangeError,
    pings: int,
    robot: int = 1,
    radius_m: float = 0.0,
    nearest_m: float = 0.3,
) -> list[Ping]:
    """Pings of a robot on its way among points or columns, whose ranges are all wrong."""
    rng, found = np.random.default_rng(robot), list[Ping]()
    for number in range(pings):
        x_m, y_m = rng.uniform(-0.5, 4.5, 2)
        yaw_rad = rng.uniform(-math.pi, math.pi)
        echoes = []
        for point in points_m:
            away_m = math.hypot(point[0] - x_m, point[1] - y_m)
            off_rad = math.atan2(point[1] - y_m, point[0] - x_m) - yaw_rad
            if (
                nearest_m < away_m - radius_m < 2.8
                and abs(math.remainder(off_rad, 2.0 * math.pi)) < 0.6
            ):
                told_m = (away_m - radius_m + wrong.late_m) / wrong.scale + rng.normal(0.0, 0.003)
                echoes.append((told_m, 0.5 / away_m**2))
        cone = make_cone(*sorted(echoes), x_m=x_m, y_m=y_m, yaw_rad=yaw_rad, stamp_ns=number)
        found.append((cone, f"robot{robot}"))
    return found


def error_of(pings: list[Ping]) -> RangeError:
    """What is wrong with all ranges."""
    return range_error(from_several_places(pings))


@pytest.mark.parametrize("scale", [0.96, 0.98, 1.02, 1.05])
def test_sound_that_is_not_as_fast_as_stated_is_found_out(make_cone: Make, scale: float) -> None:
    found = error_of(heard_of(POLES_M, make_cone, RangeError(scale), 200))
    assert found.scale == pytest.approx(scale, abs=0.004)
    assert found.late_m == 0.0


@pytest.mark.parametrize("late_m", [0.05, 0.1, 0.15])
def test_ranges_that_are_told_late_are_found_out(make_cone: Make, late_m: float) -> None:
    found = error_of(heard_of(POLES_M, make_cone, RangeError(late_m=late_m), 200))
    assert found.late_m == pytest.approx(late_m, abs=0.008)
    assert found.scale == 1.0


@pytest.mark.parametrize(
    "wrong",
    [
        NOTHING, RangeError(1.0 + 0.5 * LEAST_SCALE), RangeError(1.0 - 0.5 * LEAST_SCALE),
        RangeError(late_m=0.5 * LEAST_LATE_M),
    ],
)  # fmt: skip
def test_ranges_that_are_hardly_off_stay(make_cone: Make, wrong: RangeError) -> None:
    assert error_of(heard_of(POLES_M, make_cone, wrong, 200)) == NOTHING


@pytest.mark.parametrize(
    ("radius_m", "nearest_m"), [(0.05, 0.3), (0.05, 1.8), (0.08, 1.0), (0.12, 1.0), (0.2, 1.8)]
)
def test_round_columns_are_heard_before_their_middles_and_sound_is_as_stated(
    make_cone: Make, radius_m: float, nearest_m: float
) -> None:
    pings = heard_of(POLES_M, make_cone, NOTHING, 400, radius_m=radius_m, nearest_m=nearest_m)
    assert error_of(pings) == NOTHING


def test_few_pings_tell_nothing(make_cone: Make) -> None:
    assert error_of(heard_of(POLES_M, make_cone, SLOWER, LEAST_PINGS // 2)) == NOTHING


def test_what_stands_at_the_same_distance_all_the_time_tells_nothing(make_cone: Make) -> None:
    """Along a wall ranges may be as long as they like."""
    pings = [
        (make_cone((1.03, 0.4), x_m=0.16 * number, yaw_rad=0.5 * math.pi), "robot1")
        for number in range(200)
    ]
    assert error_of(pings) == NOTHING


def test_all_robots_must_gain(make_cone: Make) -> None:
    """Of one whose ranges are too long the others' say nothing: that is its own fault."""
    wrong = heard_of(POLES_M, make_cone, SLOWER, 200)
    right = heard_of(POLES_M, make_cone, NOTHING, 60, robot=2)
    alike = heard_of(POLES_M, make_cone, SLOWER, 60, robot=2)
    assert error_of(wrong + right) == NOTHING
    assert error_of(wrong + alike).scale == pytest.approx(SLOWER.scale, abs=0.004)


def test_it_is_the_same_in_any_order(make_cone: Make) -> None:
    pings = heard_of(POLES_M, make_cone, SLOWER, 200) + heard_of(POLES_M, make_cone, SLOWER, 200, 2)
    assert error_of(pings) == error_of(pings[::-1]) != NOTHING


def test_how_many_arcs_meet_does_not_depend_on_what_else_is_tried(make_cone: Make) -> None:
    """Errors are tried a few at a time: all of them must be counted in the same cells."""
    told = arcs_of([one for one, _ in heard_of(POLES_M, make_cone, RangeError(), 200)])
    longer = told._replace(range_m=1.037 * told.range_m)
    alone, beside = meetings({"told": told}), meetings({"told": told, "longer": longer})
    np.testing.assert_array_equal(alone["told"], beside["told"])


def test_robots_that_are_far_apart_need_no_map_of_all_between(make_cone: Make) -> None:
    pings = heard_of(POLES_M, make_cone, SLOWER, 200)
    far = make_cone((1.0, 0.5), x_m=90_000.0, y_m=-90_000.0)
    found = error_of([*pings, (far, "robot1")])
    assert found.scale == pytest.approx(SLOWER.scale, abs=0.004)


def test_what_is_far_away_tells_nothing(make_cone: Make) -> None:
    """Arcs of hundreds of metres would need cells of as many."""
    pings = heard_of(POLES_M, make_cone, SLOWER, 200)
    pings[0] = make_cone((900.0, 1.0)), pings[0][1]
    assert error_of(pings).scale == pytest.approx(SLOWER.scale, abs=0.004)


def test_what_is_beyond_the_limits_is_left_out(make_cone: Make) -> None:
    cone = make_cone((1.0, 0.5), (2.99, 0.1))
    assert cone.transducer.max_range_m == 3.0
    longer, shorter = with_ranges(cone, RangeError(1.05)), with_ranges(cone, RangeError(0.5))
    assert longer.ranges_m == pytest.approx([1.05])
    assert longer.amplitudes == pytest.approx([0.5])
    assert shorter.ranges_m == pytest.approx([0.5, 1.495])
    assert with_ranges(cone, RangeError(late_m=0.1)).ranges_m == pytest.approx([0.9, 2.89])


@pytest.mark.parametrize("corrects", [True, False])
def test_maps_are_made_of_corrected_ranges_unless_they_must_not(
    make_cone: Make, corrects: bool
) -> None:
    kept = KeptPings(MappingParameters(correct_common_errors=corrects))
    for cone, source in heard_of(POLES_M, make_cone, SLOWER, 200):
        kept.add(cone, source)
    told = np.concatenate([cone.ranges_m for cone, _ in kept.cones()])
    times = kept.pings().echoes.range_m.sum() / told.sum()
    assert times == pytest.approx(SLOWER.scale if corrects else 1.0, abs=0.004)
