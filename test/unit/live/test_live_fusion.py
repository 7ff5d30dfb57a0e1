"""Cones as they come, in the order of their stamps, with a clock that the tests set."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.errors import MalformedMessageError
from usmap_ros.live.live_fusion import LiveFusion
from usmap_ros.mapping.common_frame import ENOUGH_PINGS
from usmap_ros.mapping.far_off import FarOffError
from usmap_ros.mapping.joint.fusion import JointFusion
from usmap_ros.mapping.robot_check.consistency import Consistency
from usmap_ros.mapping.robot_check.finding import Finding
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.simulation import Scenario, simulate

WAIT_S = 0.5


@pytest.fixture(scope="module")
def cones(request: pytest.FixtureRequest) -> list[EchoCone]:
    """Give four cones of three robots, in the order of their stamps."""
    scenario = Scenario.load(request.config.rootpath / "config/scenarios/poles.yaml")
    pipeline = Pipeline()
    pings = simulate(scenario)
    return [pipeline.reconstruct(next(pings)[1]) for _ in range(4)]


@pytest.fixture
def fusion(clock: Any) -> LiveFusion:
    """Give a fusion that knows of two robots."""
    made = LiveFusion(MappingParameters(resolution_m=0.2), WAIT_S, capacity=3, clock=clock)
    made.queue.set_sources({"a": True, "b": True})
    return made


def test_it_is_behind_while_a_cone_waits_whose_turn_has_come(
    fusion: LiveFusion, cones: list[EchoCone]
) -> None:
    assert not fusion.is_behind
    fusion.receive("a", cones[0])
    assert not fusion.is_behind
    fusion.receive("b", replace(cones[1], stamp_ns=cones[0].stamp_ns))
    assert fusion.is_behind
    fusion.fuse_next()
    fusion.fuse_next()
    assert not fusion.is_behind


def test_a_shorter_wait_holds_at_once(fusion: LiveFusion, cones: list[EchoCone]) -> None:
    fusion.receive("a", cones[0])
    fusion.queue.set_limits(0.0, 3)
    assert fusion.fuse_next() is not None


def test_frame_and_stamp_are_those_of_the_cones(fusion: LiveFusion, cones: list[EchoCone]) -> None:
    fusion.queue.set_limits(0.0, 3)
    assert fusion.frame_id == ""
    fusion.receive("a", cones[1])
    assert fusion.frame_id == "map"
    fusion.fuse_next()
    fusion.receive("b", cones[0])
    fusion.fuse_next()
    occupancy = fusion.occupancy_map()
    assert (occupancy.frame_id, occupancy.stamp_ns) == ("map", cones[1].stamp_ns)
    fusion.reset()
    occupancy = fusion.occupancy_map()
    assert not occupancy.observed.any()
    assert (occupancy.frame_id, occupancy.stamp_ns) == ("map", cones[1].stamp_ns)


def test_a_map_is_resumed_in_its_frame_only(clock: Any, cones: list[EchoCone]) -> None:
    parameters = MappingParameters(resolution_m=0.2)
    first = LiveFusion(parameters, 0.0, 3, clock=clock)
    first.receive("a", cones[0])
    first.fuse_next()
    kept = first.occupancy_map()
    second = LiveFusion(parameters, 0.0, 3, clock=clock)
    second.resume(kept)
    np.testing.assert_array_equal(second.occupancy_map().observed, kept.observed)
    assert second.frame_id == "map"
    assert second.occupancy_map().stamp_ns == kept.stamp_ns
    other = LiveFusion(parameters, 0.0, 3, "odom", clock)
    with pytest.raises(ValueError, match="its frame is 'map' and not 'odom'"):
        other.resume(kept)


def test_a_cone_that_would_make_the_map_too_large_is_refused_and_the_map_stays(
    cones: list[EchoCone], clock: Any
) -> None:
    # 250 m by 250 m of cells of 0.2 m.
    parameters = MappingParameters(resolution_m=0.2, most_cells=1_562_500)
    fusion = LiveFusion(parameters, 0.0, capacity=10, clock=clock)

    def moved(cone: EchoCone, distance_m: float) -> EchoCone:
        away = np.array([distance_m, distance_m, 0.0])
        return replace(cone, pose=replace(cone.pose, position_m=cone.pose.position_m + away))

    fusion.receive("a", cones[0])
    assert fusion.fuse_next() is not None
    # One who drives there, farther than there is room for.
    for number, way_m in enumerate(range(40, 250, 40)):
        cone = replace(cones[1], stamp_ns=cones[1].stamp_ns + number)
        fusion.receive("b", moved(cone, float(way_m)))
    for _ in range(5):
        assert fusion.fuse_next() is not None
    with pytest.raises(FarOffError, match=r"mapping.most_cells\): map robots .* apart"):
        fusion.fuse_next()
    west, east, _, _ = fusion.occupancy_map().geometry.extent_m
    assert 190.0 < east - west < 250.0


def test_no_map_is_longer_than_nav2_takes(cones: list[EchoCone], clock: Any) -> None:
    parameters = MappingParameters(resolution_m=0.2, most_cells=10**9)
    fusion = LiveFusion(parameters, 0.0, capacity=3, clock=clock)
    way = np.arange(0.0, 6600.0, 40.0)

    def drive() -> None:
        for number, x_m in enumerate(way):
            there = replace(cones[1].pose, position_m=np.array([x_m, 0.0, 0.0]))
            fusion.receive("a", replace(cones[1], stamp_ns=number, pose=there))
            assert fusion.fuse_next() is not None

    with pytest.raises(FarOffError, match="32767 cells, which nav2 does not take"):
        drive()


def test_nothing_is_left_of_a_robot_that_is_left_out_but_what_the_others_said(
    cones: list[EchoCone], clock: Any
) -> None:
    """Neither its pings that still wait, nor what they made of the others."""
    fusion, honest = (LiveFusion(MappingParameters(), 0.0, 99, clock=clock) for _ in range(2))
    fusion.queue.set_sources({"/a/cone": True, "/c/cone": True})
    for number, cone in enumerate(cones):
        honest.receive("/a/cone", cone)
        fusion.receive("/a/cone", cone)
        fusion.receive("/c/cone", replace(later(cone, number, 0.3), stamp_ns=cone.stamp_ns + 1))
    while honest.fuse_next() is not None:
        pass
    for _ in range(3):
        assert fusion.fuse_next() is not None
    assert fusion.live_map().observed.any()

    fusion.leave_out(["c"])
    clock.pass_time(60.0)
    while fusion.due_in_s() == 0.0:
        fusion.fuse_next()

    for one, other in (
        (fusion.occupancy_map(), honest.occupancy_map()), (fusion.live_map(), honest.live_map())
    ):  # fmt: skip
        assert one.geometry == other.geometry
        np.testing.assert_array_equal(one.log_odds, other.log_odds)
    assert len(fusion.findings(lambda: None)) == 1


def test_robots_that_are_doubted_are_told(
    fusion: LiveFusion, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert fusion.doubted == ""
    monkeypatch.setattr(JointFusion, "doubted", {"/robot2/cone": 0.0, "/robot3/cone": 0.25})
    assert fusion.doubted == "/robot2/cone 0%, /robot3/cone 25%"


def test_what_was_found_beside_a_robot_that_is_left_out_is_not_obeyed(
    cones: list[EchoCone], clock: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    fusion = LiveFusion(MappingParameters(resolution_m=0.2), 0.0, 99, clock=clock)
    for number in range(30):
        pose = replace(cones[0].pose, position_m=np.array([0.1 * number, 0.0, 0.0]))
        for which, topic in enumerate(("/a/cone", "/b/cone", "/stuck/cone")):
            heard = cones[0].ranges_m + np.float32(1e-3 * number * (which < 2))
            stamp_ns = cones[0].stamp_ns + 3 * number + which
            cone = replace(cones[0], stamp_ns=stamp_ns, pose=pose, ranges_m=heard)
            fusion.receive(topic, cone)
            assert fusion.fuse_next() is not None

    def findings(consistency: Consistency) -> dict[str, Finding]:
        fusion.leave_out(["c"])
        return judge(consistency)

    version, judge = fusion.version, Consistency.findings
    with monkeypatch.context() as meanwhile:
        meanwhile.setattr(Consistency, "findings", findings)
        found = fusion.findings()
    assert found["/stuck/cone"].verdict == "stuck"
    assert fusion.version == version
    fusion.findings()
    assert fusion.version == version + 1
    # It is believed again until the next check, now that they are gone beside whom it was judged.
    fusion.leave_out(["a", "b"])
    assert fusion.occupancy_map().observed.any()


def later(cone: EchoCone, number: int, x_m: float = 0.0, frame_id: str = "map") -> EchoCone:
    """One of cones that come five times a second."""
    pose = replace(cone.pose, position_m=cone.pose.position_m + np.array([x_m, 0.0, 0.0]))
    stamp_ns = cone.stamp_ns + number * 200_000_000
    return replace(cone, stamp_ns=stamp_ns, pose=pose, frame_id=frame_id)


def test_one_odd_frame_before_all_others_locks_nobody_out(
    cones: list[EchoCone], clock: Any
) -> None:
    told: list[tuple[int, str]] = []
    parameters = MappingParameters(resolution_m=0.2)
    fusion = LiveFusion(parameters, 0.0, 100, clock=clock, on_set_apart=lambda *of: told.append(of))
    fusion.receive("odd", later(cones[0], 0, frame_id="x"))
    assert fusion.fuse_next() is not None
    assert (fusion.frame_id, fusion.is_frame_decided) == ("x", False)
    assert fusion.occupancy_map().frame_id == "x"
    for number in range(1, ENOUGH_PINGS):
        fusion.receive("a", later(cones[0], number))
    assert (fusion.frame_id, fusion.is_frame_decided) == ("map", True)
    assert told == [(1, "1 pings are not in the frame of most robots, 'map'; the map begins anew")]
    fused = sum(1 for _ in iter(fusion.fuse_next, None))
    assert fused == ENOUGH_PINGS - 1
    occupancy = fusion.occupancy_map()
    assert (occupancy.frame_id, fusion.generation) == ("map", 1)
    with pytest.raises(MalformedMessageError, match="frame_id: is 'x', the map's is 'map'"):
        fusion.receive("odd", later(cones[0], 100, frame_id="x"))
    alone = LiveFusion(parameters, 0.0, 100, clock=clock)
    for number in range(1, ENOUGH_PINGS):
        alone.receive("a", later(cones[0], number))
        alone.fuse_next()
    np.testing.assert_array_equal(occupancy.log_odds, alone.occupancy_map().log_odds)


def test_one_far_pose_before_all_others_locks_nobody_out(cones: list[EchoCone], clock: Any) -> None:
    told: list[int] = []
    parameters = MappingParameters(resolution_m=0.2)
    fusion = LiveFusion(
        parameters, 0.0, 100, clock=clock, on_set_apart=lambda count, _: told.append(count)
    )
    fusion.receive("a", later(cones[0], 0, 800.0))
    assert fusion.fuse_next() is not None
    fused = 0
    for number in range(1, ENOUGH_PINGS + 10):
        fusion.receive("a", later(cones[0], number))
        while fusion.due_in_s() is not None:
            try:
                fused += fusion.fuse_next() is not None
            except FarOffError:
                continue
    assert fused == ENOUGH_PINGS + 9
    assert told == [1]
    west, east, _, _ = fusion.occupancy_map().geometry.extent_m
    assert east - west < 20.0
    fusion.receive("b", later(cones[0], 100, 800.0))
    with pytest.raises(FarOffError, match="is 795 m away"):
        fusion.fuse_next()


def test_a_map_that_was_resumed_is_where_its_cells_are(cones: list[EchoCone], clock: Any) -> None:
    parameters = MappingParameters(resolution_m=0.2)
    first = LiveFusion(parameters, 0.0, 3, clock=clock)
    first.receive("a", cones[0])
    first.fuse_next()
    second = LiveFusion(parameters, 0.0, 3, clock=clock)
    second.resume(first.occupancy_map())
    second.receive("a", later(cones[0], 1, 800.0))
    with pytest.raises(FarOffError):
        second.fuse_next()
    second.receive("a", later(cones[0], 2))
    assert second.fuse_next() is not None


def test_who_takes_most_of_the_time_waits_while_others_do(
    cones: list[EchoCone], clock: Any
) -> None:
    """A circle of 34 m costs as much as a hundred beams of 5 m."""
    far = cones[1].transducer
    far = replace(far, max_range_m=34.0, beam=BeamPattern.linear(np.pi))
    fusion = LiveFusion(MappingParameters(resolution_m=0.2), 0.0, 1000, clock=clock)
    for number in range(20):
        fusion.receive("a", later(cones[0], number))
        fusion.receive("greedy", replace(later(cones[1], number), transducer=far))
    # As long as nobody waits for long, all come in the order of their stamps.
    first = [fused.topic for _ in range(4) if (fused := fusion.fuse_next())]
    assert first == ["a", "greedy"] * 2
    clock.pass_time(3.0)
    then = [fused.topic for fused in iter(fusion.fuse_next, None)]
    assert then == ["a"] * 18 + ["greedy"] * 18
