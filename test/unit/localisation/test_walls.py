"""Poses along walls, corrected by the feet of perpendiculars; and echoes that tell lies."""

from dataclasses import replace

import numpy as np
import pytest
from pings_among_poles import Ping, cone
from pings_among_poles import heard as heard_of

from usmap_ros.localisation import refine_poses, search
from usmap_ros.localisation.data_association import associate_echoes
from usmap_ros.localisation.echo_table import tabulate
from usmap_ros.localisation.lines_and_points import Landmarks
from usmap_ros.localisation.planar import between, compose
from usmap_ros.localisation.smoother import Smoother
from usmap_ros.localisation.votes import find_landmarks, find_lines, find_points
from usmap_ros.numerics.geometry import Pose, wrapped
from usmap_ros.pings.range_cones import RangeReading

#: Normals and distances of a room's walls: one of them aslant, so that no turn brings it back.
ROOM = Landmarks(np.array([0.0, 1.6, np.pi, -1.3]), np.array([6.0, 4.5, 0.5, 0.3]))
#: Odometry's errors from ping to ping: m, m, rad.
DRIFT = np.array([0.006, 0.006, 0.006])


def way(count: int) -> np.ndarray:
    """True poses: round and round, looking this way and that."""
    angle = np.linspace(0.0, 4.0 * np.pi, count)
    yaw = angle + 0.5 * np.pi + 0.9 * np.sin(3.0 * angle)
    return np.column_stack([2.8 + 1.6 * np.cos(angle), 2.2 + 1.2 * np.sin(angle), yaw])


def at(pose: np.ndarray, covariance: np.ndarray | None = None) -> Pose:
    """A pose from its x, y and yaw."""
    x_m, y_m, yaw_rad = map(float, pose)
    return Pose.planar(x_m, y_m, yaw_rad, planar_covariance=covariance)


def ranges_m(pose: np.ndarray, walls: Landmarks = ROOM) -> np.ndarray:
    """From where the walls in the beam answer."""
    far_m = walls.distances_m - pose[:2] @ walls.normals()
    faced = np.abs(wrapped(walls.normals_rad - pose[2])) < 0.66
    return far_m[faced & (far_m > 0.2) & (far_m < 4.5)]


def first_m(pose: np.ndarray, half_angle_rad: float) -> float:
    """The nearest thing in a beam, whichever way it faces."""
    heading = pose[2] + np.linspace(-half_angle_rad, half_angle_rad, 201)
    rays = np.stack([np.cos(heading), np.sin(heading)])
    far_m = ROOM.distances_m - pose[:2] @ ROOM.normals()
    ahead = ROOM.normals().T @ rays
    return float((far_m[:, np.newaxis] / np.maximum(ahead, 1e-3)).min())


def ranging(half_angle_rad: float, seed: int = 4) -> tuple[list[Ping], np.ndarray]:
    """Pings of a robot that drifts with a sensor that reports the first thing in a narrow beam."""
    true = way(400)
    told, known = told_of(true, seed)
    pings = []
    for number, (one, pose, covariance) in enumerate(zip(true, told, known, strict=True)):
        far_m = first_m(one, 0.95 * half_angle_rad)
        reading = RangeReading(number + 1, "robot1/range", 2.0 * half_angle_rad, 0.1, 9.0, far_m)
        pings.append(("/robot1/cone", reading.cone(at(pose, covariance), "map")))
    return pings, true


def told_of(true: np.ndarray, seed: int, scale: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Odometry of a way that it tells so many times too long, and its covariances."""
    rng = np.random.default_rng(seed)
    told, known = [true[0]], [np.zeros((3, 3))]
    for step in between(true[:-1], true[1:]):
        x_m, y_m, _ = compose(told[-1], step) - told[-1]
        carry = np.array([[1.0, 0.0, -y_m], [0.0, 1.0, x_m], [0.0, 0.0, 1.0]])
        known.append(carry @ known[-1] @ carry.T + np.diag(DRIFT**2))
        step_told = step * [scale, scale, 1.0] + DRIFT * rng.standard_normal(3)
        told.append(compose(told[-1], step_told))
    return np.array(told), np.array(known)


def recording(
    heard: list[np.ndarray], true: np.ndarray, seed: int = 4, scale: float = 1.0
) -> list[Ping]:
    """Pings of a robot whose odometry drifts, at some ranges."""
    rng = np.random.default_rng(seed + 100)
    told, known = told_of(true, seed, scale)
    return [
        (
            "/robot1/echo",
            cone(
                at(pose, covariance), ranges + 0.01 * rng.standard_normal(len(ranges)), number + 1
            ),
        )
        for number, (pose, covariance, ranges) in enumerate(zip(told, known, heard, strict=True))
    ]


def off_m(pings: list[Ping], true: np.ndarray) -> float:
    """Root mean square of how far places are off."""
    found = np.array([one.pose.position_m[:2] for _, one in pings])
    return float(np.sqrt(np.mean(np.sum((found - true[:, :2]) ** 2, axis=1))))


def test_lines_are_found_by_the_feet_of_their_perpendiculars() -> None:
    true = way(240)
    echoes = tabulate([cone(at(pose), ranges_m(pose)) for pose in true], np.ones(len(true)))
    everyone = np.ones(len(true), bool)
    found = find_lines(echoes, true, everyone, 0.05)
    # By components of normals, so that no angle has a seam.
    there = np.vstack([ROOM.normals(), ROOM.distances_m])
    here = np.vstack([found.normals(), found.distances_m])
    apart = np.abs(there[:, :, np.newaxis] - here[:, np.newaxis]).max(axis=0)
    assert apart.min(axis=1).max() < 0.03
    heard = associate_echoes(echoes, true, everyone, found, 0.05)
    assert heard.shares.sum() > 0.9 * len(echoes.ping)
    assert np.abs(heard.off_m[heard.shares > 0.5]).max() < 0.02


def test_walls_whose_echoes_scatter_little_count_for_more() -> None:
    rng, true = np.random.default_rng(2), way(240)
    # The walls to the east and the west are as even as walls are, the others are not.
    uneven = np.array([0.001, 0.03, 0.001, 0.03])
    walls = ROOM._replace(distances_m=ROOM.distances_m + uneven * rng.normal(size=(240, 1)))
    heard_m = [ranges_m(pose, ROOM._replace(distances_m=far_m))
               for pose, far_m in zip(true, walls.distances_m, strict=True)]  # fmt: skip
    echoes = tabulate(
        [cone(at(pose), each) for pose, each in zip(true, heard_m, strict=True)], np.ones(240)
    )
    heard = associate_echoes(echoes, true, np.ones(240, bool), ROOM, 0.02)
    even, others = (heard.precision[(heard.landmark % 2 == side)].mean() for side in (0, 1))
    assert even > 3.0 * others


def test_echoes_that_may_be_of_several_landmarks_tell_less() -> None:
    true = way(240)
    # A wall just behind the first one, of which nobody hears more than chance leaves open.
    double = Landmarks(np.append(ROOM.normals_rad, 0.0), np.append(ROOM.distances_m, 6.04))
    cones = [cone(at(pose), ranges_m(pose) + 0.02 * (number % 3 - 1))
             for number, pose in enumerate(true)]  # fmt: skip
    echoes = tabulate(cones, np.ones(240))
    heard = associate_echoes(echoes, true, np.ones(240, bool), double, 0.02)
    observed = heard.observed(echoes, double.total, 0.02)
    left = observed.precision / heard.precision
    assert left[heard.landmark == 4].max() < 0.5
    assert 0.8 < left[heard.landmark != 4].min() <= left.max() <= 1.0


def test_poles_in_a_room_are_points_and_its_walls_are_lines() -> None:
    true = way(240)
    poles_m = np.array([[1.8, 3.4], [4.6, 1.2]])
    heard_m = []
    for pose in true:
        off_m = poles_m - pose[:2]
        far_m, aside = np.hypot(*off_m.T), wrapped(np.arctan2(*off_m.T[::-1]) - pose[2])
        heard_m.append(np.sort(np.append(ranges_m(pose), far_m[np.abs(aside) < 0.6])))
    cones = [cone(at(pose), each) for pose, each in zip(true, heard_m, strict=True)]
    heard = tabulate(cones, np.ones(240)), true, np.ones(240, bool)
    found, lines = find_landmarks(*heard, 0.03), find_lines(*heard, 0.03)
    apart_m = np.linalg.norm(found.points_m[:, np.newaxis] - poles_m, axis=2)
    assert apart_m.min(axis=0).max() < 0.03
    there = np.vstack([ROOM.normals(), ROOM.distances_m])
    here = np.vstack([found.normals(), found.distances_m])
    apart = np.abs(there[:, :, np.newaxis] - here[:, np.newaxis]).max(axis=0)
    assert apart.min(axis=1).max() < 0.03
    # Chance lines, and points along walls, are not worth their cost.
    assert found.total < lines.total + len(find_points(*heard, 0.03))


def test_where_nobody_hears_anything_there_are_no_walls() -> None:
    silent = tabulate([cone(at(pose)) for pose in way(9)], np.ones(9))
    assert len(find_lines(silent, way(9), np.ones(9, bool), 0.05).normals_rad) == 0


@pytest.mark.parametrize("seed", [4, 6])
def test_walls_correct_odometry(seed: int) -> None:
    true = way(400)
    pings = recording([ranges_m(pose) for pose in true], true, seed)
    assert off_m(pings, true) > 0.15
    assert off_m(refine_poses(pings).pings, true) < 0.08


def test_a_sensor_of_the_first_thing_hears_walls_at_the_edge_of_its_beam() -> None:
    pings, true = ranging(0.3)
    echoes = tabulate([one for _, one in pings], np.ones(len(true)))
    heard = associate_echoes(echoes, true, np.ones(len(true), bool), ROOM, 0.05)
    # Two thirds of them hear no foot of a perpendicular.
    assert heard.shares.sum() > 0.7 * len(echoes.ping)
    by_turning = np.array([[0.0, 0.0, 1e-4]])
    turned = associate_echoes(echoes, true + by_turning, np.ones(len(true), bool), ROOM, 0.05)
    where = {pair: row for row, pair in enumerate(zip(turned.echo, turned.landmark, strict=True))}
    hits = np.flatnonzero(heard.shares > 0.5)
    there = [where[heard.echo[hit], heard.landmark[hit]] for hit in hits]
    np.testing.assert_allclose(
        turned.off_m[there] - heard.off_m[hits], 1e-4 * heard.by_pose[2, hits], atol=1e-6
    )


@pytest.mark.parametrize("seed", [4, 6])
def test_walls_at_the_edge_of_beams_correct_odometry(seed: int) -> None:
    pings, true = ranging(0.3, seed)
    assert off_m(refine_poses(pings).pings, true) < 0.5 * off_m(pings, true)


@pytest.mark.parametrize("seed", [4, 5])
def test_odometry_that_is_better_than_it_says_is_not_made_worse_by_clutter(seed: int) -> None:
    rng, true = np.random.default_rng(seed), way(300)
    # It drifts by a tenth of what it states; and two of three readings are of what stands about.
    told, stated = told_of(true, seed)
    told = true + 0.1 * (told - true)
    pings = []
    for number, (one, pose, covariance) in enumerate(zip(true, told, stated, strict=True)):
        near = 1.0 if rng.random() < 0.33 else rng.uniform(0.3, 1.0)
        reading = RangeReading(
            number + 1, "robot1/range", 0.6, 0.1, 9.0, near * first_m(one, 0.28)
        )  # fmt: skip
        pings.append(("/robot1/cone", reading.cone(at(pose, covariance), "map")))
    assert off_m(refine_poses(pings).pings, true) < 1.02 * off_m(pings, true)


@pytest.mark.parametrize("seed", [4, 6])
def test_first_echoes_of_poles_correct_odometry(seed: int) -> None:
    true = way(400)
    told, known = told_of(true, seed)
    places_m = np.random.default_rng(seed).uniform([-0.5, -1.0], [6.0, 5.5], (30, 2))
    pings = []
    for number, (one, pose, covariance) in enumerate(zip(true, told, known, strict=True)):
        first = min(heard_of(at(one), places_m), default=np.inf)
        reading = RangeReading(number + 1, "robot1/sonar", 1.4, 0.1, 5.0, float(first))
        pings.append(("/robot1/cone", reading.cone(at(pose, covariance), "map")))
    assert off_m(refine_poses(pings).pings, true) < 0.5 * off_m(pings, true)


def test_odometry_that_tells_all_ways_too_long_is_seen_through() -> None:
    true = way(400)
    pings = recording([ranges_m(pose) for pose in true], true, scale=1.08)
    assert off_m(refine_poses(pings).pings, true) < 0.05


def bent_m(lies: list[np.ndarray], asked: np.ndarray) -> float:
    """How far lies move poses from where they are found without them."""
    true = way(len(lies))
    honest = recording([ranges_m(pose) for pose in true], true)
    with_lies = recording(lies, true)
    ways = [
        np.array([one.pose.position_m for _, one in refine_poses(pings).pings])[asked]
        for pings in (honest, with_lies)
    ]
    return float(np.sqrt(np.mean(np.sum((ways[0] - ways[1]) ** 2, axis=1))))


def test_a_wrong_closure_does_not_bend_the_way() -> None:
    number = np.arange(400)
    is_lying = (number >= 140) & (number < 164)
    # As if the robot were somewhere else for a while: its echoes agree with one another.
    elsewhere = np.array([0.35, -0.3, 0.0])
    lies = [ranges_m(pose + lie * elsewhere) for pose, lie in zip(way(400), is_lying, strict=True)]
    assert bent_m(lies, (number < 130) | (number >= 174)) < 0.03


def test_echoes_of_what_is_not_there_do_not_bend_the_way() -> None:
    rng, true = np.random.default_rng(9), way(400)
    # Half of all pings hear a wall that is parallel to another and nearer, all hear something.
    ghost = Landmarks(np.array([0.0]), np.array([5.6]))
    lies = [
        np.concatenate(
            [ranges_m(pose), ranges_m(pose, ghost)[: rng.integers(2)], rng.uniform(0.3, 4.5, 1)]
        )
        for pose in true
    ]
    told = recording(lies, true)
    assert off_m(refine_poses(told).pings, true) < 0.25 * off_m(told, true)


def test_poses_that_are_right_stay() -> None:
    true = way(160)
    pings = recording([ranges_m(pose) for pose in true], true)
    known = [one.pose.planar_covariance for _, one in pings]
    right = [
        (topic, replace(one, pose=at(pose, covariance)))
        for (topic, one), pose, covariance in zip(pings, true, known, strict=True)
    ]
    assert off_m(refine_poses(right).pings, true) < 0.02


def test_a_way_that_a_search_draws_together_is_looked_for_as_told_as_well(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Echoes of echoes meet more often in a place that is smaller, by a fifth in one corridor."""
    go_along = search._go_along

    def drawn_together(one: Smoother, stretch: int, points_m: float) -> search.Adjusted:
        adjusted = go_along(one, stretch, points_m)
        for track, knots in zip(one.tracks, one.knots, strict=True):
            if track.scale_std > 0.01:
                knots[:, :2] = knots[0, :2] + 0.8 * (knots[:, :2] - knots[0, :2])
        one.spread()
        return adjusted

    monkeypatch.setattr(search, "_go_along", drawn_together)
    true = way(240)
    pings = recording([ranges_m(pose) for pose in true], true)
    assert off_m(refine_poses(pings).pings, true) < min(0.05, 0.5 * off_m(pings, true))
