"""Walls that answer as mirrors do, found by the feet of perpendiculars."""

import cmath
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.mapping.joint.fusion import JointFusion
from usmap_ros.mapping.joint.leave_one_out import kept_pings
from usmap_ros.mapping.joint.surfaces.mirror_fits import MirrorSearch
from usmap_ros.mapping.joint.surfaces.mirror_walls import BESIDE_M, mirror_walls, stands_out
from usmap_ros.mapping.joint.surfaces.mirrors import MirrorWall
from usmap_ros.mapping.joint.surfaces.panes import lone_lines
from usmap_ros.mapping.ping_table import RANGE_STD
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone


def mirrors_of(cones: list[EchoCone], faint: float = 0.0) -> list[MirrorWall]:
    """Mirrors, where cells explain what is fainter than that."""
    table, rows, _, echoes = kept_pings({"robot": cones}, MappingParameters()).pings()[:4]
    explained, usable = echoes.amplitude < faint, np.ones(len(echoes.range_m), bool)
    return mirror_walls(table, rows, echoes, explained, usable, np.zeros(len(rows), bool))


def test_a_mirror_is_where_its_echoes_are_square_to_it(
    mirror_pings: list[EchoCone], mirror_m: float
) -> None:
    (wall,) = mirrors_of(mirror_pings)
    assert wall.distance_m == pytest.approx(mirror_m, abs=0.005)
    assert math.sin(wall.normal_rad) == pytest.approx(1.0, abs=1e-4)
    # Its feet are below the robots: from x = 0 to 2.3 m, along the tangent (-1, 0).
    assert wall.begin_m == pytest.approx(-2.3, abs=0.05)
    assert wall.end_m == pytest.approx(0.0, abs=0.05)
    assert len(wall.echoes) == len(mirror_pings)


def test_where_a_robot_turned_hides_nothing_of_a_mirror_farther_along(
    make_cone: Callable[..., EchoCone], mirror_pings: list[EchoCone], mirror_m: float
) -> None:
    """It was heard oftener there than along the rest of it, and the whole wall was none."""
    beam, turning = BeamPattern.linear(), list[EchoCone]()
    for number in range(48):
        x_m, off_rad = 4.0 + 0.004 * number, 0.4 * math.sin(1.3 * number)
        echo = mirror_m, 0.9 * float(beam.gain(off_rad)) / (2.0 * mirror_m)
        pose = {"x_m": x_m, "y_m": 0.0, "yaw_rad": 0.5 * math.pi + off_rad}
        turning.append(make_cone(echo, stamp_ns=10**9 + number, **pose))
    walls = mirrors_of([*mirror_pings, *turning])
    # Where the robot turned is another piece of it, and on the same line.
    for wall in walls:
        assert wall.distance_m == pytest.approx(mirror_m, abs=0.005)
        assert math.sin(wall.normal_rad) == pytest.approx(1.0, abs=1e-4)
    along, turned_at = sorted(walls, key=lambda wall: -wall.begin_m)
    assert along.begin_m == pytest.approx(-2.3, abs=0.05)
    assert turned_at.begin_m == pytest.approx(-4.19, abs=0.01)


def test_so_few_echoes_in_line_are_no_mirror(mirror_pings: list[EchoCone], mirror_m: float) -> None:
    """Two poles that nothing else was heard of lined up six."""
    assert len(mirror_pings) >= 24
    every_second = mirror_pings[::2]
    assert mirrors_of(every_second[:8]) == []
    assert len(mirrors_of(every_second[:12])) == 1


def test_a_mirror_far_from_the_origin_is_found_too(
    mirror_pings_at: Callable[..., list[EchoCone]], mirror_m: float
) -> None:
    (wall,) = mirrors_of(mirror_pings_at(40.0, -25.0))
    assert wall.distance_m == pytest.approx(mirror_m - 25.0, abs=0.02)
    assert math.sin(wall.normal_rad) == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize(("every", "does_stand_out"), [(1, False), (2, False), (8, True)])
def test_a_line_of_which_no_more_is_heard_than_beside_it_is_no_mirror(
    make_cone: Callable[..., EchoCone],
    mirror_pings: list[EchoCone],
    mirror_m: float,
    *,
    every: int,
    does_stand_out: bool,
) -> None:
    """Where a floor fills all ranges, seven of its echoes lined up anywhere."""
    (wall,) = mirrors_of(mirror_pings)
    busy = list(mirror_pings)
    for number in range(0, len(busy), every):
        (range_m,), (amplitude,) = busy[number].ranges_m, busy[number].amplitudes
        beside = [(range_m + off_m, amplitude) for off_m in BESIDE_M]
        busy[number] = replace(
            make_cone((range_m, amplitude), *beside, stamp_ns=busy[number].stamp_ns),
            pose=busy[number].pose,
        )
    table, rows, _, echoes = kept_pings({"robot": busy}, MappingParameters()).pings()[:4]
    of_mirror = math.exp(wall.log_mirror)
    usable = np.ones(len(echoes.range_m), bool)
    limits = 0.7 * of_mirror, 1.4 * of_mirror
    search = MirrorSearch(table, rows, echoes, usable, np.zeros(len(rows), bool), *limits)
    assert stands_out(search, wall) == does_stand_out


def test_an_object_is_no_mirror(views: list[EchoCone]) -> None:
    assert mirrors_of(views) == []


def test_a_mirror_that_few_pings_strike_is_found(
    make_cone: Callable[..., EchoCone], mirror_pings: list[EchoCone], mirror_m: float
) -> None:
    """Others hear no more than a floor, a twentieth as loud."""
    chance, floor = np.random.default_rng(7), list[EchoCone]()
    for number in range(3 * len(mirror_pings)):
        away_m = np.sort(chance.uniform(0.5, 1.2, 3))
        echoes = list(zip(away_m, 0.025 * chance.rayleigh(size=3) / away_m, strict=True))
        pose = {"x_m": 0.03 * number, "yaw_rad": -0.5 * math.pi}
        floor.append(make_cone(*echoes, stamp_ns=10**9 + number, **pose))
    assert [wall.distance_m for wall in mirrors_of(mirror_pings + floor)] == [
        pytest.approx(mirror_m, abs=0.005)
    ]


def followed_echoes(
    make_cone: Callable[..., EchoCone],
    pings: int,
    loudness: float,
    varies: float,
    x_m: float,
    wall_m: float,
) -> list[EchoCone]:
    """Pings along a wall whose echo varies in loudness, and is followed by five more.

    What varies is a sum of what many places return: it is as far away as chance has it, too, and
    some of them are nearer than others.
    """
    beam, cones, chance = BeamPattern.linear(), [], np.random.default_rng(6)
    is_rough = varies > 0.0
    for number in range(pings):
        off_rad, level = 0.3 * math.sin(1.3 * number), math.exp(varies * math.sin(2.1 * number))
        amplitude = loudness * level * float(beam.gain(off_rad)) / (2.0 * wall_m)
        # Each from somewhere on the wall: what lay on one line would be a mirror, too.
        away_m = wall_m + np.sort(chance.uniform(0.05, 0.55, 5))
        scattered = list(zip(away_m, 0.05 * chance.rayleigh(size=5), strict=True))
        near_m, off_m = wall_m - chance.uniform(0.1, 0.5, 2), chance.uniform(-0.02, 0.02)
        nearer = [(float(each_m), 0.02) for each_m in np.sort(near_m)] if is_rough else []
        own = wall_m + (float(off_m) if is_rough else 0.0), amplitude
        pose = {"x_m": x_m + 0.1 * number, "yaw_rad": 0.5 * math.pi + off_rad}
        stamp_ns = round(1e6 * x_m) + number
        cones.append(make_cone(*nearer, own, *scattered, stamp_ns=stamp_ns, **pose))
    return cones


@pytest.mark.parametrize(("varies", "walls"), [(0.0, 1), (0.3, 0)])
def test_what_follows_a_steady_echo_makes_no_rough_wall_of_a_mirror(
    make_cone: Callable[..., EchoCone], mirror_m: float, varies: float, walls: int
) -> None:
    cones = followed_echoes(make_cone, 24, 0.9, varies, 0.0, mirror_m)
    assert len(mirrors_of(cones)) == walls


def test_rough_walls_beside_a_steady_mirror_do_not_speak_against_it(
    make_cone: Callable[..., EchoCone], mirror_m: float
) -> None:
    """They had more of the hits: a corridor with two smooth walls was mapped as if it had none."""
    mirror = followed_echoes(make_cone, 40, 0.9, 0.0, 0.0, mirror_m)
    rough = followed_echoes(make_cone, 90, 0.35, 0.3, 20.0, mirror_m - 0.4)
    (wall,) = mirrors_of([*mirror, *rough])
    assert wall.distance_m == pytest.approx(mirror_m, abs=0.01)


def test_what_is_heard_in_other_parts_of_a_place_does_not_speak_against_a_mirror(
    make_cone: Callable[..., EchoCone], mirror_m: float
) -> None:
    here = followed_echoes(make_cone, 24, 0.9, 0.0, 0.0, mirror_m)
    elsewhere = followed_echoes(make_cone, 120, 0.9, 0.3, 50.0, mirror_m)
    cones = {"robot": [*here, *elsewhere]}
    table, rows, _, echoes = kept_pings(cones, MappingParameters()).pings()[:4]
    is_here = np.repeat(np.arange(len(rows)) < len(here), np.diff(echoes.start))
    none = np.zeros(len(rows), bool)
    (wall,) = mirror_walls(table, rows, echoes, ~is_here, is_here, none)
    assert wall.distance_m == pytest.approx(mirror_m, abs=0.01)


def test_a_pane_beside_bricks_that_return_far_more_is_likely(
    make_cone: Callable[..., EchoCone], mirror_pings: list[EchoCone], mirror_m: float
) -> None:
    """A robot left through it: it was too faint for a mirror, and cells explained half of it."""
    bricks = followed_echoes(make_cone, 90, 9.0, 0.3, 20.0, mirror_m - 0.4)
    cones = {"robot": [*mirror_pings, *bricks]}
    table, rows, _, echoes = kept_pings(cones, MappingParameters()).pings()[:4]
    is_usable, none = np.ones(len(echoes.range_m), bool), np.zeros(len(rows), bool)
    are_few = np.arange(len(rows)) < len(mirror_pings) // 2
    is_explained = np.repeat(are_few, np.diff(echoes.start))
    given = table, rows, echoes, is_explained, is_usable, none
    assert mirror_walls(*given) == []
    assert lone_lines(*given).likely(0.0).sum() > 0.5


def test_a_pane_that_was_heard_in_a_few_places_is_one(
    make_cone: Callable[..., EchoCone], mirror_pings: list[EchoCone], mirror_m: float
) -> None:
    """Beyond a pane of 5 m a map was open for 15 m²: no place had heard it often enough."""
    bricks = followed_echoes(make_cone, 90, 9.0, 0.3, 20.0, mirror_m - 0.4)
    in_places = [cone for number, cone in enumerate(mirror_pings) if number % 10 < 4]
    table, rows, _, echoes = kept_pings(
        {"robot": [*in_places, *bricks]}, MappingParameters()
    ).pings()[:4]
    is_usable, none = np.ones(len(echoes.range_m), bool), np.zeros(len(rows), bool)
    panes = lone_lines(table, rows, echoes, is_usable & False, is_usable, none)
    assert panes.likely(0.0).sum() > 0.5


def test_no_pane_is_expected_among_bricks_alone(
    make_cone: Callable[..., EchoCone], mirror_m: float
) -> None:
    bricks = followed_echoes(make_cone, 90, 9.0, 0.3, 20.0, mirror_m - 0.4)
    table, rows, _, echoes = kept_pings({"robot": bricks}, MappingParameters()).pings()[:4]
    is_usable, none = np.ones(len(echoes.range_m), bool), np.zeros(len(rows), bool)
    assert lone_lines(table, rows, echoes, is_usable, is_usable, none).likely(0.0).sum() < 0.1


def turned(cone: EchoCone, by_rad: float, away_m: float) -> EchoCone:
    """A cone as it would be heard in a place that is turned, and moved along."""
    x_m, y_m = cone.pose.position_m[:2]
    place_m = complex(x_m, y_m) * cmath.exp(1j * by_rad) + away_m
    return replace(cone, pose=Pose.planar(place_m.real, place_m.imag, cone.pose.yaw_rad + by_rad))


@pytest.mark.parametrize(("rough_pings", "walls"), [(0, 4), (200, 0)])
def test_square_walls_that_scatter_and_mirror_alike_are_mirrors(
    make_cone: Callable[..., EchoCone], mirror_m: float, rough_pings: int, walls: int
) -> None:
    """What each returned varied by a fifth, and a room of them had no wall."""
    cones = [
        turned(cone, 0.5 * math.pi * quarters, 30.0 * quarters)
        for quarters in range(4)
        for cone in followed_echoes(make_cone, 24, 0.9, 0.25, 0.1 * quarters, mirror_m)
    ]
    # Walls of which each is as loud as chance has it, and none square to another.
    for number in range(rough_pings // 25):
        level = 0.3 * 1.25**number
        wall = followed_echoes(make_cone, 25, level, 0.3, 200.0 + 10.0 * number, mirror_m)
        cones += [turned(cone, 0.17 * number, 0.0) for cone in wall]
    # Cells are found for what scatters, but not for what mirrors.
    assert len(mirrors_of(cones, faint=0.1 if rough_pings else 0.0)) == walls


@pytest.mark.parametrize("turned_rad", [0.5 * math.pi, 0.7])
def test_steady_walls_may_differ_in_loudness(
    make_cone: Callable[..., EchoCone], mirror_m: float, turned_rad: float
) -> None:
    """Twelve pings each, at poses that are a little off, had no two of five walls alike."""
    beam, cones, chance = BeamPattern.linear(), list[EchoCone](), np.random.default_rng(9)
    for wall, level in enumerate(np.exp([-0.24, -0.12, 0.0, 0.12, 0.24])):
        for number in range(12):
            off_rad = 0.3 * math.sin(1.3 * number)
            loudness = level * math.exp(0.1 * math.sin(2.1 * number))
            echo = mirror_m, 0.8 * loudness * float(beam.gain(off_rad)) / (2.0 * mirror_m)
            pose = {"x_m": 0.1 * number, "yaw_rad": 0.5 * math.pi + off_rad}
            other = mirror_m + float(chance.uniform(0.2, 1.3)), 0.03
            cone = make_cone(echo, other, stamp_ns=100 * wall + number, **pose)
            cones.append(turned(cone, turned_rad * wall, 30.0 * wall))
    assert len(mirrors_of(cones)) == 5


@pytest.mark.parametrize(("is_first", "walls"), [(True, 2), (False, 1)])
def test_a_fainter_wall_is_one_if_nothing_is_heard_before_it(
    make_cone: Callable[..., EchoCone],
    mirror_pings: list[EchoCone],
    is_first: bool,
    walls: int,
) -> None:
    """A box in the middle of a room was called free; what came by way of others is as faint."""
    beam, cones, chance = BeamPattern.linear(), [], np.random.default_rng(8)
    for number in range(20):
        off_rad = 0.2 * math.sin(1.3 * number)
        other_m = float(chance.uniform(1.2, 2.8) if is_first else chance.uniform(0.3, 0.7))
        echoes = sorted([(0.8, 0.25 * float(beam.gain(off_rad)) / 1.6), (other_m, 0.05)])
        pose = {"x_m": 20.0 + 0.05 * number, "yaw_rad": 0.5 * math.pi + off_rad}
        cones.append(make_cone(*echoes, stamp_ns=10**9 + number, **pose))
    assert len(mirrors_of([*mirror_pings, *cones])) == walls


@pytest.mark.parametrize(("told_std_m", "walls"), [(0.015, 1), (0.0, 0)])
def test_a_mirror_is_found_though_poses_are_as_far_off_as_they_say(
    make_cone: Callable[..., EchoCone], mirror_m: float, told_std_m: float, walls: int
) -> None:
    """The sagitta of a point's arc is hardly more than the poses' errors: many echoes tell."""
    errors_m = np.random.default_rng(4).normal(0.0, 0.015, 40)
    covariance = np.diag([told_std_m**2, told_std_m**2, 0.0])
    where = {"yaw_rad": 0.5 * math.pi, "planar_covariance": covariance}
    cones = [
        make_cone((mirror_m, 0.4), x_m=0.02 * n, y_m=error_m, stamp_ns=n, **where)
        for n, error_m in enumerate(errors_m)
    ]
    found = mirrors_of(cones)
    assert len(found) == walls
    assert all(abs(wall.distance_m - mirror_m) < 0.02 for wall in found)
    assert all(len(wall.echoes) > 30 for wall in found)


@pytest.mark.parametrize(("told_std_m", "walls"), [(0.04, 0), (0.0, 1)])
def test_a_pole_heard_along_a_way_that_drifts_is_no_mirror(
    make_cone: Callable[..., EchoCone], told_std_m: float, walls: int
) -> None:
    """Errors of poses wander slowly, and make arcs straighter; a field of poles got such walls."""
    covariance = np.diag([told_std_m**2, told_std_m**2, 0.0])
    where = {"yaw_rad": 0.5 * math.pi, "planar_covariance": covariance}
    cones = []
    for n, x_m in enumerate(np.linspace(-0.35, 0.35, 20)):
        range_m = math.hypot(x_m, 2.0)
        y_m = 0.62 * (2.0 - range_m)
        cones.append(make_cone((range_m, 0.2), x_m=x_m, y_m=y_m, stamp_ns=n, **where))
    assert len(mirrors_of(cones)) == walls


def test_a_mirror_is_found_though_ranges_are_said_to_be_off_by_metres(
    mirror_pings: list[EchoCone],
) -> None:
    """Odometry says so that is good: an office lost the walls that told how it answers."""
    table, rows, _, echoes = kept_pings({"robot": mirror_pings}, MappingParameters()).pings()[:4]
    table.numbers[:, RANGE_STD] = 2.0
    none = np.zeros(len(echoes.range_m), bool)
    assert len(mirror_walls(table, rows, echoes, none, ~none, np.zeros(len(rows), bool))) == 1


def test_what_cells_explain_makes_no_mirror(mirror_pings: list[EchoCone]) -> None:
    table, rows, _, echoes = kept_pings({"robot": mirror_pings}, MappingParameters()).pings()[:4]
    explained = np.ones(len(echoes.range_m), bool)
    assert mirror_walls(table, rows, echoes, explained, explained, np.zeros(len(rows), bool)) == []


@pytest.mark.parametrize(("others", "walls"), [(2, 1), (3, 0), (9, 0)])
def test_where_cells_explain_most_of_it_a_line_is_no_mirror(
    make_cone: Callable[..., EchoCone], mirror_m: float, others: int, walls: int
) -> None:
    """Among 30 poles nine echoes lined up, and made walls of other poles; with a floor 14 did."""
    cones, rng = list[EchoCone](), np.random.default_rng(3)
    for number in range(24):
        mirror = mirror_m, 0.45 / mirror_m
        poles = [(range_m, 0.001) for range_m in np.sort(rng.uniform(2.5, 4.5, others))]
        pose = {"x_m": 0.1 * number, "y_m": 0.0, "yaw_rad": 0.5 * math.pi}
        cones.append(make_cone(mirror, *poles, stamp_ns=number, **pose))
    assert len(mirrors_of(cones, 0.01)) == walls


def test_a_mirror_is_drawn_where_it_stands(mirror_pings: list[EchoCone], mirror_m: float) -> None:
    fusion = JointFusion(MappingParameters())
    for cone in mirror_pings:
        fusion.fuse(cone)
    occupancy = fusion.occupancy_map()
    rows, _ = np.nonzero(occupancy.predicted())
    y_m = occupancy.geometry.origin_m[1] + (rows + 0.5) * occupancy.geometry.resolution_m
    assert len(np.unique(rows)) <= 3
    assert np.abs(y_m - mirror_m).max() < 0.11
    assert len(rows) > 35


def test_air_takes_from_far_echoes_and_not_from_the_mirror(
    make_cone: Callable[..., EchoCone],
) -> None:
    attenuation_db_m, mirror, cones = 1.6, 0.5, []
    for number in range(40):
        across_m = 0.6 + 0.07 * number
        level = mirror * 10.0 ** (-2.0 * attenuation_db_m * across_m / 20.0) / (2.0 * across_m)
        # Of a sensor that hears one thing only, loudness says nothing.
        other = across_m + 0.7 + 0.3 * math.sin(7.0 * number), 0.02
        pose = {"x_m": 0.05 * number, "y_m": -across_m, "yaw_rad": 0.5 * math.pi}
        cones.append(
            make_cone(
                (across_m, level),
                other,
                stamp_ns=number,
                attenuation_db_m=attenuation_db_m,
                max_range_m=5.0,
                **pose,
            )
        )
    (wall,) = mirrors_of(cones)
    assert len(wall.echoes) == len(cones)
    assert math.exp(wall.log_mirror) == pytest.approx(mirror, rel=0.02)


def test_a_short_wall_is_square_to_long_ones(
    make_cone: Callable[..., EchoCone], mirror_pings: list[EchoCone], mirror_m: float
) -> None:
    # Seven places in half a metre, of which the ranges would have it 1.1 degrees off.
    short = [
        make_cone((1.0 - 0.02 * 0.08 * k, 0.45), x_m=1.5, y_m=-2.0 + 0.08 * k, stamp_ns=100 + k)
        for k in range(7)
    ]
    wall = mirrors_of([*mirror_pings, *short])[1]
    assert math.cos(wall.normal_rad) == pytest.approx(1.0, abs=2e-5)
    # Its middle stays where it was heard.
    cosine, sine = math.cos(wall.normal_rad), math.sin(wall.normal_rad)
    along_m = 0.5 * (wall.begin_m + wall.end_m)
    x_m, y_m = wall.distance_m * cosine - along_m * sine, wall.distance_m * sine + along_m * cosine
    assert (x_m, y_m) == pytest.approx((2.5 - 0.02 * 0.24, -1.76), abs=0.01)


def test_a_wall_that_is_square_to_others_is_known_by_the_little_that_was_heard_of_it(
    make_cone: Callable[..., EchoCone], mirror_pings: list[EchoCone]
) -> None:
    """Who looks aslant strikes walls where it turns: of the six of a room three had been found."""
    short = [
        make_cone((1.0, 0.45), x_m=1.5, y_m=-2.0 + 0.022 * k, stamp_ns=100 + k) for k in range(8)
    ]
    wall = mirrors_of([*mirror_pings, *short])[1]
    assert math.cos(wall.normal_rad) == pytest.approx(1.0, abs=2e-5)
    assert wall.distance_m == pytest.approx(2.5, abs=0.005)
    standing = [replace(cone, pose=short[0].pose) for cone in short]
    assert len(mirrors_of([*mirror_pings, *standing])) == 1


def test_what_comes_back_from_a_corner_is_no_wall_aslant(
    make_cone: Callable[..., EchoCone],
    mirror_pings_at: Callable[..., list[EchoCone]],
    mirror_m: float,
) -> None:
    """An echo that follows closely fitted a wall through the corner, and that led outside."""
    # Of a corner at (9.576, 1.702), as a public simulator has it.
    heard = {
        (7.3427, 1.0824): (2.3216, 2.3309),
        (6.9662, 1.1709): (2.6647, 2.6742),
        (6.7471, 1.1709): (2.8865,),
        (6.5279, 1.1709): (3.0954, 3.1040, 3.1096),
        (6.2607, 1.1707): (3.3622, 3.3683),
        (6.4821, 1.2467): (3.1287, 3.1381),
        (6.3925, 1.2521): (3.2204, 3.2288),
        (5.8225, 1.1681): (3.7961, 3.8014),
        (5.8668, 1.2710): (3.7095, 3.7282, 3.7485),
        (5.7771, 1.2726): (3.7994, 3.8168, 3.8404),
        (5.6874, 1.2739): (3.8950, 3.9014, 3.9144, 3.9248),
    }
    cones = []
    for number, ((x_m, y_m), ranges_m) in enumerate(heard.items()):
        echoes = [(range_m, 0.45 / range_m) for range_m in ranges_m]
        cones.append(make_cone(*echoes, x_m=x_m, y_m=y_m, max_range_m=5.0, stamp_ns=100 + number))
    mirror = [*mirror_pings_at(), *mirror_pings_at(2.4)]
    (wall,) = mirrors_of([*mirror, *cones])
    assert wall.distance_m == pytest.approx(mirror_m, abs=0.01)
