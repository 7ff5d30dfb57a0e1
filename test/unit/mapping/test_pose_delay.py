"""Poses that are told late or early show in how well echoes meet."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from usmap_ros.mapping.common_error import NO_ERROR, CommonError, common_error, without_error
from usmap_ros.mapping.focus import Ping, from_several_places
from usmap_ros.mapping.pose_delay import LEAST_DELAY_S, PoseTracks, pose_delay_s, with_pose
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.cone import EchoCone

Make = Callable[..., EchoCone]
#: Poles, m; pings a second.
POLES_M = [(1.0, 1.2), (3.1, 0.4), (4.2, 2.6), (2.0, 3.9), (0.2, 2.8), (3.0, 2.0)]
RATE_HZ = 10.0


def place_at(time_s: float, robot: int) -> tuple[float, float, float]:
    """Where a robot is: it goes round among the poles, and looks around."""
    angle_rad = 0.4 * time_s + robot
    x_m, y_m = 2.2 + 1.5 * math.cos(angle_rad), 2.0 + 1.2 * math.sin(1.3 * angle_rad)
    return x_m, y_m, 1.1 * time_s


def heard(
    make_cone: Make, late_s: float, noise_m: float = 0.0, robot: int = 1, scale: float = 1.0
) -> list[Ping]:
    """Pings of a robot whose poses are told late."""
    rng, found = np.random.default_rng(robot), list[Ping]()
    for number in range(300):
        x_m, y_m, yaw_rad = place_at(number / RATE_HZ, robot)
        echoes = []
        for point in POLES_M:
            away_m = math.hypot(point[0] - x_m, point[1] - y_m)
            off_rad = math.atan2(point[1] - y_m, point[0] - x_m) - yaw_rad
            if 0.3 < away_m < 2.8 and abs(math.remainder(off_rad, 2.0 * math.pi)) < 0.6:
                echoes.append((away_m / scale + rng.normal(0.0, 0.003), 0.5 / away_m**2))
        x_m, y_m, yaw_rad = place_at(number / RATE_HZ - late_s, robot) + rng.normal(0.0, noise_m, 3)
        stamp_ns, frame = round(1e9 * number / RATE_HZ), f"robot{robot}/sonar"
        cone = make_cone(*sorted(echoes), x_m=x_m, y_m=y_m, yaw_rad=yaw_rad, stamp_ns=stamp_ns)
        found.append((replace(cone, child_frame_id=frame), f"robot{robot}"))
    return found


def delay_of(pings: list[Ping]) -> float:
    return pose_delay_s(from_several_places(pings), PoseTracks(pings))


@pytest.mark.parametrize("late_s", [-0.2, -0.05, 0.05, 0.1, 0.3])
def test_poses_that_are_told_late_or_early_are_found_out(make_cone: Make, late_s: float) -> None:
    assert delay_of(heard(make_cone, late_s)) == pytest.approx(late_s, abs=0.011)


@pytest.mark.parametrize("late_s", [0.0, 0.25 * LEAST_DELAY_S])
@pytest.mark.parametrize("noise_m", [0.0, 0.03])
def test_poses_that_are_hardly_late_or_off_by_chance_stay(
    make_cone: Make, late_s: float, noise_m: float
) -> None:
    """Between poses that are off by chance arcs meet better, as well before as behind."""
    for robot in range(1, 5):
        assert delay_of(heard(make_cone, late_s, noise_m, robot)) == 0.0


def test_all_robots_must_gain(make_cone: Make) -> None:
    late, right = heard(make_cone, 0.2), heard(make_cone, 0.0, robot=2)
    assert delay_of(late + right[:100]) == 0.0
    assert delay_of(late + heard(make_cone, 0.2, robot=2)) == pytest.approx(0.2, abs=0.011)


def test_it_is_the_same_in_any_order(make_cone: Make) -> None:
    pings = heard(make_cone, 0.1) + heard(make_cone, 0.1, robot=2)
    assert delay_of(pings) == delay_of(pings[::-1]) != 0.0


def test_a_pose_is_that_of_some_time_after_the_ping(make_cone: Make) -> None:
    pings = heard(make_cone, 0.1)
    tracks = PoseTracks(pings)
    for number in (20, 299):
        cone, source = pings[number]
        found = tracks.later(cone, source, 0.1)
        assert found[:2] == pytest.approx(place_at(number / RATE_HZ, 1)[:2], abs=0.04)
        moved = with_pose(cone, found).pose
        assert math.remainder(moved.yaw_rad - 1.1 * number / RATE_HZ, 2.0 * math.pi) == (
            pytest.approx(0.0, abs=0.01)
        )


def test_one_that_is_newer_than_all_goes_on_as_it_went(make_cone: Make) -> None:
    pings = heard(make_cone, 0.1)
    cone, source = pings[150]
    found = PoseTracks(pings[:150]).later(cone, source, 0.1)
    assert found[:2] == pytest.approx(place_at(15.0, 1)[:2], abs=0.01)


def test_where_nobody_knows_where_a_robot_was_poses_stay(make_cone: Make) -> None:
    pings = heard(make_cone, 0.1)
    cone, source = pings[100]
    told = [*cone.pose.position_m[:2], cone.pose.yaw_rad]
    alone, with_gap = PoseTracks(pings[:101][-1:]), PoseTracks([pings[100], *pings[120:]])
    for tracks in (PoseTracks([]), alone, with_gap):
        assert tracks.later(cone, source, 0.1) == pytest.approx(told)


def test_a_robot_goes_nowhere_at_once(make_cone: Make) -> None:
    """A pose that is far off must not draw others there, nor a map of all that lies between."""
    pings = heard(make_cone, 0.1)
    cone, source = pings[100]
    pings[100] = replace(cone, pose=Pose.planar(9e4, -9e4, 0.0)), source
    before, told = pings[99][0], pings[99][0].pose.position_m[:2]
    assert PoseTracks(pings).later(before, source, 0.05)[:2] == pytest.approx(told)
    assert delay_of(pings) == pytest.approx(0.1, abs=0.011)


def test_a_pose_that_is_tilted_stays_so(make_cone: Make) -> None:
    cone = make_cone((1.0, 0.5))
    tilted = Pose.turned(np.array([1.0, 2.0, 0.4]), 0.3, 0.2, 0.1)
    cone = replace(cone, pose=tilted)
    moved = with_pose(cone, np.array([3.0, 4.0, 0.9])).pose
    assert moved.position_m == pytest.approx([3.0, 4.0, 0.4])
    expected = Pose.turned(moved.position_m, 0.9, 0.2, 0.1)
    assert moved.rotation == pytest.approx(expected.rotation)


def test_both_errors_at_once_are_found_out(make_cone: Make) -> None:
    pings = heard(make_cone, 0.1, scale=0.97)
    tracks = PoseTracks(pings)
    error = common_error(pings, tracks)
    assert error.poses_late_s == pytest.approx(0.1, abs=0.02)
    assert error.scale == pytest.approx(0.97, abs=0.006)
    assert len(error.reasons) == 2
    moved = without_error(*pings[50], error, tracks)
    assert moved.pose.position_m[:2] == pytest.approx(place_at(5.0, 1)[:2], abs=0.03)


def test_what_is_right_stays(make_cone: Make) -> None:
    pings = heard(make_cone, 0.0)
    tracks = PoseTracks(pings)
    assert common_error(pings, tracks) == NO_ERROR == CommonError()
    assert NO_ERROR.reasons == []
    assert without_error(*pings[0], NO_ERROR, tracks) is pings[0][0]
