"""What tells panes from lines by chance, and where they keep robots in."""

import math
from dataclasses import replace

import numpy as np
import pytest

from usmap_ros.mapping.joint.free_space.continuations import where_panes_may_be
from usmap_ros.mapping.joint.surfaces.lines import NO_LINES
from usmap_ros.mapping.joint.surfaces.mirrors import MirrorWall
from usmap_ros.mapping.joint.surfaces.panes import NO_LONE_LINES, Panes, told_of
from usmap_ros.mapping.joint.visibility.field import Field

HEARD = np.arange(12)
#: Of a line that faces as the walls of the place do.
PANE = MirrorWall(0.3, 2.0, 0.0, 2.0, HEARD, HEARD, 0.2, 0.0, -0.5, 0.2, 20.0)
NONE = np.zeros(12, bool)


@pytest.mark.parametrize("chance", [{"following": 4.0}, {"over_point": -9.0}, {"normal_rad": 0.5}])
def test_a_line_of_lone_echoes_as_chance_has_it_is_hardly_a_pane(chance: dict[str, float]) -> None:
    likely = told_of([PANE], NONE).likely(0.3).sum()
    assert likely > 0.5
    assert told_of([replace(PANE, **chance)], NONE).likely(0.3).sum() < likely - 0.1
    assert told_of([PANE], ~NONE).likely(0.3).sum() < likely - 0.1
    assert told_of([PANE, PANE], NONE).likely(0.3).sum() == pytest.approx(2.0 * likely)


def test_a_pane_is_parallel_or_square_to_walls() -> None:
    panes = told_of([PANE], NONE)
    assert panes.likely(0.3 - 0.5 * math.pi).sum() == panes.likely(0.3).sum()
    assert panes.likely(0.6).sum() == panes.likely(None).sum() < panes.likely(0.3).sum() - 0.1


def test_without_lines_no_pane_is_expected() -> None:
    assert (
        NO_LONE_LINES.likely(0.0).sum() == told_of([], np.zeros(0, bool)).likely(0.0).sum() == 0.0
    )


#: A wall of a square room, as long as 100 cells, and the field that it is on.
WALL, FIELD = np.array([[1.0, 0.0, 5.0, 0.0, 100.0]]), Field(0, 0, 60, 120, 0.05)


def test_panes_are_expected_and_suspected_once_it_is_known_how_walls_face() -> None:
    panes = Panes(told_of([replace(PANE, normal_rad=0.5 * math.pi)], NONE))
    assert panes.expected == 0.0
    assert len(panes.lines(FIELD)) == 0
    panes.face(WALL)
    assert panes.expected > 0.5
    (line,) = panes.lines(FIELD)
    assert line[:2] == pytest.approx([0.0, 1.0])
    panes.face(NO_LINES)
    assert panes.expected < 0.5
    assert len(panes.lines(FIELD)) == 0


def test_nothing_is_free_along_a_pane_as_far_as_it_may_go_on() -> None:
    shape = (60, 120)
    pane, posts = np.array([[0.0, 1.0, 30.0, -60.0, -40.0]]), np.zeros(shape, bool)
    posts[25:36, 10] = posts[25:36, 90] = True
    open_cells = np.zeros(shape, bool)
    open_cells[:, 30:33] = True
    closed = where_panes_may_be(pane, posts, np.zeros(shape, bool), 50.0)
    assert closed[29:32, 11:90].all()
    # No farther than up to what stands, nor where it is open; and nothing else.
    assert not closed[:, :10].any()
    assert not closed[:28].any()
    assert not closed[33:].any()
    closed = where_panes_may_be(pane, posts, open_cells, 50.0)
    assert not closed[:, :32].any()
    assert closed[29:32, 33:90].all()
    assert not where_panes_may_be(NO_LINES, posts, open_cells, 50.0).any()
