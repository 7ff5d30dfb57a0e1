"""The joint estimate of an area: powers, walls, and free space from all of its pings.

powers    ← multiplicative updates until they explain every echo and every silence
belief    ← how much worse the pings would be explained without each cell
walls     ← mirrors for echoes that no reliable cell explains, lines through believed cells
shadows   ← rays end at what is believed; and all of it again
response  ← how believed surfaces answer, by loudness and angle of incidence
free      ← where every way in which a surface could face is refuted, or sound came back through
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.area_state import AreaState, CellStates
from usmap_ros.mapping.joint.forward_model.cell_evidence import CellEvidence, no_evidence
from usmap_ros.mapping.joint.forward_model.log_odds import (
    cell_log_odds,
    hiding,
    may_hide,
    optical_depth,
)
from usmap_ros.mapping.joint.forward_model.power_estimation import power_limits
from usmap_ros.mapping.joint.forward_model.powers import Powers
from usmap_ros.mapping.joint.forward_model.weighed_pings import WeighedPings
from usmap_ros.mapping.joint.free_space.free_space import FreeSpace
from usmap_ros.mapping.joint.key_pings import key_pings
from usmap_ros.mapping.joint.looks import Looks
from usmap_ros.mapping.joint.surfaces.lone_columns import lone_cells
from usmap_ros.mapping.joint.surfaces.parts import any_holds
from usmap_ros.mapping.joint.surfaces.smooth_surfaces import SmoothSurfaces
from usmap_ros.mapping.joint.surfaces.walls import Walls, find_walls
from usmap_ros.mapping.joint.visibility.echoes import Echoes
from usmap_ros.mapping.joint.visibility.field import QUARTERS, Field
from usmap_ros.mapping.joint.witnesses import (
    HALVES,
    LEAST_WITNESSES,
    MutualEvidence,
    agreed_on,
    credit,
    halves_of,
    mostly_there,
    mutual_evidence,
)
from usmap_ros.mapping.ping_table import NOISE, PingTable, X, Y
from usmap_ros.numerics.arrays import BoolArray, FloatArray

#: Sweeps before anything hides anything, after each of which what has no power goes; rounds of
#: shadows and sweeps, and sweeps in each.
FIRST_SWEEPS, ROUNDS, SWEEPS = (4, 4, 5), 6, 4
#: Key pings settle what hides what if they are such a share of all at the most; then so many rounds
#: of all pings let go what only few of them spoke for.
MOST_KEY_SHARE, ALL_ROUNDS = 0.4, 2
#: Rounds in which walls are found, and rounds of shadows in each.
WALL_ROUNDS, WALL_SHADOWS = 2, 2
#: Share of a belief in what hides that a round takes over: first, and with walls.
FIRST_DAMPING, WALL_DAMPING = 0.6, 0.7
#: Change of what hides, as a share of it, at which it has settled.
SETTLED = 0.04
#: Log-odds, without powers, from which on a cell is reliable, and the share of an echo that it then
#: explains.
RELIABLE, EXPLAINED_SHARE = 2.05, 0.5
#: Within this distance of where a robot stood nothing else stands.
STOOD_M = 0.12


class JointEstimate:
    """All that some pings say together.

    Parameters
    ----------
    table : PingTable
        Pings; `kind` is changed where mirrors explain echoes.
    pings : (pings,) integer array
        Rows of those that count, in the order of their stamps.
    weights : (pings,) float32 array
        How much each counts.
    echoes : Echoes
        Their echoes.
    field : Field
        The cells.
    opacity : float
        Optical depth of a cell, over -ln(1 - p).
    forgetting : float
        Share of what speaks for a cell that is forgotten with a ping that contradicts it.
    standing : (rows, columns) bool array, optional
        Cells that are known to be occupied from before.
    gap_m : float
        Widest gap in a run of believed cells that counts as wall; 0: nothing is filled.
    proofs : float
        Pings whose sound must have come back through a cell, to prove that it is free.
    first_only : (pings,) bool array, optional
        Pings of sensors that report the first thing only.
    """

    def __init__(  # noqa: PLR0913, PLR0917 - all that an estimate is made from
        self,
        table: PingTable,
        pings: NDArray[np.int64],
        weights: NDArray[np.float32],
        echoes: Echoes,
        field: Field,
        opacity: float = 1.0,
        forgetting: float = 0.0,
        standing: BoolArray | None = None,
        gap_m: float = 0.5,
        proofs: float = 3.0,
        first_only: BoolArray | None = None,
    ) -> None:
        self.table, self.pings, self.weights = table, pings, weights
        self.field, self._opacity, self._forgetting = field, opacity, forgetting
        self._gap_m, self._proofs = gap_m, proofs
        self._first_only = np.zeros(len(pings), bool) if first_only is None else first_only
        self._standing = np.zeros(field.shape, bool) if standing is None else standing
        self._powers = Powers(table, pings, weights, field, power_limits(table, pings))
        numbers = table.numbers[pings]
        self._stood = field.cells_within(numbers[:, X], numbers[:, Y], STOOD_M)
        self.evidence: CellEvidence = no_evidence(field)
        self.depth = np.zeros(field.shape, np.float32)
        self._hiding: FloatArray = np.zeros(field.shape)
        self._no_walls = np.zeros(field.shape, bool)
        self._smooth = SmoothSurfaces(table, pings, echoes, field)

    # ------------------------------------------------------------------ powers and belief

    def estimate_walls(self) -> Walls:
        """Find walls, and beliefs with them, after powers."""
        # What mirrors return tells nothing of what cells scatter: powers count once they are known.
        log_odds = cell_log_odds(self.evidence, self.field.shape)
        is_reliable = log_odds > RELIABLE
        alone = lone_cells(is_reliable, log_odds, self.field)
        self._smooth.find(self._explained(is_reliable), alone, self._first_only, self.depth)
        self._smooth.take_out()
        for turn in range(WALL_ROUNDS):
            filled, is_last = self.walls().filled, turn == WALL_ROUNDS - 1
            self._cast_shadows(self._powers, filled, WALL_DAMPING, WALL_SHADOWS, is_last)
        walls = self.walls()
        return self.walls() if self._smooth.doubt_columns_on(walls.lines) else walls

    def estimate_powers(self, rounds: int) -> None:
        """Find powers and beliefs.

        Parameters
        ----------
        rounds : int
            Of shadows.
        """
        # One range says too little for looks of others to stand in for its own.
        looks = np.where(self._first_only, np.float32(0.0), self.weights)
        key = key_pings(self.table, self.pings, looks)
        if len(key) > MOST_KEY_SHARE * len(self.pings):
            self._settle(self._powers, rounds)
            return
        limits = self._powers.limits
        few = Powers(self.table, self.pings[key], self.weights[key], self.field, limits)
        self._settle(few, rounds)
        self._powers.take_up(few)
        self._powers.renew_shadows(self.depth)
        self._powers.sweep(SWEEPS)
        # What hides what is as the few have it, until all are weighed.
        self._cast_shadows(self._powers, self._no_walls, FIRST_DAMPING, ALL_ROUNDS)

    def _settle(self, powers: Powers, rounds: int) -> None:
        """Find powers by some pings, or all, and beliefs with them; as in `estimate_powers`."""
        powers.start()
        for sweeps in FIRST_SWEEPS:
            powers.sweep(sweeps)
            powers.renew_shadows(self.depth)
        self._weigh(powers)
        self._cast_shadows(powers, self._no_walls, FIRST_DAMPING, rounds)

    @property
    def weighed(self) -> WeighedPings:
        """What each ping says of the cells."""
        return self._powers.weighed

    def credit(self, sources: Sequence[str]) -> dict[str, float]:
        """How much of the trust in each source is left, by what all say of the cells."""
        names = sorted(set(sources))
        if len(names) < LEAST_WITNESSES:
            return dict.fromkeys(names, 1.0)
        weighed, half, count = self.weighed, halves_of(sources, names), HALVES * len(names)
        known = self._smooth.recognised
        agreed = agreed_on([*known.mirrors, *known.columns], half, len(names))
        places_m, mirrored = self.table.numbers[self.pings][:, [X, Y]], known.mirrored
        part = half
        if mirrored:
            # Who stands among mirrors denies what is behind them: that is no contradiction.
            part = half + count * mostly_there(half // HALVES, any_holds(mirrored, places_m))
        apart = weighed.evidence_of_parts(part, count * (2 if mirrored else 1))
        columns = [*known.columns, *known.suspected]
        said = [
            mutual_evidence(weighed.number, apart[first : first + count], self.field, columns)
            for first in range(0, len(apart), count)
        ]
        of_cells, contradicted = np.sum(said, axis=0)
        if known.mirrors:
            # What they hear aslant of mirrors is what stands behind them, or elsewhere.
            counts = np.bincount(half // HALVES, ~self._first_only, len(names)) > 0.0
            contradicted *= np.logical_and.outer(counts, counts)
        left = credit(MutualEvidence(of_cells + agreed, contradicted))
        return dict(zip(names, left, strict=True))

    @property
    def power(self) -> NDArray[np.float32]:
        """Powers of the quarters of all cells."""
        return self._powers.power

    def belief(self) -> FloatArray:
        """Log-odds that each cell holds or touches a surface, (rows, columns)."""
        return cell_log_odds(self.evidence, self.field.shape, self._powers.of_cells)

    @property
    def expected(self) -> NDArray[np.float32]:
        """λ of each range bin of each ping."""
        return self._powers.expected

    def _weigh(self, powers: Powers, are_all: bool = True) -> None:
        """Gather the evidence of all cells, or anew of those alone that may hide or may not."""
        if are_all:
            self.evidence = powers.weigh(self._forgetting)
            return
        in_doubt = may_hide(self.evidence)
        more = powers.weigh(self._forgetting, are_asked=in_doubt)
        for known, values in zip(self.evidence, more, strict=True):
            np.copyto(known, values, where=in_doubt)

    def _cast_shadows(
        self,
        powers: Powers,
        walls: BoolArray,
        damping: float,
        rounds: int,
        weighs_all: bool = True,
    ) -> None:
        """Renew what hides what by the evidence, then powers, then the evidence, until it settles.

        Parameters
        ----------
        powers : Powers
            By the pings that tell.
        walls : (rows, columns) bool array
            Cells on lines.
        damping : float
            Share of a belief that a round takes over.
        rounds : int
            At the most.
        weighs_all : bool
            Whether the evidence of all cells is renewed in the last one.
        """
        for turn in range(rounds):
            before = self._hiding
            belief = hiding(self.evidence, self.field.shape, walls | self._standing)
            self._hiding = (1.0 - damping) * before + damping * belief
            self.depth = optical_depth(self._hiding, self._opacity)
            powers.renew_shadows(self.depth)
            powers.sweep(SWEEPS)
            has_settled = np.abs(self._hiding - before).sum() <= SETTLED * self._hiding.sum()
            is_last = has_settled or turn == rounds - 1
            # By key pings alone nothing but what hides is told.
            if not is_last or powers is self._powers:
                # What nothing was in the way of before may be behind something now.
                self._weigh(powers, are_all=(is_last and weighs_all) or not before.any())
            if is_last:
                break

    # ------------------------------------------------------------------ walls

    def _explained(self, cells: BoolArray) -> BoolArray:
        """Whether some cells explain each echo."""
        expected = self._powers.expected_of(cells.ravel())
        places = self._smooth.places
        index, bins, rows = places.ping, places.bin, self.pings[places.ping]
        noise = self.table.numbers[rows, NOISE]
        share = (expected[index, bins] - noise) / np.maximum(self.table.power[rows, bins], 1e-12)
        explained: BoolArray = places.inside & (share > EXPLAINED_SHARE)
        return explained

    def walls(self) -> Walls:
        """Cells that are shown, and lines through them, by today's evidence."""
        return find_walls(
            self.belief(), self.evidence, self.field, self._gap_m, self._smooth, self._stood
        )

    def free_space(self, walls: Walls) -> tuple[Walls, BoolArray]:
        """What stands, with what continues it, and cells that are free.

        Parameters
        ----------
        walls : Walls
            What stands.
        """
        space = FreeSpace(
            self.table, self.pings, self.weights, self.field, self._standing, self._stood,
            self._proofs, self._first_only,
        )  # fmt: skip
        self._smooth.panes.face(walls.all_lines)
        walls, free = space.find(walls, self._smooth, self._powers, self.evidence)
        self.heard, self.answers = space.heard, space.answers
        return walls, free

    def known(
        self, walls: Walls, free: BoolArray, belief: FloatArray, credit: Mapping[str, float]
    ) -> AreaState:
        """What is known after `free_space`, for more pings to be explained beside these.

        Parameters
        ----------
        walls, free
            As they are shown.
        belief : (rows, columns) array
            Log-odds that each cell holds or touches a surface.
        credit : mapping of str to float
            By `credit`.
        """
        settled, shape = self._powers.settled, self.field.shape
        said: dict[str, Any] = {
            name: values.reshape(shape) for name, values in self.evidence._asdict().items()
        }
        cells = CellStates(
            power=settled.power.reshape(*shape, QUARTERS),
            firmness=settled.known.reshape(*shape, QUARTERS),
            **said, hiding=self._hiding, **self.heard._asdict(), free=free,
            occupied=walls.occupied, filled=walls.filled, standing=self._standing, belief=belief,
        )  # fmt: skip
        numbers = self.table.numbers[self.pings]
        return AreaState(
            self.field, cells, self._smooth.recognised, self._powers.limits, self.answers, credit,
            Looks.of_none(numbers).of_all(numbers, self.weights),
        )  # fmt: skip
