"""Walls go on until they meet where many looked and nothing contradicts, and nowhere else."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from usmap_ros.mapping.joint.forward_model.log_odds import over_block
from usmap_ros.mapping.joint.free_space.meeting_walls import (
    UP_TO_CORNERS,
    Lookers,
    Surroundings,
    joined,
)
from usmap_ros.mapping.joint.kept_pings import KeptPings
from usmap_ros.mapping.joint.surfaces.lines import BEGIN, DISTANCE, END, drawn
from usmap_ros.mapping.joint.visibility.field import field_around
from usmap_ros.mapping.joint.visibility.ray_casting import RAYS, STEPS, WHOLE
from usmap_ros.mapping.ping_bins import UNJUDGED
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

RESOLUTION_M = 0.05
#: Robots at the origin look to the north-east; the corner is there, cells from them each way.
YAWS_RAD = np.deg2rad([25.0, 25.0, 45.0, 45.0, 65.0, 65.0])
CORNER = 30.0
#: Along the tangent (-ny, nx): a wall north of them that is missing from column 8 on, and one east
#: of them, from row 10 on.
NORTH = np.array([0.0, 1.0, CORNER, -8.0, 30.0])
EAST = np.array([1.0, 0.0, CORNER, -30.0, 10.0])


def lookers_of(cones: list[EchoCone]) -> Lookers:
    """Pings, among which nothing is yet."""
    kept = KeptPings(MappingParameters())
    for cone in cones:
        kept.add(cone, "robot")
    table, rows, *_ = kept.pings()
    left = np.full((len(rows), RAYS, STEPS), WHOLE, np.uint8)
    return Lookers(table, rows, field_around(table, rows, RESOLUTION_M), left)


@pytest.fixture
def cones(make_cone: Callable[..., EchoCone]) -> list[EchoCone]:
    return [make_cone(yaw_rad=yaw, stamp_ns=number) for number, yaw in enumerate(YAWS_RAD)]


@pytest.fixture
def lookers(cones: list[EchoCone]) -> Lookers:
    return lookers_of(cones)


def on_field(lines: list[NDArray[np.float64]], lookers: Lookers) -> NDArray[np.float64]:
    """Lines that are told from where robots are, from the field's first cell."""
    right, up = lookers.places()[0]
    moved = np.array(lines)
    moved[:, DISTANCE] += moved[:, 0] * right + moved[:, 1] * up
    moved[:, [BEGIN, END]] += (moved[:, 0] * up - moved[:, 1] * right)[:, np.newaxis]
    return moved


def added(
    lines: list[NDArray[np.float64]],
    lookers: Lookers,
    said: float = 0.0,
    stands: NDArray[np.bool_] | None = None,
) -> NDArray[np.float64]:
    """What lines gain, told as they are, where pings say the same of all cells."""
    before, shape = on_field(lines, lookers), lookers.field.shape
    shown = drawn(before, shape) | (np.zeros(shape, bool) if stands is None else stands)
    around = Surroundings(np.full(shape, said), over_block(shown), np.zeros(shape, bool))
    after = joined(before, around, lookers)
    assert np.array_equal(after[: len(lines)], before)
    gained, (right, up) = after[len(lines) :].copy(), lookers.places()[0]
    gained[:, DISTANCE] -= gained[:, 0] * right + gained[:, 1] * up
    gained[:, [BEGIN, END]] -= (gained[:, 0] * up - gained[:, 1] * right)[:, np.newaxis]
    return gained


def turned(line: NDArray[np.float64], angle_rad: float, about: complex) -> NDArray[np.float64]:
    """A line that has been turned about a place."""
    normal, turned_normal = complex(*line[:2]), complex(*line[:2]) * np.exp(1j * angle_rad)
    # Where the place is in the frame of the line, and in that of the turned one.
    moved = about * (np.conj(turned_normal) - np.conj(normal))
    place = np.add(line[2:], [moved.real, moved.imag, moved.imag])
    return np.array([turned_normal.real, turned_normal.imag, *place])


def test_two_walls_go_on_to_their_corner(lookers: Lookers) -> None:
    gained = added([NORTH, EAST], lookers)
    north, east = [*NORTH[:3], -CORNER, -8.0], [*EAST[:3], 10.0, CORNER]
    assert gained == pytest.approx(np.array([east, north]))


def test_what_is_missing_faces_as_the_walls_of_the_place_do(lookers: Lookers) -> None:
    """What was heard of a wall may be too short to tell how it faces."""
    short = EAST.copy()
    short[BEGIN] = 0.0
    askew = turned(short, 0.06, complex(CORNER, 5.0))
    north, east = [*NORTH[:3], -CORNER, -8.0], [*EAST[:3], 10.0, CORNER]
    assert added([NORTH, askew], lookers) == pytest.approx(np.array([east, north]), abs=1e-9)


def test_a_place_whose_walls_are_not_square_has_other_corners(lookers: Lookers) -> None:
    """Two sides of a hexagon with notches were drawn on to where they would have met."""
    aslant = turned(EAST, np.pi + np.deg2rad(20.0), 0j)
    assert not len(added([NORTH, EAST, aslant], lookers))
    aslant[BEGIN] = aslant[END] - 20.0
    assert len(added([NORTH, EAST, aslant], lookers)) == 2


def test_a_contradicted_corner_is_none(lookers: Lookers) -> None:
    assert not len(added([NORTH, EAST], lookers, said=-4.0))


def test_a_corner_that_nobody_looks_at_is_none(lookers: Lookers) -> None:
    lookers.left[:, :, STEPS // 4 :] = 0
    assert not len(added([NORTH, EAST], lookers))


def test_who_hears_the_first_thing_only_looks_no_farther(lookers: Lookers) -> None:
    """A maze of card board was drawn with corners that are cut out of it."""
    lookers.table.kind[:, lookers.table.kind.shape[1] // 4 :] = UNJUDGED
    assert not len(added([NORTH, EAST], lookers))


def test_walls_that_turn_their_backs_on_each_other_have_no_corner(lookers: Lookers) -> None:
    """Who looks does so from outside: a way leads round what the walls are of."""
    behind = EAST.copy()
    behind[[BEGIN, END]] = CORNER + 20.0, CORNER + 60.0
    assert not len(added([NORTH, behind], lookers))


def test_walls_that_are_not_square_have_others_between_them(lookers: Lookers) -> None:
    """Sides of a hexagon were drawn on, past a wall across its corner that few had heard."""
    up_to_corner = np.array([1.0, 0.0, CORNER, CORNER - 60.0, CORNER - 20.0])
    askew = turned(up_to_corner, np.deg2rad(25.0), complex(CORNER, CORNER))
    assert not len(added([NORTH, askew], lookers))


def test_a_corner_that_is_off_the_field_is_none(lookers: Lookers) -> None:
    edge, row = lookers.field.columns - 0.45, float(lookers.field.rows // 2)
    level = np.array([0.0, 1.0, row, -edge, -edge + 40.0])
    cosine, sine = np.cos(0.2), np.sin(0.2)
    end = sine * edge + cosine * (row - 4.0)
    leaning = np.array([cosine, -sine, cosine * edge - sine * (row - 4.0), end - 30.0, end])
    lines, shape = np.array([level, leaning]), lookers.field.shape
    nothing = np.zeros(shape, bool)
    after = joined(lines, Surroundings(np.zeros(shape), nothing, nothing), lookers)
    assert np.array_equal(after, lines)


def test_short_walls_do_not_say_where_their_corner_is(lookers: Lookers) -> None:
    short = EAST.copy()
    short[BEGIN] = 10.0 - (CORNER - 10.0) / UP_TO_CORNERS + 1.0
    assert not len(added([NORTH, short], lookers))


def with_thing(lookers: Lookers) -> NDArray[np.bool_]:
    """Something that stands where the wall north of robots would go on."""
    right, up = np.rint(lookers.places()[0]).astype(int)
    thing = np.zeros(lookers.field.shape, bool)
    thing[up + round(CORNER), right + 28] = True
    return thing


def test_a_wall_goes_on_to_what_stands(lookers: Lookers) -> None:
    gained = added([NORTH], lookers, stands=with_thing(lookers))
    assert gained == pytest.approx(np.array([[*NORTH[:3], -26.0, -8.0]]), abs=1.0)
    assert not len(added([NORTH], lookers))


def test_what_has_robots_on_either_side_goes_on_to_nothing(
    cones: list[EchoCone], make_cone: Callable[..., EchoCone]
) -> None:
    """Racks that stand in line were one, with no way between them."""
    behind = make_cone(y_m=2.5, yaw_rad=np.pi / 2.0, stamp_ns=len(cones))
    lookers = lookers_of([*cones, behind])
    assert not len(added([NORTH], lookers, stands=with_thing(lookers)))
