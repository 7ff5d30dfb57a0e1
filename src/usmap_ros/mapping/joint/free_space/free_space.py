"""Free space of an area, by what stands and by how its surfaces answer."""

import math

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.forward_model.cell_evidence import CellEvidence
from usmap_ros.mapping.joint.forward_model.log_odds import cell_log_odds, optical_depth
from usmap_ros.mapping.joint.forward_model.powers import Powers
from usmap_ros.mapping.joint.free_space.behind import behind_walls
from usmap_ros.mapping.joint.free_space.connected import led_to
from usmap_ros.mapping.joint.free_space.continuations import (
    ENDS,
    HARDLY,
    Said,
    continued,
    may_go_on,
    where_panes_may_be,
)
from usmap_ros.mapping.joint.free_space.heard_of_surfaces import HeardOfSurfaces
from usmap_ros.mapping.joint.free_space.kinds import GROUPS, MIRRORS, all_usual
from usmap_ros.mapping.joint.free_space.listening import listening_beside, scattering, trust
from usmap_ros.mapping.joint.free_space.meeting_walls import Lookers
from usmap_ros.mapping.joint.free_space.one_sided import surely_returned
from usmap_ros.mapping.joint.free_space.refutation import (
    OCCUPIED,
    Refutations,
    Refuting,
    beliefs,
)
from usmap_ros.mapping.joint.free_space.response import HeardBins
from usmap_ros.mapping.joint.free_space.rounds import Asked, free_now
from usmap_ros.mapping.joint.free_space.silence import Answers, learn_answers
from usmap_ros.mapping.joint.surfaces.smooth_surfaces import SmoothSurfaces
from usmap_ros.mapping.joint.surfaces.walls import Walls
from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.mapping.joint.visibility.open_ways import prove_open
from usmap_ros.mapping.joint.visibility.ray_casting import cast_all_rays, end_rays
from usmap_ros.mapping.ping_table import GREATEST_RANGE, PingTable, X, Y
from usmap_ros.numerics.arrays import BoolArray, FloatArray, over_last
from usmap_ros.numerics.special import running_maximum

#: Log-odds from which on a cell that is not shown is not free either.
SUSPECTED = -0.5
#: Rounds of free space, and opacity of what holds sound back.
FREE_ROUNDS, FREE_OPACITY = 4, 2.0
#: Up to so far beyond the last foot on a mirror, m, it holds sound back with such a belief, as long
#: as nothing there is free: it ends where robots turned round, and walls seldom do.
GOING_ON_M, GOING_ON = 4.0, 0.9
#: The same of what may be a pane: nobody knows where it ends.
PANES_GO_ON_M = 5.0


class FreeSpace:
    """What is free among walls, by pings.

    Parameters
    ----------
    table : PingTable
        Pings.
    pings : (pings,) integer array
        Rows of those that count.
    weights : (pings,) float32 array
        How much each counts.
    field : Field
        The cells.
    standing, stood : (rows, columns) bool arrays
        Cells that are known to be occupied from before, and where robots stood.
    proofs : float
        Pings whose sound must have come back through a cell, to prove that it is free.
    first_only : (pings,) bool array
        Pings of sensors that report the first thing only.

    Attributes
    ----------
    answers, heard : Answers, Refutations
        What `find` has learnt.
    """

    answers: Answers
    heard: Refutations

    def __init__(
        self,
        table: PingTable,
        pings: NDArray[np.int64],
        weights: NDArray[np.float32],
        field: Field,
        standing: BoolArray,
        stood: BoolArray,
        proofs: float,
        first_only: BoolArray,
    ) -> None:
        self._table, self._pings, self._weights, self._field = table, pings, weights, field
        self._standing, self._stood, self._proofs = standing, stood, proofs
        self._first_only = first_only

    def find(
        self, walls: Walls, smooth: SmoothSurfaces, powers: Powers, evidence: CellEvidence
    ) -> tuple[Walls, BoolArray]:
        """What stands, with what continues it, and cells that are free.

        Parameters
        ----------
        walls, smooth
            What stands.
        powers, evidence
            Of its cells.
        """
        field, occupied, hides = self._field, walls.shown, walls.shown | self._standing
        ended_m, trusted = smooth.ended_m(), trust(float(self._weights.sum()), walls)
        listening = self._listening(walls, smooth, powers, trusted)
        open_left = self._cast(np.where(hides, OCCUPIED, 0.0))
        # Tens of megabytes, which stay as they are where none ends.
        ends = np.isfinite(ended_m).any()
        left = self._ended(open_left.copy(), ended_m) if ends else open_left
        self.answers = answers = learn_answers(
            self._table, self._pings, field, left, listening, walls, smooth, evidence
        )._replace(trusted=trusted)
        heard = HeardOfSurfaces(
            self._table, self._pings, field, listening, answers, scattering(powers),
            left,
        )  # fmt: skip
        proofs = self._proven(occupied, left, powers, smooth, evidence, answers.one_sided)
        stood, wanted = self._stood & ~occupied, self._in_reach() & ~occupied
        belief = cell_log_odds(evidence, field.shape, powers.of_cells)
        closed = (belief > SUSPECTED) & ~occupied
        worst = np.zeros((*field.shape, GROUPS), np.float32)
        heard.renew(left, wanted | walls.bridged, worst)
        going_on = self._going_on(walls, smooth, heard, left, worst)
        alike = over_last(np.maximum, worst[:, :, :MIRRORS])
        worst[walls.bridged] = 0.0
        refuting = Refuting.by(answers, field, proofs, self._proofs)
        proven = (proofs >= self._proofs) & refuting.every(worst)
        # What continues walls is of their kind; who struck one may look at what continues it.
        walls, may_be = continued(
            walls, going_on, proven | stood, self._stood,
            Lookers(self._table, self._pings, field, open_left),
        )  # fmt: skip
        walls = walls.without(going_on.anyhow < HARDLY)
        panes = self._where_panes_may_be(smooth, walls.shown, proven | stood)
        closed |= smooth.suspected() | may_be | panes
        closed |= behind_walls(walls, evidence, field) & ~proven & (alike >= ENDS)
        cells = Asked(
            wanted & ~walls.shown, stood & ~walls.shown, proven, closed, panes,
            smooth.behind_unfound(),
        )  # fmt: skip
        free = self._freed(walls, smooth, heard, cells, refuting, worst, ended_m)
        self.heard = Refutations(worst, proofs, closed)
        return walls, led_to(free, cells.stood, proven, walls)

    def _freed(
        self,
        walls: Walls,
        smooth: SmoothSurfaces,
        heard: HeardOfSurfaces,
        cells: Asked,
        refuting: Refuting,
        worst: NDArray[np.float32],
        ended_m: FloatArray,
    ) -> BoolArray:
        """Cells that are free, in rounds: those that are not yet hold sound back.

        Parameters
        ----------
        walls, smooth
            What stands.
        heard, refuting
            What pings say of surfaces, and when that refutes them.
        cells : Asked
            That are asked for.
        worst : (rows, columns, GROUPS) float32 array
            By `refute_surfaces`; renewed.
        ended_m : (pings,) array
            As in `_left`.
        """
        wanted = cells.wanted
        for_good = refuting.by_silence() if smooth.mirrors else refuting
        free = np.zeros(self._field.shape, bool)
        for turn in range(FREE_ROUNDS):
            asked, before = cells._replace(wanted=wanted), free
            free = free_now(
                self._field, self.answers, walls, smooth.mirrors, asked, refuting, worst
            )
            if turn == FREE_ROUNDS - 1 or (turn and np.array_equal(free, before)):
                break
            # What was not refuted while all was open is not when less is.
            wanted = wanted & (free | cells.proven | cells.closed)
            held = self._held(walls, free, worst, self.answers, cells.panes)
            heard.renew_where_in_doubt(self._left(held, ended_m), wanted, worst, for_good.each)
        return free

    def more(
        self,
        walls: Walls,
        free: BoolArray,
        worst: NDArray[np.float32],
        smooth: SmoothSurfaces,
        powers: Powers,
        evidence: CellEvidence,
        answers: Answers,
    ) -> Refutations:
        """What these pings say of cells beside those that `answers` was learnt from.

        Parameters
        ----------
        walls, smooth
            What stands.
        free : (rows, columns) bool array
            Cells that were free before.
        worst : (rows, columns, GROUPS) float32 array
            What pings before said of the others, by `refute_surfaces`.
        powers, evidence
            Of what stands.
        answers : Answers
            What was learnt of the place.
        """
        hides = walls.shown | self._standing
        listening = self._listening(walls, smooth, powers, answers.trusted)
        ended_m = smooth.ended_m()
        left = self._left(np.where(hides, OCCUPIED, 0.0), ended_m)
        # How usual surfaces are has been counted with what was heard of them before.
        heard = HeardOfSurfaces(
            self._table, self._pings, self._field, listening, answers.by(all_usual),
            scattering(powers), left,
        )  # fmt: skip
        proofs = self._proven(walls.shown, left, powers, smooth, evidence, answers.one_sided)
        panes = self._where_panes_may_be(smooth, hides, free)
        left = self._left(self._held(walls, free, worst, answers, panes), ended_m)
        more = np.zeros_like(worst)
        wanted = ~free & ~walls.shown
        heard.renew(left, wanted, more)
        return Refutations(more, proofs, np.zeros(self._field.shape, bool))

    def _going_on(
        self,
        walls: Walls,
        smooth: SmoothSurfaces,
        heard: HeardOfSurfaces,
        left: NDArray[np.uint8],
        worst: NDArray[np.float32],
    ) -> Said:
        """What is said of surfaces that may continue walls."""
        if not (smooth.mirrors or smooth.mirrored):
            return Said(heard.of_lines(walls, left), {})
        usual_rad = float(self.answers.silences[0].kinds[0, 0])
        among = Said.among_mirrors(worst, usual_rad)
        if not smooth.mirrored:
            return among
        (inside, _), _ = self.answers.each(self._field)
        return among.within(inside, heard.of_lines(walls, left))

    def _where_panes_may_be(
        self, smooth: SmoothSurfaces, stands: BoolArray, is_open: BoolArray
    ) -> BoolArray:
        """Cells in which panes may be, or go on."""
        most_cells = PANES_GO_ON_M / self._field.resolution_m
        return where_panes_may_be(smooth.panes.lines(self._field), stands, is_open, most_cells)

    def _held(
        self,
        walls: Walls,
        free: BoolArray,
        worst: NDArray[np.float32],
        answers: Answers,
        panes: BoolArray,
    ) -> FloatArray:
        """Belief that each cell holds sound back, by what stands, is free, and was refuted."""
        hides = walls.shown | self._standing
        held = beliefs(hides, free, worst, answers.of_cells(self._field, "unknown"))
        most_cells = GOING_ON_M / self._field.resolution_m
        goes_on = may_go_on(walls.mirrors, hides, free, most_cells) | panes
        held[goes_on] = np.maximum(held[goes_on], GOING_ON)
        return held

    def _left(self, belief: FloatArray, ended_m: FloatArray) -> NDArray[np.uint8]:
        """How much of the sound is left along rays, by what may hold it back, and where it ends.

        Parameters
        ----------
        belief : (rows, columns) array
            That something stands in each cell.
        ended_m : (pings,) array
            Range beyond which hardly anything is left of each ping.
        """
        return self._ended(self._cast(belief), ended_m)

    def _cast(self, belief: FloatArray) -> NDArray[np.uint8]:
        """The same wherever it ends."""
        depth = optical_depth(belief, FREE_OPACITY)
        return cast_all_rays(self._table, self._pings, self._field, depth)

    def _ended(self, left: NDArray[np.uint8], ended_m: FloatArray) -> NDArray[np.uint8]:
        """What of it is left where it ends: the same array, changed."""
        end_rays(left, ended_m, self._table.numbers[self._pings, GREATEST_RANGE])
        return left

    def _in_reach(self) -> BoolArray:
        """Cells that a ping may reach, and some in the corners around."""
        numbers = self._table.numbers[self._pings]
        stood = self._field.cells_at(numbers[:, X], numbers[:, Y])
        width = 2 * math.ceil(numbers[:, GREATEST_RANGE].max() / self._field.resolution_m) + 1
        return running_maximum(running_maximum(stood, width).T, width).T

    def _listening(
        self, walls: Walls, smooth: SmoothSurfaces, powers: Powers, trusted: float
    ) -> HeardBins:
        numbers, step_m = self._table.numbers[self._pings], self._field.resolution_m
        return listening_beside(
            walls, smooth, powers, numbers, self._pings, self._first_only, step_m, trusted
        )

    def _proven(
        self,
        occupied: BoolArray,
        left: NDArray[np.uint8],
        powers: Powers,
        smooth: SmoothSurfaces,
        evidence: CellEvidence,
        one_sided: float,
    ) -> NDArray[np.float32]:
        """Pings whose sound is known to have passed each cell, as far as it is."""
        proven = np.zeros(self._field.shape, np.float32)
        believed = surely_returned(evidence, occupied, powers.of_cells, one_sided)
        prove_open(
            self._table, self._pings, self._field, left, powers.expected, believed, proven,
            self._weights,
        )  # fmt: skip
        smooth.places.trace_open(smooth.things, self._field, proven, self._weights)
        return proven
