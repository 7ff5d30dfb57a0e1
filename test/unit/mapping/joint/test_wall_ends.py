"""How far smooth walls go on beyond where they were heard."""

import math
from collections.abc import Callable, Iterable

import numpy as np
import pytest

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.mapping.joint.kept_pings import KeptPings
from usmap_ros.mapping.joint.surfaces.mirror_walls import mirror_walls
from usmap_ros.mapping.joint.surfaces.mirrors import MirrorWall
from usmap_ros.mapping.joint.surfaces.wall_ends import WallEnds
from usmap_ros.mapping.joint.visibility.ray_casting import RAYS, STEPS, WHOLE
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

#: Of walls that face south and west, and where their corner is.
MIRROR, NORTH_M, EAST_M = 0.6, 3.0, 4.0
NORTH, EAST = 0.5 * math.pi, 0.0

Ping = Callable[..., EchoCone]


@pytest.fixture
def ping(make_cone: Callable[..., EchoCone]) -> Ping:
    """Give a function that makes what a robot hears that looks at the walls, or at nothing."""

    def ping_bins(x_m: float, y_m: float, yaw_rad: float, *, hears: bool = True) -> EchoCone:
        beam, echoes = BeamPattern.linear(), []
        for off_rad, across_m in ((NORTH - yaw_rad, NORTH_M - y_m), (EAST - yaw_rad, EAST_M - x_m)):
            if hears and abs(off_rad) < 0.6:
                loudness = MIRROR * float(beam.gain(off_rad)) / (2.0 * across_m)
                echoes.append((across_m, loudness))
        return make_cone(*echoes, x_m=x_m, y_m=y_m, yaw_rad=yaw_rad, stamp_ns=int(1e6 * x_m))

    return ping_bins


@pytest.fixture
def walking(ping: Ping) -> list[EchoCone]:
    """Give what robots hear below the northern wall's west, and beside the eastern wall's south."""
    north = [ping(0.05 * k, 1.5 + 0.1 * math.sin(k), NORTH + 0.2 * math.sin(k)) for k in range(20)]
    east = [ping(2.5 + 0.1 * math.sin(k), 0.05 * k, EAST + 0.2 * math.sin(k)) for k in range(20)]
    return north + east


def walls_of(cones: Iterable[EchoCone]) -> list[MirrorWall]:
    """Northern and eastern wall, each as far as it goes."""
    kept = KeptPings(MappingParameters())
    for number, cone in enumerate(cones):
        kept.add(cone, f"robot{number}")
    table, rows, _, echoes = kept.pings()[:4]
    explained = np.zeros(len(echoes.range_m), bool)
    found = mirror_walls(table, rows, echoes, explained, ~explained, np.zeros(len(rows), bool))
    left = np.full((len(rows), RAYS, STEPS), WHOLE, np.uint8)
    walls = WallEnds(table, rows, echoes, left, found, []).extended()
    return sorted(walls, key=lambda wall: -math.sin(wall.normal_rad))


def test_walls_go_on_to_their_corner(walking: list[EchoCone]) -> None:
    north, east = walls_of(walking)
    # Along the tangents (-1, 0) and (0, 1).
    assert -north.begin_m == pytest.approx(EAST_M, abs=0.05)
    assert east.end_m == pytest.approx(NORTH_M, abs=0.05)


def test_beyond_their_other_ends_nothing_is_added(walking: list[EchoCone]) -> None:
    north, east = walls_of(walking)
    assert -north.end_m == pytest.approx(0.0, abs=0.06)
    assert east.begin_m == pytest.approx(0.0, abs=0.06)


def test_no_wall_goes_on_where_a_robot_stood(walking: list[EchoCone], ping: Ping) -> None:
    north, east = walls_of([*walking, ping(2.5, NORTH_M, NORTH, hears=False)])
    assert -north.begin_m == pytest.approx(0.95, abs=0.06)
    assert east.end_m == pytest.approx(0.95, abs=0.06)


def test_silence_where_a_wall_would_have_been_struck_squarely_ends_it(
    walking: list[EchoCone], ping: Ping
) -> None:
    silent = [ping(2.0 + 0.2 * k, 2.0, NORTH, hears=False) for k in range(3)]
    north, _ = walls_of([*walking, *silent])
    assert -north.begin_m == pytest.approx(0.95, abs=0.06)


def test_stretches_of_one_wall_are_one(walking: list[EchoCone], ping: Ping) -> None:
    # Farther west along the northern wall, which was not heard in between.
    west = [ping(-2.0 - 0.05 * k, 1.5 + 0.1 * math.sin(k), NORTH) for k in range(20)]
    north = [wall for wall in walls_of([*walking, *west]) if abs(wall.distance_m - NORTH_M) < 0.1]
    eastern, western = sorted(north, key=lambda wall: wall.begin_m)
    assert eastern.end_m == pytest.approx(western.begin_m)


def test_a_faint_wall_is_believed_where_it_faces_as_others_do(
    walking: list[EchoCone], ping: Ping
) -> None:
    few = [ping(0.1 * k, 1.4, NORTH) for k in range(5)]
    east = [cone for cone in walking if cone.pose.position_m[0] > 2.0]
    assert len(walls_of([*east, *few])) == 2
    assert walls_of(few) == []


def test_sound_that_came_back_through_a_gap_keeps_it_open(
    walking: list[EchoCone], make_cone: Callable[..., EchoCone]
) -> None:
    # Another wall is heard behind the line of the eastern one.
    beyond = [
        make_cone((2.5, MIRROR / 5.0), x_m=3.0, y_m=1.6 + 0.05 * k, yaw_rad=EAST, stamp_ns=k)
        for k in range(20)
    ]
    walls = walls_of([*walking, *beyond])
    eastern = next(wall for wall in walls if abs(wall.distance_m - EAST_M) < 0.1)
    assert eastern.end_m < 1.5
