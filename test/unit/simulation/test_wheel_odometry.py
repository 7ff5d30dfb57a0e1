"""Poses as wheels give them: they drift, and say truly how far."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from usmap_ros.errors import ConfigurationError
from usmap_ros.numerics.geometry import Pose, on_base
from usmap_ros.simulation import Scenario, simulate
from usmap_ros.simulation.wheel_odometry import OdometryErrors, WheelOdometry

SEED = np.random.SeedSequence(3)
ERRORS = OdometryErrors(turn_rad_per_sqrt_rad=0.02, gyro_bias_std_rad_s=0.002)
EXACT = OdometryErrors(slip_m_per_sqrt_m=0.0, heading_rad_per_sqrt_m=0.0, wheel_radius_std=0.0)
START = Pose.planar(1.0, 2.0, 0.3)


class Circle:
    """A robot that drives round and round."""

    def pose(self, time_s: float) -> Pose:
        angle = 0.25 * time_s
        return Pose.planar(np.cos(angle), np.sin(angle), angle + np.pi / 2.0)


def planar(pose: Pose) -> np.ndarray:
    return np.array([*pose.position_m[:2], pose.yaw_rad])


def content(**robot: Any) -> dict[str, Any]:
    own = {"name": "robot1", "ping_rate_hz": 10.0, "odometry": {}} | robot
    return {
        "duration_s": 6.0,
        "world": {"area_m": [0.0, 6.0, 0.0, 6.0], "points": [{"x_m": 3.0, "y_m": 2.0}]},
        "robots": [own],
    }


def test_without_errors_it_is_the_way_that_was_driven() -> None:
    motion = Circle()
    wheels = WheelOdometry(motion, EXACT, SEED, motion.pose(0.0))
    for time_s in (0.0, 0.013, 1.0, 7.77, 30.0):
        told = wheels.at(time_s)
        np.testing.assert_allclose(planar(told), planar(motion.pose(time_s)), atol=1e-6)
        assert not told.covariance.any()


def test_the_covariance_is_that_of_the_errors() -> None:
    motion, squares = Circle(), []
    for seed in range(200):
        wheels = WheelOdometry(motion, ERRORS, np.random.SeedSequence(seed), motion.pose(0.0))
        told, true = wheels.at(4.0), motion.pose(4.0)
        error = planar(told) - planar(true)
        error[2] = (error[2] + np.pi) % (2.0 * np.pi) - np.pi
        squares.append(error @ np.linalg.solve(told.planar_covariance, error))
    # Of three degrees of freedom.
    assert np.mean(squares) == pytest.approx(3.0, rel=0.2)


def test_it_does_not_matter_when_it_is_asked() -> None:
    often, seldom = (WheelOdometry(Circle(), ERRORS, SEED, START) for _ in range(2))
    for time_s in np.arange(0.0, 5.0, 0.013):
        often.at(time_s)
    np.testing.assert_allclose(planar(often.at(5.0)), planar(seldom.at(5.0)), atol=1e-12)


def test_wheels_do_not_know_of_being_carried() -> None:
    class Carried(Circle):
        def pose(self, time_s: float) -> Pose:
            there = Pose.planar(5.0, -3.0, 1.0) if time_s >= 2.0 else Pose.planar(0.0, 0.0, 0.0)
            return there.compose(super().pose(time_s))

    wheels = WheelOdometry(Carried(), EXACT, SEED, Circle().pose(0.0), jumps_s=(2.0,))
    for time_s in (1.99, 2.5, 6.0):
        # Short of the step in which it is taken away.
        assert np.abs(planar(wheels.at(time_s)) - planar(Circle().pose(time_s))).max() < 0.02


def test_what_sits_beside_the_centre_is_off_by_the_heading_as_well() -> None:
    base = Pose.planar(0.0, 0.0, 0.0, planar_covariance=np.diag([0.0, 0.0, 0.04]))
    mounted = on_base(base, Pose.planar(2.0, 0.0, np.pi / 2.0))
    variance = np.diagonal(mounted.planar_covariance)
    np.testing.assert_allclose(variance, [0.0, 0.16, 0.04])


def test_traces_tell_it_with_a_covariance_that_grows() -> None:
    traces = [trace for _, trace in simulate(Scenario.from_mapping(content(), "test"))]
    traces[-1].validate()
    assert {trace.frame_id for trace in traces} == {"map"}
    spread = [np.trace(trace.pose.planar_covariance[:2, :2]) for trace in traces]
    assert spread[0] == 0.0
    assert spread[-1] > 1e-4
    yaw_variances = [trace.pose.planar_covariance[2, 2] for trace in traces]
    assert all(later > earlier for earlier, later in pairwise(yaw_variances))


def test_transducers_of_a_robot_share_it() -> None:
    mounts = [{"name": name, "mount": {"x_m": x}} for name, x in (("a", 0.1), ("b", -0.1))]
    scenario = Scenario.from_mapping(content(transducers=mounts), "test")
    motion = scenario.fleet(scenario.scene())[0].motion
    poses: dict[str, list[np.ndarray]] = {"/robot1/a/echo": [], "/robot1/b/echo": []}
    for index, (topic, trace) in enumerate(simulate(scenario)):
        true = motion.pose(index * 0.05)
        poses[topic].append(planar(trace.pose)[2] - true.yaw_rad)
    first, second = (np.unwrap(errors) for errors in poses.values())
    # Half an interval apart, they are off by nearly the same.
    assert np.abs(first[-1] - second[-1]) < 0.05
    assert np.abs(first[-1]) > 0.0


def test_a_robot_that_does_not_know_its_start_has_a_frame_of_its_own() -> None:
    scenario = Scenario.from_mapping(content(odometry={"start": "unknown"}), "test")
    _, first = next(simulate(scenario))
    assert first.frame_id == "robot1/odom"
    np.testing.assert_allclose(planar(first.pose), 0.0, atol=1e-12)


def test_a_robot_goes_on_where_it_is_carried_to() -> None:
    moved = content(carried_off=[{"at_s": 3.0, "to": [5.0, 5.0, 0.0]}])
    scenario = Scenario.from_mapping(moved, "test")
    (robot,) = scenario.fleet(scenario.scene())
    np.testing.assert_allclose(planar(robot.motion.pose(3.0)), [5.0, 5.0, 0.0])
    told = [trace.pose.position_m for _, trace in simulate(scenario)]
    assert max(np.linalg.norm(later - earlier) for earlier, later in pairwise(told)) < 0.3


@pytest.mark.parametrize(
    ("robot", "cause"),
    [
        ({"pose_error": {"position_std_m": 0.1}}, "pose_error"),
        ({"carried_off": [{"at_s": 2.0, "to": [1, 1, 0]}] * 2}, "does not ascend"),
        (
            {
                "motion": {"kind": "waypoints", "waypoints_m": [[1, 1]]},
                "carried_off": [{"at_s": 2.0, "to": [1, 1, 0]}],
            },
            "random_walk",
        ),
        ({"odometry": {"slip": 1}}, "slip"),
    ],
)
def test_what_contradicts_itself_is_refused(robot: dict[str, Any], cause: str) -> None:
    with pytest.raises(ConfigurationError, match=cause):
        Scenario.from_mapping(content(**robot), "test")
