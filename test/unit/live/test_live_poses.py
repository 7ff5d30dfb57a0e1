"""Poses that are corrected as pings come: by the same means as offline."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pings_among_poles import Ping, circle, cone, heard, poles

from usmap_ros.grids import OccupancyMap
from usmap_ros.live.anchors import Anchor
from usmap_ros.live.live_fusion import LiveFusion
from usmap_ros.live.located import locate, of_latest_lives
from usmap_ros.localisation.planar import between
from usmap_ros.localisation.pose_kind import PoseKind
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import MappingParameters, PipelineParameters, PoseParameters
from usmap_ros.runs import correction
from usmap_ros.runs.corrected import Corrected, RobotPoses
from usmap_ros.runs.correction import correct_poses
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.runs.poses import PoseRun
from usmap_ros.runs.set_apart import SetApart, pings_of_one_map

START = np.array([1.0, 2.0, 0.5])


def drifting(count: int = 60, growth: float = 1e-4) -> list[Ping]:
    """Pings on a circle whose odometry takes ways to be longer than they are."""
    made = []
    for number, real in enumerate(circle(count)):
        known = np.diag([1e-6, 1e-6, 1e-6]) + growth * number * np.diag([1.0, 1.0, 0.1])
        off_m = 0.002 * number * bool(growth)
        pose = Pose.planar(real[0] + off_m, real[1], real[2], planar_covariance=known)
        one = cone(pose, heard(Pose.planar(*real), poles()), 250_000_000 * number + 1)
        made.append(("/robot1/echo", one))
    return made


def live(pings: list[Ping], window: int = 3000, looks_every: int = 30, **poses: Any) -> LiveFusion:
    """A fusion that all of them went into, with a look at the map now and then."""
    fusion = LiveFusion(MappingParameters(window=window), 0.0, 1000, poses=PoseParameters(**poses))
    for number, (topic, one) in enumerate(pings):
        fusion.receive(topic, one)
        fusion.fuse_next()
        if number % looks_every == looks_every - 1:
            fusion.occupancy_map()
    while fusion.fuse_next() is not None:
        pass
    return fusion


def offline(pings: list[Ping], **poses: Any) -> OccupancyMap:
    parameters = PipelineParameters.model_validate({"poses": poses})
    pipeline = Pipeline(parameters)
    corrected = PoseRun(parameters).corrected(pings)
    for topic, one in pings_of_one_map(corrected, pipeline, SetApart()):
        pipeline.fuse(one, topic)
    return pipeline.occupancy_map()


def same(one: OccupancyMap, other: OccupancyMap) -> None:
    assert (one.frame_id, one.geometry) == (other.frame_id, other.geometry)
    np.testing.assert_array_equal(one.log_odds, other.log_odds)
    np.testing.assert_array_equal(one.observed, other.observed)


def test_the_map_of_a_robot_that_drifts_is_that_of_offline() -> None:
    pings = drifting()
    fusion = live(pings)
    same(fusion.occupancy_map(), offline(pings))
    told = live(pings, use="told").occupancy_map()
    assert not np.array_equal(told.log_odds, fusion.occupancy_map().log_odds)
    assert len(fusion.poses.latest.trajectories()["robot1"]) == len(pings)


def test_poses_that_are_off_by_chance_are_corrected_as_offline() -> None:
    rng, pings = np.random.default_rng(3), []
    for topic, one in drifting(100, 0.0):
        off_m = rng.normal(0.0, 0.03, 2)
        known = np.diag([9e-4, 9e-4, 1e-6])
        place_m = one.pose.position_m[:2] + off_m
        pose = Pose.planar(*place_m, one.pose.yaw_rad, planar_covariance=known)
        pings.append((topic, replace(one, pose=pose)))
    fusion = live(pings)
    same(fusion.occupancy_map(), offline(pings))
    found = fusion.poses.latest.trajectories()["robot1"].positions_m
    told = np.array([one.pose.position_m for _, one in pings])
    real = circle(100)[:, :2]
    off_m, told_off_m = (np.hypot(*(each[:, :2] - real).T).mean() for each in (found, told))
    assert off_m < 0.9 * told_off_m


def test_between_two_corrections_robots_go_on_from_where_they_were_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    counts: list[int] = []

    def counted(pings: Any, *others: Any, **named: Any) -> Corrected:
        counts.append(len(pings))
        return correct_poses(pings, *others, **named)

    monkeypatch.setattr(correction, "correct_poses", counted)
    pings = drifting(60)
    fusion = LiveFusion(MappingParameters(), 0.0, 1000, poses=PoseParameters())
    for number, (topic, one) in enumerate(pings):
        fusion.receive(topic, one)
        fusion.fuse_next()
        if number >= 49 and number % 3 == 0:
            latest = fusion.live_map()
    # The first time, and not again before there are a quarter more.
    assert len(counts) == 1
    assert not fusion.is_whole
    told = live(pings, use="told").occupancy_map()
    whole = fusion.occupancy_map()
    assert fusion.is_whole
    same(whole, offline(pings))
    assert overlap(latest, whole) > overlap(told, whole)


def overlap(one: OccupancyMap, other: OccupancyMap) -> float:
    """Share of occupied cells of either that are so in both, or beside."""
    places = []
    for occupancy in (one, other):
        rows, columns = np.nonzero(occupancy.predicted())
        places.append(np.column_stack([rows, columns]) + occupancy.geometry.first_cell[::-1])
    apart = np.abs(places[0][:, np.newaxis] - places[1]).max(axis=2)
    return float(min(np.mean(apart.min(axis=0) <= 1), np.mean(apart.min(axis=1) <= 1)))


def test_absolute_poses_cost_nothing() -> None:
    fusion = live(drifting(growth=0.0))
    assert fusion.poses.snapshot() is None
    assert fusion.poses.latest.states() == ""
    same(fusion.occupancy_map(), offline(drifting(growth=0.0)))


def in_own_frames(count: int = 18, robots: tuple[int, ...] = (1, 2)) -> list[Ping]:
    """Robots, the frame of whose odometry begins elsewhere; by default too few pings to join."""
    made = []
    for robot in robots:
        for number, (topic, one) in enumerate(drifting(60, 0.0)[:count]):
            # Hardly anything is added on the way, as is right: these poses are exact.
            known = 1e-7 * (1 + number) * np.eye(3)
            told = between(START * robot, np.array([*one.pose.position_m[:2], one.pose.yaw_rad]))
            moved = replace(
                one,
                pose=Pose.planar(*map(float, told), planar_covariance=known),
                frame_id=f"robot{robot}/odom",
                child_frame_id=f"robot{robot}/sonar",
                stamp_ns=one.stamp_ns + robot,
            )
            made.append((topic.replace("1", str(robot)), moved))
    return sorted(made, key=lambda ping: ping[1].stamp_ns)


def test_robots_in_frames_of_their_own_are_kept_until_they_are_joined() -> None:
    pings = in_own_frames()
    apart = live(pings)
    assert apart.occupancy_map().frame_id == "robot1/odom"
    assert apart.poses.latest.states() == "robot1 alone, robot2 alone"
    assert apart.poses.latest.frames == {}
    starts = [f"robot{n} {' '.join(map(str, START * n))}" for n in (1, 2)]
    joined = live(pings, initial_poses=starts)
    same(joined.occupancy_map(), offline(pings, initial_poses=starts))
    located = joined.poses.latest
    assert located.frame_id == "map"
    assert located.states() == "robot1 joined, robot2 joined"
    for robot in (1, 2):
        np.testing.assert_allclose(located.frames[f"robot{robot}/odom"], START * robot, atol=0.1)


def test_a_robot_is_found_in_the_map_that_was_kept() -> None:
    kept = offline(drifting(60, 0.0))
    fusion = LiveFusion(MappingParameters(), 0.0, 1000, poses=PoseParameters())
    fusion.resume(kept)
    for topic, one in in_own_frames(60, (2,)):
        fusion.receive(topic, one)
        fusion.fuse_next()
    while fusion.fuse_next() is not None:
        pass
    assert fusion.occupancy_map().frame_id == "map"
    assert fusion.poses.latest.states() == "robot2 joined"
    np.testing.assert_allclose(fusion.poses.latest.frames["robot2/odom"], START * 2, atol=0.1)


def test_what_old_pings_said_stays_and_robots_go_on_from_there() -> None:
    pings = drifting(100)
    fusion, true = live(pings, window=60), drifting(100, 0.0)
    occupancy, exact = fusion.occupancy_map(), offline(true)
    corrected = fusion.poses.latest.corrected.pings
    # No more than the window and what came between two looks.
    assert 40 <= len(corrected) <= 85
    # As told they would be 0.12 to 0.2 m off by now.
    for (_, one), (_, other) in zip(corrected, true[-len(corrected) :], strict=True):
        assert one.stamp_ns == other.stamp_ns
        assert np.hypot(*(one.pose.position_m - other.pose.position_m)[:2]) < 0.1
    recent = Pipeline()
    for topic, one in corrected:
        recent.fuse(one, topic)
    of_recent = recent.occupancy_map().observed.sum()
    assert of_recent < occupancy.observed.sum() < 1.2 * exact.observed.sum()


@pytest.mark.parametrize("growth", [0.0, 1e-4])
@pytest.mark.parametrize("looks_every", [30, 1000])
def test_pings_do_not_grow_without_end(growth: float, looks_every: int) -> None:
    """Neither where poses are right, nor where nobody looks at a map."""
    pings = drifting(120, growth)
    fusion = live(pings, window=40, looks_every=looks_every)
    assert not fusion.poses.is_full
    newest = live(pings[-50:], looks_every=1000, use="told").occupancy_map()
    # Poses being found anew each time, windows do not see quite the same.
    assert fusion.occupancy_map().observed.sum() > 0.8 * newest.observed.sum()


def with_a_late_robot() -> tuple[list[Ping], list[Ping]]:
    """Pings of a robot that knows where it is, and of one that does not and comes later."""
    steady = drifting(60, 0.0)
    late = [
        (
            "/robot2/echo",
            replace(
                one, stamp_ns=one.stamp_ns + steady[-1][1].stamp_ns, child_frame_id="robot2/sonar"
            ),
        )
        for _, one in drifting(40)
    ]
    return steady, late


def test_a_robot_that_comes_late_and_drifts_is_noticed() -> None:
    steady, late = with_a_late_robot()
    fusion = live(steady)
    assert fusion.poses.snapshot() is None
    before = fusion.occupancy_map()
    fusion = live(steady + late, window=40, looks_every=1000)
    assert fusion.poses.snapshot() is not None
    assert fusion.occupancy_map().observed.sum() > 0.8 * before.observed.sum()


def test_a_robot_that_comes_late_and_drifts_is_corrected_offline() -> None:
    steady, late = with_a_late_robot()
    run = PoseRun(PipelineParameters())
    corrected = list(run.corrected(steady + late))
    assert [one.stamp_ns for _, one in corrected] == [one.stamp_ns for _, one in steady + late]
    for (_, told), (_, found) in zip(steady, corrected, strict=False):
        assert found.pose is told.pose
    assert run.robots["robot2"]["poses"] == "odometry"
    truth = circle(40)
    for (_, told), (_, found), real in list(zip(late, corrected[60:], truth, strict=True))[20:]:
        off_m = np.hypot(*(found.pose.position_m[:2] - real[:2]))
        assert off_m < np.hypot(*(told.pose.position_m[:2] - real[:2]))


def test_who_is_left_out_is_forgotten() -> None:
    fusion = live(drifting())
    assert fusion.occupancy_map().observed.any()
    fusion.leave_out(["/robot1/echo"])
    assert not fusion.occupancy_map().observed.any()


def test_a_reset_forgets_pings() -> None:
    fusion = live(drifting())
    fusion.reset()
    assert not fusion.occupancy_map().observed.any()
    assert fusion.poses.latest.frames == {}


def test_a_ping_goes_on_from_an_anchor_by_what_its_odometry_added() -> None:
    first = Pose.planar(1.0, 0.0, 0.0, planar_covariance=np.diag([0.04, 0.04, 0.0]))
    later = Pose.planar(3.0, 0.0, 0.0, planar_covariance=np.diag([0.05, 0.06, 0.01]))
    found = Pose.planar(5.0, 5.0, np.pi / 2, planar_covariance=np.diag([0.001, 0.002, 0.003]))
    _, moved = Anchor(first, found, "map").moved(("/robot1/echo", cone(later, frame_id="odom")))
    assert moved.frame_id == "map"
    np.testing.assert_allclose(moved.pose.position_m[:2], [5.0, 7.0], atol=1e-9)
    assert moved.pose.yaw_rad == pytest.approx(np.pi / 2)
    # What the way added, turned; the anchor's own; and its heading over 2 m.
    variances = np.diagonal(moved.pose.planar_covariance)
    expected = [0.02 + 0.001 + 4.0 * 0.003, 0.01 + 0.002, 0.01 + 0.003]
    np.testing.assert_allclose(variances, expected, atol=1e-9)


def test_no_way_makes_a_robot_surer_of_where_it_is() -> None:
    """Though variances that are told alone do not grow as headings take places along."""
    known = np.diag([1e-3, 1e-3, 1e-2])
    first, later = (Pose.planar(x_m, 0.0, 0.0, planar_covariance=known) for x_m in (0.0, 3.0))
    found = Pose.planar(0.0, 0.0, 0.0, planar_covariance=1e-3 * known)
    _, moved = Anchor(first, found, "map").moved(("/robot1/echo", cone(later, frame_id="odom")))
    assert np.linalg.eigvalsh(moved.pose.planar_covariance).min() >= 0.0


def carried_off() -> tuple[list[Ping], list[Ping]]:
    """Pings of a robot as told and as found, that is lost from the second one on."""
    own = {"frame_id": "robot1/odom", "child_frame_id": "robot1/sonar"}
    lost = {"frame_id": "robot1/odom#2", "child_frame_id": "robot1#2/sonar"}
    told = [("/robot1/echo", cone(Pose.planar(x_m, 0.0, 0.0), **own)) for x_m in (1.0, 2.0)]
    found = [
        ("/robot1/echo", replace(told[0][1], frame_id="map")),
        ("/robot1/echo", replace(told[1][1], **lost)),
    ]
    return told, found


def test_nobody_says_where_a_robot_is_that_is_lost() -> None:
    told, found = carried_off()
    robots = {
        "robot1": RobotPoses(PoseKind.ODOMETRY_FROM_ANYWHERE, "map", "joined", 0.0, 0.0),
        "robot1#2": RobotPoses(PoseKind.ODOMETRY_FROM_ANYWHERE, "robot1/odom#2", "lost", 0.0, 0.0),
    }
    before = locate(told[:1], Corrected(found[:1], robots), "map")
    assert list(before.frames) == ["robot1/odom"]
    located = locate(told, Corrected(found, robots), "map")
    assert located.frames == {}
    assert located.states() == "robot1 joined, robot1#2 lost"


def test_pings_from_before_a_robot_was_carried_off_need_not_be_kept() -> None:
    assert of_latest_lives(*carried_off()) == [False, True]
    told, _ = carried_off()
    assert of_latest_lives(told, told) == [True, True]
