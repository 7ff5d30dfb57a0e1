"""Which poses a recording is mapped with."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from pings_among_poles import Ping, circle, cone, heard, poles

from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import PipelineParameters
from usmap_ros.runs.poses import PoseRun


def choosing(use: str) -> PipelineParameters:
    return PipelineParameters.model_validate({"poses": {"use": use}})


def pings(growth: float = 0.0) -> list[Ping]:
    made = []
    for number, real in enumerate(circle(60)):
        known = np.diag([9e-5, 9e-5, 1e-5]) + growth * number * np.eye(3)
        pose = Pose.planar(real[0], real[1], real[2], planar_covariance=known)
        made.append(("/robot1/echo", cone(pose, heard(pose, poles()), number + 1)))
    return made


def test_absolute_poses_are_not_held_back() -> None:
    taken = 0

    def counted() -> Iterator[Ping]:
        nonlocal taken
        for ping in pings():
            taken += 1
            yield ping

    run = PoseRun()
    stream = run.corrected(counted())
    next(stream)
    # As many as it takes to go a metre.
    assert taken < 40
    assert len(list(stream)) == 59
    assert run.summary() == {"used": "told", "robots": {}}


def test_absolute_poses_that_are_off_by_chance_are_corrected() -> None:
    run, told = PoseRun(), []
    for topic, one in pings():
        pose = replace(one.pose, covariance=10.0 * one.pose.covariance)
        told.append((topic, replace(one, pose=pose)))
    assert len(list(run.corrected(told))) == 60
    assert run.summary()["used"] == "refined"
    assert run.summary()["robots"]["robot1"]["poses"] == "absolute, off by chance"


def test_odometry_is_refined_and_what_was_told_is_kept() -> None:
    run = PoseRun()
    assert len(list(run.corrected(pings(1e-4)))) == 60
    assert run.summary()["used"] == "refined"
    assert run.summary()["robots"]["robot1"]["poses"] == "odometry"
    told = run.told.trajectories()["/robot1/echo"]
    np.testing.assert_allclose(told.positions_m[:, :2], circle(60)[:, :2], atol=1e-9)


def test_told_poses_are_used_where_a_user_wants_them() -> None:
    run, told = PoseRun(choosing("told")), pings(1e-4)
    assert all(one is other for one, other in zip(run.corrected(told), told, strict=True))


def test_a_user_may_insist_that_absolute_poses_are_refined() -> None:
    run = PoseRun(choosing("refined"))
    list(run.corrected(pings()))
    assert run.summary()["robots"]["robot1"]["poses"] == "odometry, as insisted on"


def test_a_robot_that_parks_at_first_is_waited_for() -> None:
    parked = [(topic, replace(one, pose=pings()[0][1].pose)) for topic, one in pings()[:20]]
    run = PoseRun()
    assert len(list(run.corrected([*parked, *pings(1e-4)]))) == 80
    assert run.summary()["used"] == "refined"


def test_from_one_sensor_of_a_robot_to_its_next_one_is_no_way() -> None:
    two = []
    for topic, one in pings(2e-5):
        left = one.pose.compose(Pose.planar(0.0, 1.2, 0.0))
        beside = replace(left, covariance=one.pose.covariance)
        two += [(topic, one), (topic, replace(one, pose=beside, child_frame_id="robot1/left"))]
    run = PoseRun()
    assert len(list(run.corrected(two))) == 120
    assert run.summary()["used"] == "refined"


def test_no_pings_are_no_error() -> None:
    for choice in ("auto", "told", "refined"):
        assert list(PoseRun(choosing(choice)).corrected([])) == []
