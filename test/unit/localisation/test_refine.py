"""Poses of robots that drift, corrected by what they hear."""

from dataclasses import replace

import numpy as np
import pytest
from pings_among_poles import Ping, circle, cone, heard, poles

from usmap_ros.localisation import PoseKind, Refinement, refine, refine_poses
from usmap_ros.localisation.found import FoundPoses
from usmap_ros.localisation.noisy_poses import settle
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.trajectory import Trajectory

Drifting = tuple[list[Ping], dict[str, Trajectory]]


def errors_m(pings: list[Ping], true: dict[str, Trajectory]) -> np.ndarray:
    """By how much places are off, (pings, 2)."""
    places = {
        (topic, stamp): place
        for topic, path in true.items()
        for stamp, place in zip(path.stamps_ns.tolist(), path.positions_m, strict=True)
    }
    return np.array(
        [one.pose.position_m[:2] - places[topic, one.stamp_ns][:2] for topic, one in pings]
    )


def rms_m(errors: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))


def test_robots_among_poles_find_back(drifting: Drifting, refined: Refinement) -> None:
    before_m, after_m = (rms_m(errors_m(one, drifting[1])) for one in (drifting[0], refined.pings))
    assert set(refined.kinds.values()) == {PoseKind.ODOMETRY}
    assert before_m > 0.1
    assert after_m < 0.05
    assert 0.5 * before_m < rms_m(np.array([list(refined.corrections_m.values())])) < 3.0 * before_m


def test_a_floor_that_is_heard_everywhere_leads_nobody_astray(drifting: Drifting) -> None:
    rng, pings = np.random.default_rng(7), []
    for topic, one in drifting[0]:
        floor_m = np.arange(0.4, 1.2, 0.04)
        columns = {
            "ranges_m": floor_m,
            "range_stds_m": np.full(len(floor_m), 2e-3),
            "amplitudes": 0.01 * np.sqrt(rng.exponential(size=len(floor_m))),
            "amplitude_stds": np.full(len(floor_m), 2e-3),
        }
        both = {name: np.append(getattr(one, name), own) for name, own in columns.items()}
        order = np.argsort(both["ranges_m"])
        echoes = {name: own[order].astype(np.float32) for name, own in both.items()}
        pings.append((topic, replace(one, **echoes)))
    before_m, after_m = (
        rms_m(errors_m(each, drifting[1])) for each in (pings, refine_poses(pings).pings)
    )
    assert before_m > 0.1
    # 0.027 if the nearest echoes are taken for things.
    assert after_m < 0.015


def test_what_was_found_before_is_not_lost() -> None:
    told, true = [], []
    for number, real in enumerate(circle(60)):
        ranges_m = heard(Pose.planar(*real), poles())
        drift = Pose.planar(0.008 * number, 0.0, 0.005 * number)
        known = 4e-3 * number * np.diag([1.0, 1.0, 0.1]) + 1e-6 * np.eye(3)
        one = cone(Pose.planar(*real), ranges_m, 250_000_000 * number + 1)
        x_m, y_m, _ = drift.compose(one.pose).position_m
        yaw_rad = drift.compose(one.pose).yaw_rad
        pose = Pose.planar(float(x_m), float(y_m), yaw_rad, planar_covariance=known)
        true.append(("/robot1/echo", one))
        told.append(("/robot1/echo", replace(one, pose=pose)))

    def off_m(found: list[Ping]) -> float:
        pairs = zip(found, true, strict=True)
        return rms_m(
            np.array([(a.pose.position_m - b.pose.position_m) for (_, a), (_, b) in pairs])
        )

    # By itself no search finds what so much drift has hidden.
    assert off_m(refine_poses(told).pings) > 0.5
    assert off_m(refine_poses(told, before=true).pings) < 0.2


def test_what_was_found_says_how_well_it_is_known(drifting: Drifting, refined: Refinement) -> None:
    squares = []
    errors = zip(
        refined.pings, refined.covariances, errors_m(refined.pings, drifting[1]), strict=True
    )
    for (_, found), known, off_m in errors:
        found.validate()
        squares.append(off_m @ np.linalg.solve(known[:2, :2] + 1e-6 * np.eye(2), off_m))
    # Of two degrees of freedom; some are surer than they should be.
    assert np.median(squares) < 6.0
    told, last = drifting[0][-1][1].pose, refined.covariances[-1]
    assert np.trace(last[:2, :2]) < np.trace(told.planar_covariance[:2, :2])


def test_maps_are_not_blurred_by_what_all_that_stands_is_off_alike(refined: Refinement) -> None:
    """By where the robot set out it may all be elsewhere: that makes no arcs miss each other."""
    to_landmarks = np.array([one.pose.planar_covariance for _, one in refined.pings])
    variances = [
        np.trace(known[:, :2, :2], axis1=1, axis2=2)
        for known in (to_landmarks, refined.covariances)
    ]
    assert (variances[0] <= variances[1] * (1.0 + 1e-6)).all()
    assert variances[0].mean() < 0.6 * variances[1].mean()
    own = [topic.startswith("/robot1/") for topic, _ in refined.pings]
    assert refined.stds_m["robot1"] == pytest.approx(np.sqrt(np.mean(variances[1][own])))


def test_pings_keep_all_but_their_poses(drifting: Drifting, refined: Refinement) -> None:
    for (topic, told), (again, found) in zip(drifting[0], refined.pings, strict=True):
        assert topic == again
        assert replace(found, pose=told.pose) == replace(told)


def test_the_same_pings_give_the_same_poses(drifting: Drifting) -> None:
    first, again = (refine_poses(drifting[0][:60]).pings for _ in range(2))
    for (_, one), (_, other) in zip(first, again, strict=True):
        np.testing.assert_array_equal(one.pose.position_m, other.pose.position_m)


#: That go round often enough for each pole to be heard well.
PINGS = 200


def noisy(std_m: float, stated_m: float, hears: bool = True) -> list[Ping]:
    """Pings of a robot on its circle, each pose off by itself."""
    rng, pings = np.random.default_rng(1), []
    known = np.diag([stated_m, stated_m, stated_m / 3.0]) ** 2
    for number, real in enumerate(circle(PINGS)):
        told = real + rng.standard_normal(3) * [std_m, std_m, std_m / 3.0]
        pose = Pose.planar(told[0], told[1], told[2], planar_covariance=known)
        ranges_m = heard(Pose.planar(*real), poles()) if hears else ()
        pings.append(("/robot1/echo", cone(pose, ranges_m, number + 1)))
    return pings


def off_circle_m(pings: list[Ping]) -> np.ndarray:
    """By how much they are off, (pings, 2)."""
    return np.array([one.pose.position_m[:2] for _, one in pings]) - circle(len(pings))[:, :2]


def ahead_m(off_m: np.ndarray) -> float:
    """Root mean square of how far they are off the way that they look."""
    heading_rad = circle(len(off_m))[:, 2]
    ahead = off_m[:, 0] * np.cos(heading_rad) + off_m[:, 1] * np.sin(heading_rad)
    return float(np.sqrt(np.mean(ahead**2)))


def test_absolute_poses_that_are_well_known_stay_as_they_are() -> None:
    pings = noisy(0.005, 0.005)
    done = refine_poses(pings)
    assert done.kinds == {"robot1": PoseKind.ABSOLUTE}
    assert all(one is other for one, other in zip(done.pings, pings, strict=True))


def test_absolute_poses_that_are_off_by_chance_are_each_corrected() -> None:
    pings = noisy(0.03, 0.03)
    done = refine_poses(pings)
    assert done.kinds == {"robot1": PoseKind.NOISY}
    before_m, after_m = off_circle_m(pings), off_circle_m(done.pings)
    # Poles ahead tell how far it is to them, and where one is across that way less well.
    assert ahead_m(after_m) < 0.65 * ahead_m(before_m)
    assert rms_m(after_m) < 0.8 * rms_m(before_m)
    squares = [
        off_m @ np.linalg.solve(one.pose.planar_covariance[:2, :2], off_m)
        for off_m, (_, one) in zip(after_m, done.pings, strict=True)
    ]
    assert np.mean(squares) < 4.0
    assert 0.02 < done.corrections_m["robot1"] < 0.06


def test_many_pings_are_corrected_some_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(refine, "_MOST_TOGETHER", 120)
    counts: list[int] = []

    def counted(cones: list[EchoCone], *poses: np.ndarray) -> FoundPoses | None:
        counts.append(len(cones))
        return settle(cones, *poses)

    monkeypatch.setattr(refine, "settle", counted)
    pings = noisy(0.03, 0.03)
    done = refine_poses(pings)
    assert counts == [100, 100]
    assert ahead_m(off_circle_m(done.pings)) < 0.8 * ahead_m(off_circle_m(pings))


def test_poses_that_are_better_than_stated_are_hardly_moved() -> None:
    pings = noisy(0.0, 0.03)
    done = refine_poses(pings)
    assert done.kinds == {"robot1": PoseKind.NOISY}
    assert rms_m(off_circle_m(done.pings)) < 0.006


def test_where_nothing_is_heard_noisy_poses_are_corrected_by_how_a_robot_moves() -> None:
    pings = noisy(0.03, 0.03, hears=False)
    done = refine_poses(pings)
    assert rms_m(off_circle_m(done.pings)) < 0.4 * rms_m(off_circle_m(pings))
    assert done.stds_m["robot1"] < 0.4 * 0.03 * np.sqrt(2.0)


def test_robots_that_are_well_known_keep_their_poses_beside_one_that_is_not() -> None:
    others = [
        ("/robot2/echo", replace(one, child_frame_id="robot2/sonar")) for _, one in noisy(0.0, 0.0)
    ]
    pings = noisy(0.03, 0.03) + others
    done = refine_poses(pings)
    assert done.kinds == {"robot1": PoseKind.NOISY, "robot2": PoseKind.ABSOLUTE}
    assert all(one is other for one, other in zip(done.pings[PINGS:], others, strict=True))
    after_m, before_m = (ahead_m(off_circle_m(each[:PINGS])) for each in (done.pings, pings))
    assert after_m < 0.6 * before_m


def test_where_nothing_is_heard_odometry_stands(drifting: Drifting) -> None:
    nothing = np.zeros(0, np.float32)
    silent = [
        (
            topic,
            replace(
                one,
                ranges_m=nothing,
                range_stds_m=nothing,
                amplitudes=nothing,
                amplitude_stds=nothing,
            ),
        )
        for topic, one in drifting[0]
    ]
    done = refine_poses(silent)
    assert all(one is other for one, other in zip(done.pings, silent, strict=True))
    assert set(done.corrections_m.values()) == {0.0}


def test_robots_with_absolute_poses_keep_theirs_beside_one_that_drifts(drifting: Drifting) -> None:
    pings = [
        (topic, one if "robot1" in topic else replace(one, pose=_exact(one.pose)))
        for topic, one in drifting[0][:90]
    ]
    done = refine_poses(pings)
    assert done.kinds["robot2"] is PoseKind.ABSOLUTE
    for (topic, told), (_, found) in zip(pings, done.pings, strict=True):
        assert "robot1" in topic or found is told


def _exact(pose: Pose) -> Pose:
    return Pose(pose.position_m, pose.orientation)


def test_few_pings_say_nothing(drifting: Drifting) -> None:
    assert refine_poses([]).pings == []
    for count in (1, 2, 5):
        assert len(refine_poses(drifting[0][:count]).pings) == count


def test_robots_in_frames_of_their_own_do_not_meet(drifting: Drifting) -> None:
    one_robot = [one for topic, one in drifting[0][:90] if "robot1" in topic]
    pings = [
        (
            f"/robot{robot}/echo",
            replace(one, frame_id=f"robot{robot}/odom", child_frame_id=f"robot{robot}/sonar"),
        )
        for robot in (1, 2)
        for one in one_robot
    ]
    done = refine_poses(pings)
    assert set(done.kinds.values()) == {PoseKind.ODOMETRY_FROM_ANYWHERE}
    assert [one.frame_id for _, one in done.pings] == [one.frame_id for _, one in pings]
    first, second = done.pings[: len(one_robot)], done.pings[len(one_robot) :]
    for (_, one), (_, other) in zip(first, second, strict=True):
        np.testing.assert_allclose(one.pose.position_m, other.pose.position_m, atol=1e-9)


def test_a_user_may_insist_that_poses_drift(drifting: Drifting) -> None:
    steady = [(topic, replace(one, pose=_exact(one.pose))) for topic, one in drifting[0][:60]]
    assert set(refine_poses(steady).kinds.values()) == {PoseKind.ABSOLUTE}
    assert set(refine_poses(steady, insists=True).kinds.values()) == {PoseKind.INSISTED}
