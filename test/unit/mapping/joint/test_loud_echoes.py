"""Echoes as loud as those of mirrors."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from usmap_ros.mapping.joint.kept_pings import KeptPings
from usmap_ros.mapping.joint.surfaces.loud_echoes import (
    A_WALL,
    FEW_ECHOES,
    HALF_WIDTH_M,
    MIRROR_SHARE,
    MOST_FOUND,
)
from usmap_ros.mapping.joint.surfaces.smooth_surfaces import SmoothSurfaces
from usmap_ros.mapping.joint.visibility.field import Field, field_around
from usmap_ros.mapping.joint.visibility.ray_casting import (
    BEHIND_ECHO_M,
    RAYS,
    STEPS,
    WHOLE,
    end_rays,
)
from usmap_ros.mapping.ping_table import GREATEST_RANGE, PingTable
from usmap_ros.numerics.arrays import BoolArray
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

MakeCone = Callable[..., EchoCone]
RESOLUTION_M = 0.05
#: Where nobody else looks east.
EAST = {"x_m": 3.0, "yaw_rad": 0.0}


def surfaces_of(cones: list[EchoCone]) -> tuple[SmoothSurfaces, PingTable, Field]:
    """Smooth things that are found in pings, their table, and the field."""
    kept = KeptPings(MappingParameters())
    for cone in cones:
        kept.add(cone, "robot")
    table, rows, _, echoes, first_only, _ = kept.pings()
    field = field_around(table, rows, RESOLUTION_M)
    smooth = SmoothSurfaces(table, rows, echoes, field)
    assert np.isinf(smooth.ended_m()).all()
    nothing = np.zeros(field.shape, np.float32)
    smooth.find(np.zeros(len(echoes.range_m), bool), [], first_only, nothing)
    return smooth, table, field


def test_what_returns_as_much_as_a_mirror_lets_nothing_through(
    make_cone: MakeCone, mirror_pings: list[EchoCone], mirror_m: float
) -> None:
    """A wall that is struck from one place, and so not found, beside one that is."""
    beside = [
        make_cone((0.8, 0.5), stamp_ns=100, **EAST),
        make_cone((0.8, 0.1), (1.9, 0.2), stamp_ns=101, **EAST),
    ]
    smooth, table, _ = surfaces_of([*mirror_pings, *beside])
    assert len(smooth.mirrors) == 1
    ended_m = smooth.ended_m()
    # The one that is found is known to no farther than it was struck.
    found_m = [mirror_m - cone.pose.position_m[1] for cone in mirror_pings]
    assert ended_m[:-2] == pytest.approx(found_m, abs=1e-6)
    assert ended_m[-2:] == pytest.approx([0.8, 1.9])
    left = np.full((len(ended_m), RAYS, STEPS), WHOLE, np.uint8)
    reach_m = table.numbers[: len(ended_m), GREATEST_RANGE]
    end_rays(left, ended_m, reach_m)
    reached_m = (left[-2:, 0] == WHOLE).mean(axis=1) * reach_m[-2:]
    assert reached_m == pytest.approx(ended_m[-2:] + BEHIND_ECHO_M, abs=0.03)


def test_where_much_is_heard_sound_goes_on_beside_what_is_known(
    make_cone: MakeCone, mirror_pings: list[EchoCone]
) -> None:
    """The face of a box hid what is beside it: a room that lost 15 % of its walls lost 21 %."""
    faint = [(1.0 + 0.05 * number, 0.02) for number in range(20)]
    beside = make_cone((0.8, 0.5), *faint, stamp_ns=100, **EAST)
    ended_m = surfaces_of([*mirror_pings, beside])[0].ended_m()
    assert np.isinf(ended_m[:-1]).all()
    assert ended_m[-1] == pytest.approx(0.8)


def test_what_is_struck_at_the_edge_of_the_beam_is_fainter(
    make_cone: MakeCone, mirror_pings: list[EchoCone]
) -> None:
    """Walls that faced as all others did were passed, for the beam hardly heard them: 8 m²."""
    faint = 0.8 * MIRROR_SHARE * 0.9 / (2.0 * 0.8)
    ended_m = []
    for off_rad in (0.0, 0.35, 0.8):
        cone = make_cone((0.8, faint), stamp_ns=100, x_m=3.0, yaw_rad=off_rad)
        ended_m.append(float(surfaces_of([*mirror_pings, cone])[0].ended_m()[-1]))
    assert ended_m == pytest.approx([0.8, 0.8, np.inf])


def behind_of(cones: list[EchoCone]) -> tuple[BoolArray, Callable[[float, float], Any]]:
    """Cells behind walls that were not found; and a function that tells whether a place is one."""
    smooth, _, field = surfaces_of(cones)
    behind = smooth.behind_unfound()
    return behind, lambda x_m, y_m: behind[field.cells_at(np.array([x_m]), np.array([y_m]))].item()


def struck_once(make_cone: MakeCone, *faint: tuple[float, float], yaw_rad: float = 0.0) -> Any:
    """What five robots hear of as many walls, each of one, and of what is fainter."""
    return [
        make_cone(
            (0.8, 0.5), *faint, stamp_ns=100 + number, x_m=3.0 + 0.17 * number**2,
            y_m=-0.3 * number, yaw_rad=yaw_rad,
        )
        for number in range(5)
    ]  # fmt: skip


def test_there_is_room_for_anything_behind_a_wall_that_was_struck_and_not_found(
    make_cone: MakeCone, mirror_pings: list[EchoCone]
) -> None:
    """Between walls that few echoes had shown, space outside was free for lack of room."""
    _, is_behind = behind_of([*mirror_pings, *struck_once(make_cone)])
    assert [is_behind(x_m, 0.0) for x_m in (2.0, 3.7, 3.85, 5.9)] == [False, False, True, True]
    beside_m = np.array([0.9, 1.1]) * HALF_WIDTH_M
    assert [is_behind(4.4, y_m) for y_m in beside_m] == [True, False]
    # What looks askew may be of anything; and where most is explained, so may be the rest.
    assert not behind_of([*mirror_pings, *struck_once(make_cone, yaw_rad=0.8)])[0].any()
    few = round((1.0 - MOST_FOUND) * len(mirror_pings))
    assert not behind_of([*mirror_pings, *struck_once(make_cone)[:few]])[0].any()
    # But three of one line are of a wall.
    beside = [make_cone((0.8, 0.5), stamp_ns=90 + n, y_m=0.1 * n, **EAST) for n in range(A_WALL)]
    _, is_behind = behind_of([*mirror_pings, *beside])
    assert is_behind(3.9, 0.0)
    assert not behind_of([*mirror_pings, *beside[1:]])[0].any()


def test_where_echoes_are_many_walls_that_are_there_were_found(
    make_cone: MakeCone, mirror_pings: list[EchoCone]
) -> None:
    count = len(mirror_pings) + 5
    for faint, is_few in ((FEW_ECHOES - 1.0 - 0.1, True), (FEW_ECHOES - 1.0 + 0.1, False)):
        more = [(1.0 + 0.05 * number, 0.02) for number in range(round(faint * count / 5))]
        behind, _ = behind_of([*mirror_pings, *struck_once(make_cone, *more)])
        assert behind.any() == is_few
