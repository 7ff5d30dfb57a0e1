"""More pings of an area of which most is known: they alone are visited, not those before them.

What earlier pings said is kept as sums: of each quarter's power where it is likeliest and how
firmly they hold it there, of each cell the evidence, and how far a surface in it was refuted.  New
pings add to that; how the place answers, its lines and its smooth things are as they were, until
all pings are explained together again.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.area_state import AreaState, CellStates
from usmap_ros.mapping.joint.estimate import FIRST_DAMPING, STOOD_M, SWEEPS
from usmap_ros.mapping.joint.forward_model.log_odds import cell_log_odds, hiding, optical_depth
from usmap_ros.mapping.joint.forward_model.powers import Powers
from usmap_ros.mapping.joint.free_space.connected import connected
from usmap_ros.mapping.joint.free_space.free_space import SUSPECTED, FreeSpace
from usmap_ros.mapping.joint.free_space.refutation import Refutations, Refuting
from usmap_ros.mapping.joint.kept_pings import Pings
from usmap_ros.mapping.joint.surfaces.smooth_surfaces import SmoothSurfaces
from usmap_ros.mapping.joint.surfaces.walls import ON_A_LINE, Walls, find_walls
from usmap_ros.mapping.joint.visibility.field import field_around
from usmap_ros.mapping.ping_table import X, Y
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.compiled import compiled
from usmap_ros.parameters import MappingParameters

#: Log-likelihood ratios of surfaces are as good as certain from here on.
CERTAIN = -50.0


class MorePings:
    """Some pings beside those from which an area is known.

    Parameters
    ----------
    pings : Pings
        The new ones; those that smooth things explain are changed.
    parameters : MappingParameters
        Of the map.
    """

    def __init__(self, pings: Pings, parameters: MappingParameters) -> None:
        self._pings, self._parameters = pings, parameters
        self.field = field_around(pings.table, pings.rows, parameters.resolution_m)
        numbers = pings.table.numbers[pings.rows]
        self._stood = self.field.cells_within(numbers[:, X], numbers[:, Y], STOOD_M)

    def add_to(self, known: AreaState) -> AreaState:
        """What is known with these pings."""
        pings, parameters = self._pings, self._parameters
        known = known.reaching(self.field)
        before = known.part(self.field)
        smooth = SmoothSurfaces(pings.table, pings.rows, pings.echoes, self.field)
        smooth.recognise(known.smooth)
        powers = Powers(pings.table, pings.rows, pings.weights, self.field, known.limits)
        cells = self._explained(powers, before)
        walls = find_walls(
            cells.belief, cells.evidence, self.field, parameters.wall_gap_m, smooth, self._stood
        )
        stays = before.occupied & (cells.belief > ON_A_LINE) & ~self._stood
        walls = replace(
            walls, occupied=walls.occupied | stays,
            filled=walls.filled | (before.filled & ~self._stood),
        )  # fmt: skip
        space = FreeSpace(
            pings.table, pings.rows, pings.weights, self.field, before.standing, self._stood,
            parameters.proof_rays, pings.first_only,
        )  # fmt: skip
        more = space.more(
            walls, before.free, before.worst, smooth, powers, cells.evidence, known.answers
        )
        return known.with_part(self._freed(cells, walls, more, known), self.field)

    def _explained(self, powers: Powers, before: CellStates) -> CellStates:
        """What these pings say of powers and evidence, beside what was known."""
        shape, hides = self.field.shape, before.hiding
        powers.go_on(before.settled, self._stood)
        # Those before have settled most powers, and what hides them: one round is enough.
        powers.sweep(SWEEPS)
        powers.renew_shadows(optical_depth(hides, self._parameters.shadow_opacity))
        powers.sweep(SWEEPS)
        evidence = powers.weigh(self._parameters.forgetting, before=before.evidence)
        belief = hiding(evidence, shape, before.filled | before.standing)
        hides = (1.0 - FIRST_DAMPING) * hides + FIRST_DAMPING * belief
        settled = powers.settled
        said = {name: values.reshape(shape) for name, values in evidence._asdict().items()}
        return before._replace(
            power=settled.power.reshape(before.power.shape),
            firmness=settled.known.reshape(before.power.shape),
            hiding=hides, belief=cell_log_odds(evidence, shape, powers.of_cells), **said,
        )  # fmt: skip

    def _freed(
        self, cells: CellStates, walls: Walls, more: Refutations, known: AreaState
    ) -> CellStates:
        """Cells with what silence has freed."""
        answers, shown = known.answers, walls.shown
        worst, asked = cells.worst.copy(), ~cells.free & ~shown
        shape = np.broadcast_to(answers.of_cells(self.field, "shape"), shown.shape)
        add_overdispersed(worst, more.worst, shape, asked)
        proven = cells.proven + more.proven
        closed = cells.closed | ((cells.belief > SUSPECTED) & ~shown)
        refuting = Refuting.by(answers, self.field, proven, self._parameters.proof_rays)
        is_refuted = refuting.every(worst)
        free = ((cells.free | is_refuted) & ~closed & ~shown) | (self._stood & ~shown)
        is_open = (self._stood | cells.free | (proven >= refuting.enough_proofs)) & free
        return cells._replace(
            worst=worst, proven=proven, closed=closed, free=connected(free, is_open, shown),
            occupied=walls.occupied, filled=walls.filled,
        )  # fmt: skip


@compiled
def add_overdispersed(
    ratios: NDArray[np.float32], more: NDArray[np.float32], shape: FloatArray, asked: BoolArray
) -> None:
    """Log-likelihood ratios of surfaces by two groups of pings, as if all looked from one side.

    Silence from one side repeats itself, as
    `usmap_ros.mapping.joint.free_space.overdispersion` has it.

    Parameters
    ----------
    ratios, more : (rows, columns, GROUPS) float32 arrays
        By each of them; those of both replace the first.
    shape : (rows, columns) array
        How far looks from one side repeat each other.
    asked : (rows, columns) bool array
        Cells in which they are added.
    """
    for row in range(ratios.shape[0]):
        for column in range(ratios.shape[1]):
            if not asked[row, column]:
                continue
            for group in range(ratios.shape[2]):
                one, other = ratios[row, column, group], more[row, column, group]
                if other == 0.0:
                    continue
                silence, echoes = 0.0, 0.0
                for each in (one, other):
                    silence += math.expm1(-min(max(each, CERTAIN), 0.0) / shape[row, column])
                    echoes += max(each, 0.0)
                repeated = shape[row, column] * math.log1p(silence)
                ratios[row, column, group] = echoes - repeated
