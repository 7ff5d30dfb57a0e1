"""Maps that explain all pings together: what they depend on, and what they keep."""

import gc
import threading
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from usmap_ros.grids import OccupancyMap
from usmap_ros.mapping.joint import estimate, explanation, survey
from usmap_ros.mapping.joint.estimate import JointEstimate
from usmap_ros.mapping.joint.forward_model import ping_groups
from usmap_ros.mapping.joint.fusion import JointFusion
from usmap_ros.mapping.joint.kept_pings import MOST_FROM_A_PLACE
from usmap_ros.mapping.joint.survey import Survey
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.processes import threads

MakeCone = Callable[..., EchoCone]
#: More than twice the range of the pings, and a whole number of cells.
FAR_M = 20.0
#: Where a country's grid may have a room.
COUNTRY_M = 500_000.0, 4_500_000.0


def fused(cones: list[EchoCone], source: str = "", **parameters: float) -> JointFusion:
    fusion = JointFusion(MappingParameters(**parameters))
    for cone in cones:
        fusion.fuse(cone, source)
    return fusion


def assert_same(one: OccupancyMap, other: OccupancyMap) -> None:
    assert one.geometry == other.geometry
    np.testing.assert_array_equal(one.observed, other.observed)
    np.testing.assert_array_equal(one.log_odds, other.log_odds)
    for name, values in one.layers.items():
        np.testing.assert_array_equal(values, other.layers[name])


def moved(cone: EchoCone, x_m: float) -> EchoCone:
    pose = replace(cone.pose, position_m=cone.pose.position_m + np.array([x_m, 0.0, 0.0]))
    return replace(cone, pose=pose)


def at(occupancy: OccupancyMap, values: np.ndarray, x_m: float, y_m: float) -> float:
    left_m, bottom_m = occupancy.geometry.origin_m
    step_m = occupancy.geometry.resolution_m
    return float(values[int((y_m - bottom_m) / step_m), int((x_m - left_m) / step_m)])


def test_objects_are_found_and_the_rest_is_free(views: list[EchoCone]) -> None:
    occupancy = fused(views).occupancy_map()
    predicted = occupancy.predicted()
    for x_m, y_m in ((1.525, 0.425), (1.775, -0.325)):
        assert at(occupancy, predicted, x_m, y_m)
    assert np.count_nonzero(predicted) < 20
    assert np.count_nonzero(occupancy.observed & ~predicted) > 200


def test_the_number_of_threads_does_not_matter(
    monkeypatch: pytest.MonkeyPatch, views: list[EchoCone]
) -> None:
    monkeypatch.setattr(ping_groups, "LEAST_PINGS", 2)
    maps = []
    for cores in (1, 2, 4):
        monkeypatch.setattr(threads, "available_cores", lambda cores=cores: cores)
        maps.append(fused(views).occupancy_map())
    for other in maps[1:]:
        assert_same(maps[0], other)


def test_the_order_in_which_pings_come_does_not_matter(views: list[EchoCone]) -> None:
    """Robots' messages overtake each other; stamps say in what order they were heard."""
    shuffled = [views[index] for index in np.random.default_rng(2).permutation(len(views))]
    assert_same(fused(views).occupancy_map(), fused(shuffled).occupancy_map())


def test_how_often_it_was_asked_for_does_not_matter(views: list[EchoCone]) -> None:
    asked, left_alone = fused([]), fused(views)
    for cone in views:
        asked.fuse(cone)
        asked.occupancy_map().log_odds[:] = 0.0
    assert_same(asked.occupancy_map(), left_alone.occupancy_map())


def test_it_is_worked_out_once_for_all_who_ask(
    views: list[EchoCone], monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[int] = []

    class Counted(estimate.JointEstimate):
        def estimate_powers(self, rounds: int) -> None:
            made.append(rounds)
            super().estimate_powers(rounds)

    monkeypatch.setattr("usmap_ros.mapping.joint.explanation.JointEstimate", Counted)
    fusion = fused(views)
    make = fusion.snapshot()
    assert made == []
    askers = [threading.Thread(target=make) for _ in range(3)]
    for asker in askers:
        asker.start()
    for asker in askers:
        asker.join()
    assert made == [estimate.ROUNDS]


def test_a_robot_that_stands_still_changes_nothing(views: list[EchoCone]) -> None:
    """Beyond what its first few pings said."""
    parked = [replace(views[-1], stamp_ns=100 + number) for number in range(30)]
    few = fused([*views, *parked[: MOST_FROM_A_PLACE - 1]])
    many = fused([*views, *parked])
    one, other = few.occupancy_map(), many.occupancy_map()
    assert one.geometry == other.geometry
    np.testing.assert_array_equal(one.predicted(), other.predicted())
    np.testing.assert_allclose(one.log_odds, other.log_odds, atol=0.05)


def test_areas_far_apart_are_maps_of_their_own(views: list[EchoCone]) -> None:
    elsewhere = [moved(cone, FAR_M) for cone in views]
    both = fused([*views, *elsewhere]).occupancy_map()
    left, bottom = both.geometry.first_cell
    known = 0
    for cones in (views, elsewhere):
        alone = fused(cones).occupancy_map()
        (column, row), (height, width) = alone.geometry.first_cell, alone.geometry.shape
        place = np.s_[row - bottom : row - bottom + height, column - left : column - left + width]
        np.testing.assert_array_equal(both.log_odds[place], alone.log_odds)
        np.testing.assert_array_equal(both.observed[place], alone.observed)
        known += np.count_nonzero(alone.observed)
    assert np.count_nonzero(both.observed) == known


def test_nothing_stays_of_what_is_left_out(
    views: list[EchoCone], cone_of_objects: MakeCone
) -> None:
    fusion = fused(views, "good")
    for cone in views:
        pose = cone.pose
        x_m, y_m = (float(value) for value in pose.position_m[:2])
        liar = cone_of_objects((0.9, 0.2, 0.6), x_m=x_m, y_m=y_m, yaw_rad=pose.yaw_rad)
        fusion.fuse(replace(liar, stamp_ns=cone.stamp_ns), "bad")
    assert fusion.leave_out(lambda source: source == "bad") == len(views)
    assert fusion.leave_out(lambda source: source == "bad") == 0
    assert_same(fusion.occupancy_map(), fused(views, "good").occupancy_map())


def test_one_that_is_not_trusted_leaves_nothing_behind(views: list[EchoCone]) -> None:
    fusion, honest = fused(views, "good"), fused(views, "good").occupancy_map()
    for cone in views:
        fusion.fuse(moved(cone, 0.5), "bad")
    assert fusion.trust({"bad": 0.0, "good": 1.0})
    assert not fusion.trust({"bad": 0.0})
    assert_same(replace(fusion.occupancy_map(), stamp_ns=honest.stamp_ns), honest)


def test_one_that_is_trusted_again_is_for_what_it_says_from_then_on(views: list[EchoCone]) -> None:
    fusion = fused(views, "good")
    for cone in views[:4]:
        fusion.fuse(moved(cone, 0.5), "mended")
    fusion.trust({"mended": 0.0})
    for cone in views[4:6]:
        fusion.fuse(moved(cone, 0.5), "mended")
    assert fusion.trust({"mended": 1.0})
    for cone in views[6:]:
        fusion.fuse(cone, "mended")
    expected = fused(views, "good")
    for cone in views[6:]:
        expected.fuse(cone, "mended")
    assert_same(fusion.occupancy_map(), expected.occupancy_map())


def test_one_that_is_trusted_less_counts_less(views: list[EchoCone]) -> None:
    fusion = fused(views, "robot", greatest_log_odds=50.0)
    wholly = fusion.occupancy_map()
    fusion.trust({"robot": 0.3})
    less = fusion.occupancy_map()
    assert at(less, less.log_odds, 1.525, 0.425) < at(wholly, wholly.log_odds, 1.525, 0.425)


def test_what_pings_said_stays_when_they_leave_the_window(views: list[EchoCone]) -> None:
    elsewhere = [replace(moved(cone, FAR_M), stamp_ns=1000 + cone.stamp_ns) for cone in views]
    occupancy = fused([*views, *elsewhere], window=len(views)).occupancy_map()
    predicted = occupancy.predicted()
    is_free = occupancy.observed & ~predicted
    middle = round((0.5 * FAR_M - occupancy.geometry.origin_m[0]) / 0.05)
    for x_m, half in ((1.525, np.s_[:, :middle]), (1.525 + FAR_M, np.s_[:, middle:])):
        assert at(occupancy, predicted, x_m, 0.425)
        assert np.count_nonzero(is_free[half]) > 200


def test_who_fuses_does_not_wait_for_what_leaves_the_window(
    views: list[EchoCone], monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[int] = []
    explained = explanation.explained
    monkeypatch.setattr(survey, "explained", lambda *given: made.append(1) or explained(*given))
    fusion = fused(views[:4], window=4)
    # Each of them lets the oldest go.
    for cone in views[4:8]:
        fusion.fuse(cone)
    assert not made
    with monkeypatch.context() as looks:
        looks.setattr("usmap_ros.mapping.joint.fusion.MOST_WAITING", 1)
        at_once = fused(views[:8], window=4)
    assert made
    assert_same(fusion.occupancy_map(), at_once.occupancy_map())


def test_who_fuses_live_never_waits_for_what_leaves_the_window(
    views: list[EchoCone], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("usmap_ros.mapping.joint.fusion.MOST_WAITING", 1)
    fusion = fused(views[:4], window=4)
    fusion.live_snapshot()()
    made: list[int] = []
    explained = explanation.explained
    monkeypatch.setattr(survey, "explained", lambda *given: made.append(1) or explained(*given))
    more = [replace(cone, stamp_ns=1000 + cone.stamp_ns) for cone in views]
    for cone in (*views[4:], *(moved(cone, 0.3) for cone in more)):
        fusion.fuse(cone)
    assert not made
    assert fusion.thinned > 0
    assert fusion.occupancy_map().observed.any()
    # Who is not asked for maps while pings come has time.
    assert fused([*views, *more], window=4).thinned == 0


def test_nothing_is_kept_of_what_maps_were_made_from(views: list[EchoCone]) -> None:
    def alive() -> dict[type, int]:
        gc.collect()
        kinds = [type(each) for each in gc.get_objects()]
        return {kind: kinds.count(kind) for kind in (Survey, JointEstimate)}

    before = alive()
    # Half of the pings leave the window, one after the other.
    fusion = fused(views, window=len(views) // 2)
    fusion.occupancy_map()
    assert alive() == {Survey: before[Survey] + 2, JointEstimate: before[JointEstimate]}
    assert fusion.memory_bytes > 0


def test_a_map_is_resumed_and_goes_on(views: list[EchoCone]) -> None:
    before = fused(views).occupancy_map()
    resumed = fused([])
    resumed.resume(before)
    assert_same(resumed.occupancy_map(), before)
    for cone in views:
        resumed.fuse(moved(cone, FAR_M))
    occupancy = resumed.occupancy_map()
    for x_m in (1.525, 1.525 + FAR_M):
        assert at(occupancy, occupancy.predicted(), x_m, 0.425)


def test_a_place_far_from_the_origin_is_mapped_as_any_other(
    mirror_pings_at: Callable[..., list[EchoCone]],
) -> None:
    """Robots in a country's grid; searches by distance from the origin took all memory there."""
    here = fused(mirror_pings_at()).occupancy_map()
    assert here.predicted().any()
    fusion = fused(mirror_pings_at(*COUNTRY_M)[:20])
    resumed = fused([])
    resumed.resume(fusion.occupancy_map())
    for cone in mirror_pings_at(*COUNTRY_M)[20:]:
        fusion.fuse(cone)
    there = fusion.occupancy_map()
    np.testing.assert_allclose(
        np.subtract(there.geometry.origin_m, here.geometry.origin_m), COUNTRY_M
    )
    np.testing.assert_array_equal(there.predicted(), here.predicted())
    np.testing.assert_array_equal(there.observed, here.observed)
    assert_same(resumed.occupancy_map(), fused(mirror_pings_at(*COUNTRY_M)[:20]).occupancy_map())


def test_an_earlier_map_is_not_changed(views: list[EchoCone]) -> None:
    before = fused(views).occupancy_map()
    log_odds = before.log_odds.copy()
    resumed = fused([])
    resumed.resume(before)
    before.log_odds[:] = 0.0
    np.testing.assert_array_equal(resumed.occupancy_map().log_odds, log_odds)


def test_a_ping_of_numbers_that_are_not_finite_is_taken_back(views: list[EchoCone]) -> None:
    fusion = fused(views)
    before = fusion.occupancy_map()
    wrong = replace(views[0], amplitudes=np.full_like(views[0].amplitudes, np.inf), stamp_ns=99)
    fusion.fuse(wrong)
    assert fusion.mend(wrong) > 0
    fusion.stamp_ns = before.stamp_ns
    assert_same(fusion.occupancy_map(), before)
    assert fusion.mend(views[-1]) == fusion.mend() == 0


def test_cells_of_an_earlier_map_that_hold_no_numbers_are_unknown_again(
    views: list[EchoCone],
) -> None:
    before = fused(views).occupancy_map()
    before.log_odds[10, 10:12] = np.nan, np.inf
    resumed = fused([])
    resumed.resume(before)
    assert resumed.mend() >= 2
    assert np.isfinite(resumed.occupancy_map().log_odds).all()


def test_nothing_behind_a_wall_is_called_free(cone_of_objects: MakeCone) -> None:
    """Silence from behind it says nothing: no sound gets there."""
    wall = [(0.05 * step, 1.525, 0.5) for step in range(-40, 81)]
    cones = []
    for number in range(24):
        place = {"x_m": 0.1 * number, "y_m": 0.2 * (number % 3), "yaw_rad": 0.5 * np.pi}
        cones.append(cone_of_objects(*wall[::4], stamp_ns=number, **place))
    occupancy = fused(cones).occupancy_map()
    rows, columns = np.nonzero(occupancy.observed & ~occupancy.predicted())
    step_m, (left_m, bottom_m) = occupancy.geometry.resolution_m, occupancy.geometry.origin_m
    x_m, y_m = left_m + (columns + 0.5) * step_m, bottom_m + (rows + 0.5) * step_m
    assert np.count_nonzero(y_m < 1.4) > 300
    assert not np.any((y_m > 1.65) & (x_m > 0.2) & (x_m < 2.1))


def test_a_gap_between_walls_that_is_silent_when_it_is_faced_is_not_filled(
    cone_of_objects: MakeCone,
) -> None:
    """A line goes through both, and over what lies between them."""
    gap_m = 0.85, 1.25
    steps = [0.05 * step + 0.025 for step in range(-30, 70)]
    wall = [(x_m, 1.525, 0.5) for x_m in steps if not gap_m[0] < x_m < gap_m[1]]
    cones = []
    for number in range(40):
        place = {"x_m": 0.06 * number, "y_m": 0.6 * (number % 3)}
        place["yaw_rad"] = (0.3 + 0.1 * (number % 5)) * np.pi
        cones.append(cone_of_objects(*wall[::2], stamp_ns=number, **place))
    occupancy = fused(cones).occupancy_map()
    stands = occupancy.predicted().astype(float)
    assert [at(occupancy, stands, x_m, 1.525) for x_m in (0.4, 0.6, 1.5, 1.7)] == [1.0] * 4
    assert [at(occupancy, stands, x_m, 1.525) for x_m in (1.0, 1.05, 1.1)] == [0.0] * 3


def test_a_wall_that_scatters_little_beside_a_loud_corner_is_mapped(
    cone_of_objects: MakeCone,
) -> None:
    """Smooth walls scatter a ten-thousandth of what their corners return."""
    wall = [(0.05 * step + 0.025, 1.025, 0.008) for step in range(-20, 60)]
    cones = []
    for number in range(40):
        place = {"x_m": 0.05 * number, "y_m": 0.4 * (number % 2), "limit": 0.002}
        place["yaw_rad"] = (0.3 + 0.1 * (number % 5)) * np.pi
        cones.append(cone_of_objects(*wall, (2.025, 1.025, 1.0), stamp_ns=number, **place))
    occupancy = fused(cones).occupancy_map()
    stands = occupancy.predicted().astype(float)
    found = [at(occupancy, stands, x_m, 1.025) for x_m in np.arange(0.325, 1.7, 0.05)]
    assert np.mean(found) > 0.9
