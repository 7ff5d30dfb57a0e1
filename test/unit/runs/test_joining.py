"""Robots in frames of their own: joined where their maps tell how these relate."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pings_among_poles import Ping, circle, cone, heard, poles

from usmap_ros.grids import OccupancyMap
from usmap_ros.localisation import Match, Refinement, refine_poses
from usmap_ros.localisation.planar import between, compose
from usmap_ros.localisation.pose_kind import PoseKind
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import PipelineParameters
from usmap_ros.runs.corrected import Corrected
from usmap_ros.runs.correction import correct_poses
from usmap_ros.runs.moved_pings import moved
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.runs.poses import PoseRun
from usmap_ros.simulation import Scenario, simulate, true_paths

#: Where frames of odometry are whose robots go round among poles.
STARTS = {"robot1": np.array([1.0, 2.0, 0.5]), "robot2": np.array([-2.0, 1.0, 2.0])}
#: A room with a corner cut out, poles in it, and two robots.
ROOM = {
    "seed": 1,
    "duration_s": 20.0,
    "world": {
        "surface": {
            "specular_reflectivity": 0.1,
            "diffuse_reflectivity": 5.0,
            "scatterers_per_m": 20.0,
        },
        "walls": [
            {
                "corners_m": [[0, 0], [4.5, 0], [4.5, 2.2], [3.2, 2.2], [3.2, 3.6], [0, 3.6]],
                "closed": True,
            }
        ],
        "points": [
            {"x_m": x_m, "y_m": y_m, "reflectivity": 1.0}
            for x_m, y_m in ((1.0, 1.2), (2.1, 2.5), (3.4, 0.8))
        ],
    },
    "robots": [
        {
            "name": name,
            "motion": {"kind": "random_walk", "speed_m_s": 0.7, "start": start},
            "odometry": {"start": "unknown"},
        }
        for name, start in (("robot1", [0.5, 0.5, 0.5]), ("robot2", [2.6, 1.5, 2.5]))
    ],
}


def going_round(robot: str) -> list[Ping]:
    """Pings among poles of a robot in its own frame, whose odometry is exact."""
    made = []
    for number, real in enumerate(circle(20)):
        told = between(STARTS[robot], real)
        pose = Pose.planar(float(told[0]), float(told[1]), float(told[2]))
        names = {"frame_id": f"{robot}/odom", "child_frame_id": f"{robot}/sonar"}
        ranges_m = heard(Pose.planar(*real), poles())
        made.append((f"/{robot}/echo", cone(pose, ranges_m, number + 1, **names)))
    return made


def places(pings: list[Ping]) -> np.ndarray:
    """x, y and yaw, (n, 3)."""
    return np.array([[*one.pose.position_m[:2], one.pose.yaw_rad] for _, one in pings])


@pytest.fixture(scope="module")
def in_a_room() -> tuple[list[Ping], np.ndarray]:
    """Give pings of both robots, and their true poses."""
    scenario, pipeline = Scenario.from_mapping(ROOM, "a room"), Pipeline()
    pings = [(topic, pipeline.reconstruct(trace)) for topic, trace in simulate(scenario)]
    true = {
        (topic, stamp): Pose(position_m, orientation)
        for topic, path in true_paths(scenario).items()
        for stamp, position_m, orientation in zip(
            path.stamps_ns.tolist(), path.positions_m, path.orientations, strict=True
        )
    }
    real = [true[topic, one.stamp_ns] for topic, one in pings]
    return pings, np.array([[*pose.position_m[:2], pose.yaw_rad] for pose in real])


@pytest.fixture(scope="module")
def joined(in_a_room: tuple[list[Ping], np.ndarray]) -> Corrected:
    """Give them as they are after their frames were related."""
    return correct_poses(in_a_room[0], PipelineParameters())


def test_robots_that_hear_the_same_room_share_a_frame(
    in_a_room: tuple[list[Ping], np.ndarray], joined: Corrected
) -> None:
    assert {one.frame_id for _, one in joined.pings} == {"map"}
    assert {one.state for one in joined.robots.values()} == {"joined"}
    # The frame is where one of them began.
    first = next(n for n, (topic, _) in enumerate(in_a_room[0]) if "robot1" in topic)
    origin = compose(in_a_room[1][first], between(places(in_a_room[0])[first], np.zeros(3)))
    off_m = (compose(origin, places(joined.pings)) - in_a_room[1])[:, :2]
    assert np.sqrt(np.mean(np.sum(off_m**2, axis=1))) < 0.2


def test_what_is_said_of_robots_goes_into_the_summary(joined: Corrected) -> None:
    told = joined.robots["robot2"].summary()
    assert told["poses"] == "odometry from anywhere"
    assert (told["frame_id"], told["state"]) == ("map", "joined")


@pytest.mark.slow
def test_a_robot_joins_those_that_know_where_they_are(
    in_a_room: tuple[list[Ping], np.ndarray],
) -> None:
    both = [
        (topic, replace(one, frame_id="world", pose=Pose.planar(*real)) if "1" in topic else one)
        for (topic, one), real in zip(*in_a_room, strict=True)
    ]
    done = correct_poses(both, PipelineParameters())
    assert {one.frame_id for _, one in done.pings} == {"world"}
    off_m = (places(done.pings) - in_a_room[1])[:, :2]
    assert np.hypot(*off_m.T).max() < 0.3
    for (topic, one), (_, told) in zip(done.pings, both, strict=True):
        assert one is told or "robot2" in topic


@pytest.fixture(scope="module")
def earlier(in_a_room: tuple[list[Ping], np.ndarray]) -> OccupancyMap:
    """Give what robot1 made of the room another day, when it knew where it was."""
    pipeline = Pipeline()
    for (topic, one), real in zip(*in_a_room, strict=True):
        if "robot1" in topic:
            pipeline.fuse(replace(one, frame_id="house", pose=Pose.planar(*real)), topic)
    return pipeline.occupancy_map()


def test_a_robot_joins_an_earlier_map(
    in_a_room: tuple[list[Ping], np.ndarray], earlier: OccupancyMap
) -> None:
    mine = ["robot2" in topic for topic, _ in in_a_room[0]]
    pings = [ping for ping, is_mine in zip(in_a_room[0], mine, strict=True) if is_mine]
    run = PoseRun(frame_id=earlier.frame_id, earlier=earlier)
    done = list(run.corrected(pings))
    assert {one.frame_id for _, one in done} == {"house"}
    assert run.robots["robot2"]["state"] == "joined"
    off_m = (places(done) - in_a_room[1][mine])[:, :2]
    assert np.hypot(*off_m.T).max() < 0.3


def test_a_robot_among_poles_does_not_join_the_map_of_a_room(earlier: OccupancyMap) -> None:
    done = correct_poses(going_round("robot2"), PipelineParameters(), "house", earlier=earlier)
    assert done.robots["robot2"].state == "alone"
    assert {one.frame_id for _, one in done.pings} == {"robot2/odom"}


@pytest.mark.parametrize("use", ["told", "auto"])
def test_starts_that_are_stated_need_no_evidence(use: str) -> None:
    starts = [f"{robot} {' '.join(map(str, start))}" for robot, start in STARTS.items()]
    parameters = PipelineParameters.model_validate({"poses": {"use": use, "initial_poses": starts}})
    few = [ping for robot in STARTS for ping in going_round(robot)]
    done = correct_poses(few, parameters)
    assert {one.frame_id for _, one in done.pings} == {"map"}
    true = np.concatenate([circle(20) for _ in STARTS])
    np.testing.assert_allclose(
        places(done.pings)[:, :2], true[:, :2], atol=1e-9 if use == "told" else 0.1
    )


def test_a_ping_in_another_frame_is_as_uncertain_as_frame_and_lever_make_it() -> None:
    known = np.diag([0.01, 0.02, 0.003])
    inner = Pose.planar(3.0, 1.0, 0.4, planar_covariance=known)
    change = Pose.planar(1.0, -2.0, np.pi / 2, planar_covariance=np.diag([0.1, 0.1, 0.05]))
    _, one = moved(("/robot1/echo", cone(inner)), change, np.array([2.0, 1.0]), "map")
    expected = compose(np.array([1.0, -2.0, np.pi / 2]), np.array([3.0, 1.0, 0.4]))
    assert one.frame_id == "map"
    np.testing.assert_allclose([*one.pose.position_m[:2], one.pose.yaw_rad], expected, atol=1e-9)
    # 1 m from the centre of the match, which lies to the south after the turn.
    variances = np.diagonal(one.pose.planar_covariance)
    np.testing.assert_allclose(variances, [0.02 + 0.1 + 0.05, 0.01 + 0.1, 0.003 + 0.05])


def drifting(robot: str) -> list[Ping]:
    """Pings among poles of a robot whose odometry takes ways to be longer than they are."""
    made = []
    for number, real in enumerate(circle(60)):
        known = np.diag([1e-6] * 3) + 1e-4 * number * np.diag([1.0, 1.0, 0.1])
        told = Pose.planar(
            float(real[0]) + 0.002 * number, *map(float, real[1:]), planar_covariance=known
        )
        ranges_m = heard(Pose.planar(*real), poles())
        one = cone(told, ranges_m, 250_000_000 * number + 1, child_frame_id=f"{robot}/sonar")
        made.append((f"/{robot}/echo", one))
    return made


def bent_m(pings: list[Ping]) -> float:
    """How far a way is off, wherever it lies as a whole (RMS)."""
    found, true = places(pings)[:, :2], circle(60)[:, :2]
    found, true = found - found.mean(axis=0), true - true.mean(axis=0)
    # Turned so that both are nearest, as complex numbers.
    one, other = (way[:, 0] + 1j * way[:, 1] for way in (found, true))
    turn = np.vdot(one, other) / abs(np.vdot(one, other))
    return float(np.sqrt(np.mean(np.abs(turn * one - other) ** 2)))


def joined_by(change: tuple[float, float, float]) -> tuple[list[Ping], list[Ping]]:
    """Refined ways of two robots of which one is said to stand so far from where it does."""
    one, other = drifting("robot1"), drifting("robot2")
    pose = Pose.planar(*change, planar_covariance=np.diag([0.01, 0.01, 0.001]))
    forced = [moved(ping, pose, np.array([3.0, 3.0]), "map") for ping in other]
    kinds = dict.fromkeys(("robot1", "robot2"), PoseKind.ODOMETRY)
    done = list(refine_poses(one + forced, kinds=kinds).pings)
    return done[:60], done[60:]


def test_ways_that_are_joined_rightly_are_as_they_were() -> None:
    assert bent_m(drifting("robot1")) > 0.03
    assert max(map(bent_m, joined_by((0.0, 0.0, 0.0)))) < 0.01


@pytest.mark.parametrize("wrong", [(0.7, 0.3, 0.4), (1.5, 0.0, 1.5), (0.0, 0.5, 0.1)])
def test_a_joining_that_is_wrong_bends_nobodys_way(wrong: tuple[float, float, float]) -> None:
    """Neither way is more bent than odometry has it, and the one of most landmarks is mended."""
    bent = sorted(map(bent_m, joined_by(wrong)))
    assert bent[0] < 0.015
    assert bent[1] < bent_m(drifting("robot1"))


def test_a_robot_that_has_lost_itself_joins_nobody() -> None:
    one = going_round("robot1")
    lost = [
        (topic, replace(ping, pose=Pose.planar(1e4 * number, 0.0, 0.0)))
        for number, (topic, ping) in enumerate(going_round("robot2"))
    ]
    done = correct_poses(one + lost, PipelineParameters())
    assert {state.state for state in done.robots.values()} == {"alone"}


@pytest.mark.parametrize(
    ("pieces", "again", "state"),
    [
        # Once poses are refined together, maps lie there surely; elsewhere; no more surely.
        (30.0, (0.1, 5.0), "joined"),
        (30.0, (1.0, 5.0), "alone"),
        (30.0, (0.1, 2.6), "alone"),
        # Surely by its margin, which is of too few pieces.
        (30.0, (0.1, 3.5), "alone"),
        # Nobody looks again at what has little in common.
        (8.0, (0.1, 5.0), "alone"),
    ],
)
def test_a_match_that_is_nearly_sure_is_looked_at_with_poses_refined_together(
    monkeypatch: pytest.MonkeyPatch, pieces: float, again: tuple[float, float], state: str
) -> None:
    change = compose(between(STARTS["robot1"], np.zeros(3)), STARTS["robot2"])
    about_m = np.array([2.0, 1.0])
    shift_m, margin = again
    matches = [
        Match(change, about_m, pieces, 2.5, 0.1, 2.5),
        Match(np.array([shift_m, 0.0, 0.0]), about_m, 40.0, margin, 0.0, margin),
    ]
    monkeypatch.setattr(
        "usmap_ros.runs.frame_matches.match_maps", lambda one, other: matches.pop(0)
    )
    pings = [ping for robot in STARTS for ping in going_round(robot)]
    done = correct_poses(pings, PipelineParameters())
    assert {one.state for one in done.robots.values()} == {state}
    if state == "joined":
        found, true = places(done.pings)[:, :2], np.concatenate([circle(20)] * 2)[:, :2]
        origin = compose(STARTS["robot1"], np.c_[found, np.zeros(len(found))])[:, :2]
        assert np.hypot(*(origin - true).T).max() < 0.3


def test_who_is_sure_is_joined_before_anybody_looks_again_or_is_bent(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Once two are joined, their map tells more of the third than it does of either."""
    monkeypatch.setitem(STARTS, "robot3", np.array([0.5, -1.0, -1.0]))
    lies = {name: between(STARTS["robot1"], start) for name, start in STARTS.items()}
    from_2 = between(STARTS["robot2"], STARTS["robot3"])
    matches = [
        Match(lies["robot2"], np.zeros(2), 60.0, 6.0, 0.0),
        Match(lies["robot3"], np.zeros(2), 30.0, 2.5, 0.1),
        Match(from_2, np.zeros(2), 30.0, 2.5, 0.1),
        Match(lies["robot3"], np.zeros(2), 60.0, 6.0, 0.0),
    ]
    monkeypatch.setattr(
        "usmap_ros.runs.frame_matches.match_maps", lambda one, other: matches.pop(0)
    )
    looks: list[object] = []
    monkeypatch.setattr("usmap_ros.runs.frame_matches.second_look", lambda *of: looks.append(of))
    together: list[int] = []

    def refined_together(pings: list[Ping], **known: Any) -> Refinement:
        together.append(len(pings))
        return refine_poses(pings, **known)

    monkeypatch.setattr("usmap_ros.runs.joining.refine_poses", refined_together)
    pings = [ping for robot in STARTS for ping in going_round(robot)]
    done = correct_poses(pings, PipelineParameters())
    assert {one.state for one in done.robots.values()} == {"joined"}
    assert (len(matches), looks, together) == (0, [], [60])


def test_what_was_promising_before_others_were_joined_is_looked_at_with_all_of_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The map of those that are joined no longer shows where the third is."""
    monkeypatch.setitem(STARTS, "robot3", np.array([0.5, -1.0, -1.0]))
    lies = between(STARTS["robot1"], STARTS["robot2"])
    from_2 = between(STARTS["robot2"], STARTS["robot3"])
    matches = [
        Match(lies, np.zeros(2), 60.0, 6.0, 0.0),
        Match(np.zeros(3), np.zeros(2), 30.0, 0.5, 0.1),
        Match(from_2, np.array([2.0, 1.0]), 30.0, 2.5, 0.1, 2.5),
        # Before pings of both are refined together, and after.
        Match(np.zeros(3), np.zeros(2), 30.0, 0.5, 0.1),
        Match(np.zeros(3), np.zeros(2), 30.0, 0.5, 0.1),
        # The second look.
        Match(np.array([0.1, 0.0, 0.0]), np.zeros(2), 40.0, 5.0, 0.0, 5.0),
    ]
    monkeypatch.setattr(
        "usmap_ros.runs.frame_matches.match_maps", lambda one, other: matches.pop(0)
    )
    pings = [ping for robot in STARTS for ping in going_round(robot)]
    done = correct_poses(pings, PipelineParameters())
    assert {one.state for one in done.robots.values()} == {"joined"}
    found, true = places(done.pings)[:, :2], np.concatenate([circle(20)] * 3)[:, :2]
    origin = compose(STARTS["robot1"], np.c_[found, np.zeros(len(found))])[:, :2]
    assert np.hypot(*(origin - true).T).max() < 0.3
