"""A robot whose refined poses went astray: joined by its way as odometry tells it."""

from dataclasses import replace

import numpy as np
import pytest
from pings_among_poles import Ping, circle, cone, heard

from usmap_ros.localisation.planar import between, compose
from usmap_ros.localisation.pose_kind import PoseKind
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import PipelineParameters
from usmap_ros.runs.joining import Joining, join_robots

#: Where frames of odometry are whose robots go round among poles.
STARTS = {"robot1": np.array([1.0, 2.0, 0.5]), "robot2": np.array([-2.0, 1.0, 2.0])}
_COUNT = 200
#: Where poles stand: so many that what is in common is not by chance.
POLES = np.random.default_rng(5).uniform(0.2, 5.8, (60, 2))


def told(robot: str) -> list[Ping]:
    """Pings among poles of a robot in its own frame, as odometry tells them."""
    made = []
    for number, real in enumerate(circle(_COUNT)):
        known = np.diag([1e-6] * 3) + 1e-5 * number * np.diag([1.0, 1.0, 0.3])
        pose = Pose.planar(*map(float, between(STARTS[robot], real)), planar_covariance=known)
        names = {"frame_id": f"{robot}/odom", "child_frame_id": f"{robot}/sonar"}
        ranges_m = heard(Pose.planar(*real), POLES)
        made.append((f"/{robot}/echo", cone(pose, ranges_m, 250_000_000 * number + 1, **names)))
    return made


def astray(pings: list[Ping]) -> list[Ping]:
    """The same, of a way that is bent by half a turn from end to end."""
    poses = np.array([[*one.pose.position_m[:2], one.pose.yaw_rad] for _, one in pings])
    steps, at, bent = between(poses[:-1], poses[1:]), poses[0], [poses[0]]
    for step in steps:
        at = compose(at, step + np.array([0.0, 0.0, np.pi / len(steps)]))
        bent.append(at)
    return [
        (topic, replace(one, pose=Pose.planar(*pose.tolist())))
        for (topic, one), pose in zip(pings, bent, strict=True)
    ]


def joined(*lost: str) -> tuple[Joining, np.ndarray]:
    """Robots of which the refined poses of some went astray; true poses of all."""
    pings = {robot: told(robot) for robot in STARTS}
    refined = [
        ping for robot in STARTS for ping in (astray if robot in lost else list)(pings[robot])
    ]
    kinds = dict.fromkeys(STARTS, PoseKind.ODOMETRY_FROM_ANYWHERE)
    all_told = [ping for robot in STARTS for ping in pings[robot]]
    joining = join_robots(all_told, refined, kinds, PipelineParameters())
    return joining, np.concatenate([circle(_COUNT)] * len(STARTS))


@pytest.mark.parametrize("lost", ["robot1", "robot2"])
def test_a_robot_is_joined_by_its_way_as_told(lost: str) -> None:
    joining, true = joined(lost)
    assert {joining.state(robot) for robot in STARTS} == {"joined"}
    found = np.array([[*one.pose.position_m[:2], 0.0] for _, one in joining.pings])
    origin = compose(STARTS["robot1"], found)[:, :2]
    assert np.hypot(*(origin - true[:, :2]).T).max() < 0.2
