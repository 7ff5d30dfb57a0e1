"""Robots on their paths."""

import itertools

import numpy as np
import pytest

from usmap_ros.grids import GridGeometry
from usmap_ros.numerics.geometry import Pose
from usmap_ros.simulation.motion import (
    BlockedPathError,
    DelayedMotion,
    RandomWalk,
    RandomWalkModel,
    WaypointModel,
    WaypointMotion,
)
from usmap_ros.simulation.occlusion import path_wall_distances
from usmap_ros.simulation.polyline import Polyline
from usmap_ros.simulation.scene import FreeCells

AREA = (0.0, 4.0, 0.0, 4.0)
CORNERS = [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)]
SQUARE = np.array(CORNERS)


def walk(world, *, start=None, seed=1, clearance=0.2, area=AREA):
    rng = np.random.default_rng(seed)
    model = RandomWalkModel(speed_m_s=1.0, clearance_m=clearance)
    return RandomWalk(model, world, area, start, rng)


def waypoints(world, *, loop=False, **turns):
    model = WaypointModel(
        kind="waypoints", waypoints_m=CORNERS, loop=loop, speed_m_s=1.0, clearance_m=0.2, **turns
    )
    return WaypointMotion(model, world)


def test_a_polyline_is_walked_at_constant_speed():
    path = Polyline(SQUARE)
    for travelled, position, direction in [
        (-1.0, (0, 0), 0.0),
        (0.5, (0.5, 0), 0.0),
        (3.0, (2, 1), np.pi / 2),
        (6.0, (0, 2), np.pi),
        (99.0, (0, 2), np.pi),
    ]:
        found, heading = path.at(travelled)
        np.testing.assert_allclose(found, position, atol=1e-12)
        assert heading == pytest.approx(direction)


def test_a_loop_begins_again():
    path = Polyline(SQUARE, loop=True)
    np.testing.assert_allclose(path.at(7.0)[0], [0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(path.at(8.5)[0], [0.5, 0.0], atol=1e-12)


@pytest.mark.parametrize("waypoints", [SQUARE[:1], SQUARE[[0, 0]]])
def test_a_path_without_length_stays_put(waypoints):
    np.testing.assert_array_equal(Polyline(waypoints).at(3.0)[0], [0.0, 0.0])


def test_repeated_waypoints_do_not_matter():
    path = Polyline(SQUARE[[0, 0, 1, 1, 2]])
    np.testing.assert_allclose(path.at(3.0)[0], [2.0, 1.0])


def test_a_robot_looks_where_it_goes_unless_told_otherwise(scene):
    assert waypoints(scene()).pose(3.0).yaw_rad == pytest.approx(np.pi / 2)
    turned = waypoints(scene(), spin_rad_s=0.1, heading_rad=-0.5)
    assert turned.pose(3.0).yaw_rad == pytest.approx(np.pi / 2 - 0.5 + 0.3)


@pytest.mark.parametrize("obstacle", ["wall", "pole", "solid"])
def test_a_path_through_something_is_refused(scene, points, walls, obstacle):
    world = {
        "wall": lambda: scene(walls=walls((1, -1), (1, 1))),
        "pole": lambda: scene(points((2.3, 1.0), radius=0.2)),
        "solid": lambda: scene(
            free_space=FreeCells(GridGeometry(1.0, (-2.0, -2.0), (8, 8)), np.zeros((8, 8), bool))
        ),
    }[obstacle]()
    with pytest.raises(BlockedPathError, match="room"):
        waypoints(world)


def test_the_way_back_of_a_loop_is_checked_too(scene, walls):
    world = scene(walls=walls((-0.5, 1), (0.5, 1)))
    waypoints(world)
    with pytest.raises(BlockedPathError, match="waypoint 3"):
        waypoints(world, loop=True)


def test_a_walk_keeps_clear_of_everything(scene, points, walls):
    wall = walls((0, 2), (1.5, 2), (1.5, 3))
    world = scene(points((3, 1), (2.5, 3), radius=0.3), wall)
    motion = walk(world)
    track = np.array([motion.pose(0.05 * step).position_m[:2] for step in range(4000)])
    assert track.min() >= 0.0
    assert track.max() <= 4.0
    for start, end in itertools.pairwise(track):
        assert world.clearance_m(start, end) >= 0.2 - 1e-9
        assert path_wall_distances(start, end, wall.starts_m, wall.ends_m).min() > 0.0
    # It does get around.
    assert np.ptp(track, axis=0).min() > 3.0


def test_a_walk_goes_at_its_speed_in_the_direction_that_it_looks(scene):
    motion = walk(scene(), start=Pose.planar(2.0, 2.0, 0.7))
    first, then = motion.pose(0.0), motion.pose(0.05)
    assert first.yaw_rad == pytest.approx(0.7)
    step = then.position_m - first.position_m
    np.testing.assert_allclose(step[:2], 0.05 * np.array([np.cos(0.7), np.sin(0.7)]))


def test_a_walk_is_the_same_however_it_is_asked(scene):
    forwards, backwards = walk(scene()), walk(scene())
    times = np.linspace(0.0, 20.0, 50)
    one = [forwards.pose(time).position_m for time in times]
    other = [backwards.pose(time).position_m for time in times[::-1]][::-1]
    np.testing.assert_array_equal(one, other)


def test_a_walled_in_robot_waits(scene, walls):
    cell = walls((1, 1), (1.5, 1), (1.5, 1.5), (1, 1.5), (1, 1))
    motion = walk(scene(walls=cell), start=Pose.planar(1.25, 1.25, 0.0))
    for time in np.linspace(0.0, 5.0, 40):
        position = motion.pose(time).position_m
        assert position.min(where=[True, True, False], initial=9.0) >= 1.2 - 1e-9
        assert position.max() <= 1.3 + 1e-9


@pytest.mark.parametrize("start", [Pose.planar(3.0, 1.1, 0.0), Pose.planar(9.0, 9.0, 0.0)])
def test_a_start_without_room_is_refused(scene, points, start):
    with pytest.raises(BlockedPathError, match="no room at the start"):
        walk(scene(points((3, 1), radius=0.3)), start=start)


def test_no_room_anywhere_is_said(scene, points):
    with pytest.raises(BlockedPathError, match="anywhere"):
        walk(scene(points((2, 2), radius=10.0)))


def test_a_random_start_is_on_a_free_cell(scene):
    free = np.zeros((4, 4), dtype=bool)
    free[3, 1] = True
    world = scene(free_space=FreeCells(GridGeometry(1.0, (0.0, 0.0), (4, 4)), free))
    position = walk(world).pose(0.0).position_m
    assert np.floor(position[:2]).tolist() == [1.0, 3.0]


def test_a_robot_that_starts_later_goes_the_same_way(scene):
    now, later = walk(scene()), DelayedMotion(walk(scene()), 30.0)
    for time_s in (0.0, 12.3, 30.0):
        np.testing.assert_array_equal(later.pose(time_s).position_m, now.pose(0.0).position_m)
        assert later.pose(time_s).yaw_rad == now.pose(0.0).yaw_rad
    for time_s in (0.0, 0.1, 7.77):
        np.testing.assert_allclose(
            later.pose(30.0 + time_s).position_m, now.pose(time_s).position_m, atol=1e-9
        )
