"""Walls go on as far as pings say so, and where they may go on nothing is free."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.ndimage import label

from usmap_ros.mapping.joint.forward_model.cell_evidence import no_evidence
from usmap_ros.mapping.joint.free_space.behind import (
    BEHIND_MIRRORS_M,
    behind,
    behind_alone,
    behind_walls,
)
from usmap_ros.mapping.joint.free_space.continuations import (
    ENDS,
    Continuations,
    Said,
    continue_lines,
    continued,
    may_go_on,
)
from usmap_ros.mapping.joint.free_space.kinds import ACROSS, ALONG, GROUPS
from usmap_ros.mapping.joint.free_space.meeting_walls import Lookers
from usmap_ros.mapping.joint.kept_pings import KeptPings
from usmap_ros.mapping.joint.surfaces.lines import BEGIN, DISTANCE, END, NO_LINES, drawn
from usmap_ros.mapping.joint.surfaces.walls import Walls
from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.mapping.joint.visibility.ray_casting import RAYS, STEPS
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

#: A wall along row 10 from column 10 to 30, and one along column 45: of the tangent (-ny, nx).
ALONG_ROW = np.array([0.0, 1.0, 10.0, -30.0, -10.0])
ALONG_COLUMN = np.array([1.0, 0.0, 45.0, 0.0, 18.0])
SHAPE = (20, 60)


def followed(lines: list[FloatArray], said: float) -> Continuations:
    """How lines go on where pings say the same of all cells but those that are known."""
    occupied = drawn(np.array(lines), SHAPE)
    least = np.where(occupied, -np.inf, said)
    return continue_lines(np.array(lines), occupied, Said(least, {}), 12.0)


def test_a_wall_goes_on_where_more_speaks_for_it() -> None:
    going = followed([ALONG_ROW], 0.5)
    assert going.lines[0, [BEGIN, END]] == pytest.approx([-42.0, 0.0])


def test_a_short_wall_does_not_say_where_it_goes_on() -> None:
    """But nothing is free where it may."""
    short = ALONG_ROW.copy()
    short[END] = -20.0
    going = followed([short], 0.5)
    assert going.lines[0] == pytest.approx(short)
    assert going.may_be[10, 31:43].all()


def test_walls_that_are_not_square_say_nothing_of_what_goes_on() -> None:
    """Sides of a hexagon with notches were drawn on past them; nothing is free there."""
    angle_rad = math.radians(60.0)
    aslant = np.array([math.cos(angle_rad), math.sin(angle_rad), 30.0, -25.0, -5.0])
    going = followed([ALONG_ROW, aslant], 0.5)
    assert going.lines == pytest.approx(np.array([ALONG_ROW, aslant]))
    assert going.may_be[10, 31:40].all()
    # Beside more that are square to each other it is askew, and they go on.
    aslant[END] = -9.5
    across = ALONG_COLUMN.copy()
    across[DISTANCE] = 55.0
    going = followed([ALONG_ROW, across, aslant], 0.5)
    assert going.lines[0, BEGIN] == pytest.approx(-42.0)
    assert going.lines[2] == pytest.approx(aslant)


def test_what_is_contradicted_is_no_wall_but_may_be_one() -> None:
    going = followed([ALONG_ROW], 0.5 * ENDS)
    assert going.lines[0] == pytest.approx(ALONG_ROW)
    assert going.may_be[10, 31:43].all()
    assert not going.may_be[10, 44:].any()


def test_what_is_refuted_firmly_may_be_no_wall() -> None:
    assert not followed([ALONG_ROW], 1.1 * ENDS).may_be.any()


def test_walls_that_go_on_to_a_corner_end_there() -> None:
    """Neither was heard near it, and both led through it: a box was drawn as a hash sign."""
    across = ALONG_COLUMN.copy()
    across[[DISTANCE, BEGIN, END]] = 36.0, -14.0, 1.0
    going = followed([ALONG_ROW, across], 0.5)
    assert going.lines[0, BEGIN] == pytest.approx(-36.0)
    assert going.lines[1, END] == pytest.approx(10.0)
    assert going.lines[0, END] == pytest.approx(0.0)


def test_a_wall_may_go_on_up_to_what_is_known() -> None:
    stands, free = drawn(ALONG_ROW[np.newaxis], SHAPE), np.zeros(SHAPE, bool)
    free[10, 35] = stands[10, 4] = True
    may = may_go_on(ALONG_ROW[np.newaxis], stands, free, 9.0)
    assert np.argwhere(may).tolist() == [[10, column] for column in (*range(5, 10), *range(31, 35))]
    free[10, 31] = True
    assert not may_go_on(ALONG_ROW[np.newaxis], stands, free, 9.0)[10, 31:].any()


def test_no_ray_passes_between_cells_in_which_a_wall_aslant_may_go_on() -> None:
    aslant = np.array([-math.sqrt(0.5), math.sqrt(0.5), 0.0, -8.0, -2.0])
    nothing = np.zeros(SHAPE, bool)
    may = may_go_on(aslant[np.newaxis], drawn(aslant[np.newaxis], SHAPE), nothing, 6.0)
    _, parts = label(may[6:, 6:])
    assert may[6:, 6:].sum() > 6
    assert parts == 1


@pytest.mark.parametrize("said", [0.5, -1.0])
def test_a_wall_ends_where_it_meets_another(said: float) -> None:
    """Be it heard up to there, or hardly contradicted."""
    across = ALONG_COLUMN.copy()
    across[2] = 36.0
    going = followed([ALONG_ROW, across], said)
    assert going.lines[0, BEGIN] == pytest.approx(-36.0)


def test_a_gap_that_is_contradicted_stays_open() -> None:
    behind = ALONG_ROW.copy()
    behind[[BEGIN, END]] = -50.0, -40.0
    assert followed([ALONG_ROW, behind], -1.0).lines[0, BEGIN] < -39.0
    assert followed([ALONG_ROW, behind], -3.0).lines[0, BEGIN] == pytest.approx(-30.0)


@pytest.mark.parametrize("is_mirror", [False, True])
def test_walls_go_on_as_far_where_there_are_mirrors(
    make_cone: Callable[..., EchoCone], *, is_mirror: bool
) -> None:
    """A mirror that was struck in part went no farther, and robots left where it goes on."""
    kept = KeptPings(MappingParameters())
    kept.add(make_cone(), "robot")
    table, rows, *_ = kept.pings()
    field, nothing = Field(0, 0, *SHAPE, 0.05), np.zeros(SHAPE, bool)
    lookers = Lookers(table, rows, field, np.zeros((len(rows), RAYS, STEPS), np.uint8))
    lines = np.array([ALONG_ROW])
    mirrors = lines + np.eye(5)[DISTANCE] * 6.0
    shown = drawn(np.concatenate([lines, mirrors]), SHAPE)
    walls = Walls(shown, nothing, nothing, lines, mirrors)
    said = np.full(SHAPE, -1.0 if is_mirror else 0.5, np.float32)
    walls, may_be = continued(walls, Said(said, {}), nothing, nothing, lookers)
    beyond = slice(32, 58)
    assert may_be[16 if is_mirror else 11, beyond].all()
    assert walls.filled[10, beyond].all() != is_mirror
    assert not walls.filled[16].any()


@pytest.mark.parametrize(("along", "may_be"), [(-1.0, True), (-3.0, False)])
def test_a_wall_among_mirrors_may_go_on_for_what_is_said_of_those_that_face_so(
    *, along: float, may_be: bool
) -> None:
    """Something round may stand anywhere, and half of a floor was behind where walls may go on."""
    worst = np.full((*SHAPE, GROUPS), -1.1, np.float32)
    worst[:, :, ALONG], worst[:, :, ACROSS] = along, -9.0
    said = Said.among_mirrors(worst, 0.5 * math.pi)
    lines = np.array([ALONG_ROW, ALONG_COLUMN])
    going = continue_lines(lines, drawn(lines, SHAPE), said, 12.0)
    assert going.may_be[10, 32] == may_be
    assert not going.may_be[19, 45]
    # What stands behind is the same wall where hardly anything contradicts one that faces so.
    behind = ALONG_ROW.copy()
    behind[[BEGIN, END]] = -50.0, -40.0
    lines = np.array([ALONG_ROW, behind])
    bridged = continue_lines(lines, drawn(lines, SHAPE), said, 12.0).lines[0, BEGIN] < -39.0
    assert bridged == may_be
    elsewhere = said.within(np.zeros(SHAPE, bool), np.full(SHAPE, -9.0, np.float32))
    of_line, ends = elsewhere.of(ALONG_ROW)
    assert not (of_line >= ends).any()


@pytest.mark.parametrize(("across", "goes_on"), [(0.5, True), (-0.5, False)])
def test_a_wall_among_mirrors_goes_on_where_anything_was_heard(
    *, across: float, goes_on: bool
) -> None:
    """What was heard there is most likely the wall, though it may face any way by itself."""
    worst = np.full((*SHAPE, GROUPS), -0.5, np.float32)
    worst[:, :, ACROSS] = across
    said = Said.among_mirrors(worst, 0.5 * math.pi)
    lines = np.array([ALONG_ROW])
    ends = continue_lines(lines, drawn(lines, SHAPE), said, 12.0).lines[0, [BEGIN, END]]
    assert ends == pytest.approx([-42.0, 0.0] if goes_on else [-30.0, -10.0])


@pytest.mark.parametrize(("towards_north", "solid_row"), [(8.0, 7), (-8.0, 13), (2.0, None)])
def test_behind_a_wall_is_what_lies_on_the_other_side(
    towards_north: float, solid_row: int | None
) -> None:
    """Ten echoes of each cell, heard from the north, from the south, or from both sides."""
    wall = drawn(ALONG_ROW[np.newaxis], SHAPE)
    heard, east, north = ((wall * each).astype(np.float32) for each in (10.0, 0.0, towards_north))
    mask = behind(ALONG_ROW[np.newaxis], heard, east, north, 5)
    rows = np.unique(np.nonzero(mask)[0]).tolist()
    assert rows == ([] if solid_row is None else list(range(solid_row - 2, solid_row + 3)))
    if solid_row is not None:
        assert mask[solid_row, 11:30].all()
        assert not mask[solid_row, [8, 32]].any()


def test_behind_a_mirror_its_other_side_may_be() -> None:
    """A robot was led into a wall between rooms, for it was thought to be as thin as a line."""
    shown, nothing = drawn(ALONG_ROW[np.newaxis], SHAPE), np.zeros(SHAPE, bool)
    walls = Walls(nothing, shown, nothing, NO_LINES, ALONG_ROW[np.newaxis])
    field = Field(5, -7, *SHAPE, 0.05)
    mask = behind_walls(walls, no_evidence(field), field)
    (row,) = np.unique(np.nonzero(shown)[0])
    # The normal points north, away from who heard it.
    assert np.unique(np.nonzero(mask)[0]).tolist() == [
        row + step for step in range(1, round(BEHIND_MIRRORS_M / 0.05) + 1)
    ]


@pytest.mark.parametrize(("towards_east", "solid_columns"), [(9.0, range(22, 30)), (3.0, [])])
def test_behind_what_stands_alone_there_is_a_disc_if_it_was_heard_from_one_side(
    towards_east: float, solid_columns: range | list[int]
) -> None:
    """Ten echoes of one cell, heard from the east, or from all around."""
    alone = np.zeros(SHAPE, bool)
    alone[10, 30] = True
    heard, east, north = ((alone * each).astype(np.float32) for each in (10.0, towards_east, 0.0))
    mask = behind_alone(alone, heard, east, north, Field(5, -7, *SHAPE, 0.1), 0.42)
    assert np.flatnonzero(mask[10] & ~alone[10]).tolist() == list(solid_columns)
    assert np.flatnonzero(mask[:, 26]).tolist() == (list(range(6, 15)) if solid_columns else [])
