"""Where walls go on: cells that continue a line, as far as pings say that they do or may.

Surfaces are seldom as short as what was heard well of them.  A cell that continues a line is wall
where more speaks for a surface there, however it faces, than against it; and so are all up to the
next thing if a wall that faces as the line does is hardly contradicted in them; and it is not free
unless it is refuted far more firmly than others are.
What continues a short line is never shown, for it does not say which way it goes on; nor what
continues one that is not square to most walls of the place, or any where they are not square to
each other: two thirds of that is wrong.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.forward_model.log_odds import over_block
from usmap_ros.mapping.joint.free_space.kinds import ACROSS, ALONG, MIRRORS
from usmap_ros.mapping.joint.free_space.meeting_walls import Lookers, Surroundings, joined
from usmap_ros.mapping.joint.surfaces.lines import (
    BEGIN,
    END,
    cells_beyond,
    crossings,
    drawn,
    facing_so,
    leading,
)
from usmap_ros.mapping.joint.surfaces.square_lines import squared
from usmap_ros.mapping.joint.surfaces.walls import Walls
from usmap_ros.numerics.arrays import BoolArray, FloatArray, over_last

#: Log-likelihood ratios of a surface: more speaks for it than against it; hardly anything
#: contradicts it; nothing goes on there, however it faces, or as the line does among mirrors, where
#: what is round is never refuted.
HEARD, HARDLY, ENDS, ENDS_SO = 0.01, -2.0, -5.0, -2.6
#: How far walls are followed beyond their ends, m.
FOLLOWED_M = 4.0
#: Lines cross if the cosine of the angle between them is less; they end where they meet another
#: one, or what continues it for so many cells; and if they have met another one so many cells
#: before.
CROSSING_COSINE, MEETING_CELLS, MET_CELLS = 0.9, 3.0, 8.0
#: What is shorter tells its direction too badly for cells beyond its ends to be shown: the tangent
#: of a column, or a short side of something, ends nowhere in particular.
FOLLOWED_CELLS = 15.0


class Said(NamedTuple):
    """What is said of surfaces that may continue walls: log-likelihood ratios."""

    #: (rows, columns) array: of any, however they face.
    anyhow: NDArray[np.float32]
    #: Arrays of the same shape: of walls that face so, by the direction, rad.
    facing: dict[float, NDArray[np.float32]]

    @classmethod
    def among_mirrors(cls, worst: NDArray[np.float32], usual_rad: float) -> "Said":
        """Where mirrors are, most of which face in a direction or across it.

        Parameters
        ----------
        worst : (rows, columns, GROUPS) float32 array
            By `usmap_ros.mapping.joint.free_space.open_space.refute_surfaces`.
        usual_rad : float
            The direction.
        """
        across_rad = usual_rad + 0.5 * np.pi
        facing = {usual_rad: worst[:, :, ALONG], across_rad: worst[:, :, ACROSS]}
        return cls(over_last(np.maximum, worst[:, :, :MIRRORS]), facing)

    def within(self, inside: BoolArray, others: NDArray[np.float32]) -> "Said":
        """The same in some cells, and something else of all surfaces in others."""
        facing = {so: np.where(inside, said, others) for so, said in self.facing.items()}
        return Said(np.where(inside, self.anyhow, others), facing)

    def beside(self, is_known: BoolArray) -> "Said":
        """What is said of each cell or of one beside it, but for what is known."""

        def unknown(said: NDArray[np.float32]) -> NDArray[np.float32]:
            return over_block(np.where(is_known, -np.inf, said))

        return Said(unknown(self.anyhow), {so: unknown(said) for so, said in self.facing.items()})

    def of(self, line: NDArray[np.float64]) -> tuple[NDArray[np.float32], float]:
        """What is said of surfaces that may continue a line, and below which nothing goes on."""
        for normal_rad, said in self.facing.items():
            if len(facing_so(line[np.newaxis], normal_rad)):
                return said, ENDS_SO
        return self.anyhow, ENDS


class Continuations(NamedTuple):
    """How lines go on."""

    #: (lines, 5) array: with what continues them, see `usmap_ros.mapping.joint.surfaces.lines`.
    lines: FloatArray
    #: (rows, columns) bool array: cells in which they may go on.
    may_be: BoolArray


def continue_lines(
    lines: FloatArray, occupied: BoolArray, beside: Said, most_cells: float
) -> Continuations:
    """Follow lines beyond their ends.

    Parameters
    ----------
    lines : (lines, 5) array
        Walls.
    occupied : (rows, columns) bool array
        What is known to stand.
    beside : Said
        Of each cell or of one beside it.
    most_cells : float
        How far they are followed.
    """
    longer, may_be, stands = lines.copy(), np.zeros_like(occupied), over_block(occupied)
    are_followed = lines[:, END] - lines[:, BEGIN] >= FOLLOWED_CELLS
    are_followed &= squared(lines).are_square
    for number, line in enumerate(lines):
        (of_line, ends), met = beside.of(line), _met(line, lines)
        for end, sign in ((BEGIN, -1.0), (END, 1.0)):
            ahead = sign * (met - line[end])
            first = ahead[ahead > -MET_CELLS].min(initial=most_cells)
            rows, columns = cells_beyond(line, line[end], sign, max(first, 0.0), occupied.shape)
            if len(rows) == 0:
                continue
            said, is_solid = of_line[rows, columns], stands[rows, columns]
            anyhow = beside.anyhow[rows, columns]
            # Beside the first there is the end itself.
            is_solid[0] = occupied[rows[0], columns[0]]
            is_solid[-1] |= first < most_cells
            if are_followed[number]:
                bridged = np.flatnonzero(is_solid[: leading(is_solid | (said >= HARDLY))])
                grown = int(bridged[-1]) + 1 if len(bridged) else 0
                grown += leading((is_solid | (anyhow > HEARD))[grown:])
                longer[number, end] += sign * grown
            open_end = leading(is_solid | (said >= ends))
            for row, column in zip(rows[:open_end], columns[:open_end], strict=True):
                may_be[max(0, row - 1) : row + 2, max(0, column - 1) : column + 2] = True
    return Continuations(_ending_at_corners(lines, longer), may_be & ~occupied)


def continued(
    walls: Walls,
    said: Said,
    is_open: BoolArray,
    stood: BoolArray,
    lookers: Lookers,
) -> tuple[Walls, BoolArray]:
    """Walls with what continues them, and cells that they may go on in.

    Parameters
    ----------
    walls : Walls
        What stands.
    said : Said
        Of each cell.
    is_open, stood : (rows, columns) bool arrays
        Cells that are known to be open, and where robots stood.
    lookers : Lookers
        Who looked there.
    """
    most_cells = FOLLOWED_M / lookers.field.resolution_m
    beside = said.beside(walls.shown | is_open)
    lines, may_be = continue_lines(walls.lines, walls.shown, beside, most_cells)
    _, more = continue_lines(walls.mirrors, walls.shown, beside, most_cells)
    walls = walls.through(lines, stood)
    beside = said.beside(walls.shown | is_open)
    around = Surroundings(beside.anyhow, over_block(walls.shown), is_open)
    return walls.through(joined(lines, around, lookers), stood), may_be | more


def _ending_at_corners(lines: FloatArray, longer: FloatArray) -> FloatArray:
    """Lines as far as they go on before they meet one another, or what continues it."""
    ended = longer.copy()
    for number, line in enumerate(lines):
        met = _met(line, longer)
        for end, sign in ((BEGIN, -1.0), (END, 1.0)):
            ahead = sign * (met - line[end])
            grown = sign * (longer[number, end] - line[end])
            first = ahead[ahead > 0.0].min(initial=grown)
            ended[number, end] = line[end] + sign * first
    return ended


def may_go_on(
    lines: FloatArray, stands: BoolArray, free: BoolArray, most_cells: float
) -> BoolArray:
    """Cells in which lines may go on, up to the first one beyond an end that is known.

    Parameters
    ----------
    lines : (lines, 5) array
        Walls.
    stands, free : (rows, columns) bool arrays
        What is known to stand, and to be free.
    most_cells : float
        How far they may.
    """
    may, is_known = np.zeros_like(free), stands | free
    for line in lines:
        for end, sign in ((BEGIN, -1.0), (END, 1.0)):
            rows, columns = cells_beyond(line, line[end], sign, most_cells, free.shape)
            if len(rows) == 0:
                continue
            ends = is_known[rows, columns]
            # The first may be that of the end itself.
            ends[0] = free[rows[0], columns[0]]
            count = leading(~ends)
            may[rows[:count], columns[:count]] = True
            # No ray gets through between cells that touch by their corners.
            may[rows[1:count], columns[: max(0, count - 1)]] = True
    return may & ~is_known


def where_panes_may_be(
    lines: FloatArray, stands: BoolArray, is_open: BoolArray, most_cells: float
) -> BoolArray:
    """Cells of lines that may be panes, which were struck here and there, and of what goes on.

    Parameters
    ----------
    lines : (lines, 5) array
        What may be panes.
    stands, is_open : (rows, columns) bool arrays
        What is known to stand, and to be open.
    most_cells : float
        How far they may go on.
    """
    along = drawn(lines, stands.shape) | may_go_on(lines, stands, is_open, most_cells)
    return over_block(along) & ~stands & ~is_open


def _met(line: NDArray[np.float64], lines: FloatArray) -> FloatArray:
    """Where along a line others cross it, that reach there or nearly so."""
    which, along, theirs = crossings(line, lines, CROSSING_COSINE)
    others = lines[which]
    reached = (theirs > others[:, BEGIN] - MEETING_CELLS) & (
        theirs < others[:, END] + MEETING_CELLS
    )
    met: FloatArray = along[reached]
    return met
