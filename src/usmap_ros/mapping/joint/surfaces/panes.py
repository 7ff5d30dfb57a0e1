"""Panes of glass among bricks: lines of echoes that nothing is beside, some of which are mirrors.

Bricks return so much that mirrors beside them are too faint to be any, and chance lines up some of
what is heard alone.  What is a pane is told by how it faces, for most are parallel or square to the
walls of their place, by what follows its echoes, and by whether points or cells explain them.  The
weights are those of a logistic regression over 184 simulated recordings, rooms with panes of seeds
1000 to 1019 among them; `benchmarks/mirror_odds.py --panes` fits others to fewer, and judges both.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.surfaces.mirror_criteria import ANY, fitted
from usmap_ros.mapping.joint.surfaces.mirror_fits import MirrorSearch
from usmap_ros.mapping.joint.surfaces.mirror_walls import found_mirrors, left_of, mirror_search
from usmap_ros.mapping.joint.surfaces.mirrors import (
    MirrorWall,
    on_field,
    turns_to,
    without_doubles,
)
from usmap_ros.mapping.joint.surfaces.square_lines import square_direction
from usmap_ros.mapping.joint.visibility.echoes import Echoes, count_between
from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.mapping.ping_table import PingTable
from usmap_ros.numerics.arrays import BoolArray, FloatArray

#: Amplitude reflectivity that a pane has at the least, over what the loudest lone echo of one ping
#: in ten means, which may be a corner's.
FAINT_MIRROR = 0.1
#: Widest gap between feet on a pane, m: where bricks are beside it, its echoes do not stand alone.
#: One that was found so may go on beyond wider ones: robots strike a long pane here and there.
PANE_GAP_M, ALONG_M = 1.2, 3.0
#: Echoes of a ping that are so near to each other, m, are of one rough wall; of how many, itself
#: included, one may still be a pane's.
BESIDE_M, MOST_BESIDE = 0.3, 3
#: Weights of what `LoneLines.facing` gives, and log-odds of a pane before a line was looked at.
PANE_WEIGHTS, PANE_BEFORE = (-4.9, -4.0, 1.3, -2.0, 4.0), -2.5
#: A line faces as most walls do if it is off by no more than this, rad: panes are, mostly by less
#: than one degree, and chance lines up echoes in any direction.
FACING_RAD = math.radians(2.5)
#: Lines that are panes with more than this probability are not passed.
SUSPECTED = 0.15
#: By how much a point may explain all echoes of such a line better or worse.
MOST_OVER = 20.0


class LoneLines(NamedTuple):
    """Lines of lone echoes in a place that seems to have no mirrors."""

    lines: Sequence[MirrorWall]
    #: (lines, signs) array: what tells panes from chance, but for how they face.
    signs: FloatArray

    def likely(self, usual_rad: float | None) -> FloatArray:
        """(lines,) array: how likely each is a mirror.

        Parameters
        ----------
        usual_rad : float, optional
            Direction that the walls of the place are parallel or square to, if most are.
        """
        odds = self.facing(usual_rad) @ PANE_WEIGHTS
        likely: FloatArray = 1.0 / (1.0 + np.exp(-odds - PANE_BEFORE))
        return likely

    def facing(self, usual_rad: float | None) -> FloatArray:
        """What tells panes from chance, with how they face: (lines, signs + 1) array."""
        face_usually = np.zeros(len(self.signs))
        if usual_rad is not None:
            normals_rad = np.array([line.normal_rad for line in self.lines])
            face_usually[np.abs(turns_to(usual_rad, normals_rad)) <= FACING_RAD] = 1.0
        return np.column_stack([self.signs, face_usually])


#: Where there is no such line.
NO_LONE_LINES = LoneLines([], np.zeros((0, len(PANE_WEIGHTS) - 1)))


def told_of(lines: Sequence[MirrorWall], is_explained: BoolArray) -> LoneLines:
    """What lines of lone echoes tell, each by itself, of whether they are panes.

    Parameters
    ----------
    lines : sequence of MirrorWall
        The lines.
    is_explained : (echoes,) bool array
        Whether reliable cells explain an echo.
    """
    signs = [
        (
            1.0, float(is_explained[line.echoes].mean()),
            math.copysign(math.sqrt(min(abs(line.over_point), MOST_OVER)), line.over_point),
            math.log1p(line.following),
        )
        for line in lines
    ]  # fmt: skip
    return LoneLines(lines, np.array(signs).reshape(-1, len(PANE_WEIGHTS) - 1))


class Panes:
    """What may be panes, once it is known how the walls of their place face.

    Parameters
    ----------
    among : LoneLines
        The lines that may be.
    """

    def __init__(self, among: LoneLines = NO_LONE_LINES) -> None:
        self._among = among
        #: How many there are: most walls answer from any side where no mirror was found.
        self.expected = 0.0
        self._suspected: list[MirrorWall] = []

    def face(self, lines: FloatArray) -> None:
        """Tell them from chance.

        Parameters
        ----------
        lines : (lines, 5) array
            Walls that answer from any side, see `usmap_ros.mapping.joint.surfaces.lines`.
        """
        likely = self._among.likely(square_direction(lines))
        self.expected = float(likely.sum())
        pairs = zip(self._among.lines, likely, strict=True)
        self._suspected = [line for line, is_pane in pairs if is_pane > SUSPECTED]

    def lines(self, field: Field) -> FloatArray:
        """Those that are suspected, as (panes, 5) lines."""
        return on_field(self._suspected, field)


def lone_lines(
    table: PingTable,
    pings: NDArray[np.int64],
    echoes: Echoes,
    is_explained: BoolArray,
    is_usable: BoolArray,
    first_only: BoolArray,
) -> LoneLines:
    """Lines of lone echoes, which may be mirrors in a place that seems to have none.

    One pane of glass in a room of brick is faint beside the bricks, which return so many echoes
    that chance lines them up anyhow.  A pane returns one echo with nothing beside it, and cells
    explain only what few places hear of it.

    Parameters
    ----------
    table, pings, echoes, is_explained, is_usable, first_only
        As in `usmap_ros.mapping.joint.surfaces.mirror_walls.mirror_walls`.
    """
    is_open = is_usable & _are_lone(echoes)
    search = mirror_search(table, pings, echoes, is_open, first_only, FAINT_MIRROR)
    search = search._replace(gap_m=PANE_GAP_M)
    lines = without_doubles(found_mirrors(search, ANY))
    return told_of(_followed(lines, search._replace(gap_m=ALONG_M)), is_explained)


def _followed(lines: list[MirrorWall], search: MirrorSearch) -> list[MirrorWall]:
    """Lines with what else was heard along them, over wider gaps."""
    is_open, followed = left_of(search.is_open, lines), list[MirrorWall]()
    search = search._replace(is_open=is_open)
    for line in lines:
        is_open[line.echoes] = True
        followed.append(fitted(search, ANY, line.normal_rad, line.distance_m) or line)
        is_open[line.echoes] = False
        is_open[followed[-1].echoes] = False
    return followed


def _are_lone(echoes: Echoes) -> BoolArray:
    """Whether each echo has hardly any other of its ping beside it."""
    pings = np.repeat(np.arange(len(echoes.start) - 1), np.diff(echoes.start))
    beside = count_between(echoes, pings, echoes.range_m - BESIDE_M, echoes.range_m + BESIDE_M)
    are_lone: BoolArray = beside <= MOST_BESIDE
    return are_lone
