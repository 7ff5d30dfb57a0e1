"""What explains some pings together, area by area."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from usmap_ros.grids import OccupancyMap
from usmap_ros.mapping.extent import check_size
from usmap_ros.mapping.joint.area_state import AreaState
from usmap_ros.mapping.joint.estimate import ROUNDS, JointEstimate
from usmap_ros.mapping.joint.first_pings import first_log_odds
from usmap_ros.mapping.joint.forward_model.log_odds import NOTHING
from usmap_ros.mapping.joint.kept_pings import KeptPings, Pings
from usmap_ros.mapping.joint.sensors import Sensors
from usmap_ros.mapping.joint.surfaces.lines import NO_LINES
from usmap_ros.mapping.joint.surfaces.walls import SHOWN, Walls
from usmap_ros.mapping.joint.visibility.field import Field, field_around
from usmap_ros.mapping.ping_table import ping_in_row
from usmap_ros.numerics.arrays import BoolArray
from usmap_ros.parameters import MappingParameters
from usmap_ros.processes.memory import give_back_memory


class Explanation(NamedTuple):
    """What is known by some pings."""

    #: Of each area.
    areas: list[AreaState]
    #: Of those who heard them.
    sensors: Sensors
    #: How many they were.
    pings: int


def explained(
    kept: KeptPings,
    parameters: MappingParameters,
    earlier: OccupancyMap | None = None,
    more_rounds: int = 0,
) -> Explanation:
    """What explains pings together, which takes seconds.

    Parameters
    ----------
    kept : KeptPings
        The pings.
    parameters : MappingParameters
        Of the map.
    earlier : OccupancyMap, optional
        What was known before, which holds where the pings say nothing.
    more_rounds : int
        Rounds of shadows and sweeps beyond the usual ones.
    """
    work = _Areas(kept, parameters, earlier, more_rounds)
    areas = [work.area(group) for group in kept.islands()]
    del work
    give_back_memory()
    return Explanation(areas, kept.sensors(), len(kept))


class _Areas:
    """Work on the areas of some pings; arguments as of `explained`."""

    def __init__(
        self,
        kept: KeptPings,
        parameters: MappingParameters,
        earlier: OccupancyMap | None,
        more_rounds: int,
    ) -> None:
        self._kept, self._parameters = kept, parameters
        self._earlier, self._more_rounds = earlier, more_rounds

    def area(self, group: list[int]) -> AreaState:
        parameters, pings = self._parameters, self._kept.pings(group)
        estimate, credit = self._estimate(pings), dict[str, float]()
        walls = estimate.estimate_walls()
        if parameters.weigh_robots:
            # Not before mirrors are known, whose echoes nobody hears from elsewhere.
            credit = estimate.credit(pings.sources)
            if min(credit.values()) < 1.0:
                pings = self._kept.pings(group, credit)
                estimate = self._estimate(pings)
                walls = estimate.estimate_walls()
        field = estimate.field
        belief = None
        if self._earlier is None:
            belief = first_log_odds(
                (ping_in_row(pings.table, row) for row in pings.rows), field, parameters
            )
        if belief is None:
            belief = estimate.belief()
            return estimate.known(*estimate.free_space(walls), belief, credit)
        nothing = np.zeros(field.shape, bool)
        walls = Walls(belief > SHOWN, nothing, nothing, NO_LINES, NO_LINES)
        walls, free = estimate.free_space(walls)
        return estimate.known(walls, free & (belief == NOTHING), belief, credit)

    def _estimate(self, pings: Pings) -> JointEstimate:
        """Powers and beliefs of an area."""
        parameters = self._parameters
        field = field_around(pings.table, pings.rows, parameters.resolution_m)
        # Without the rim, which nothing is known of.
        check_size(field.rows - 2, field.columns - 2, parameters)
        estimate = JointEstimate(
            pings.table, pings.rows, pings.weights, pings.echoes, field,
            opacity=parameters.shadow_opacity,
            forgetting=parameters.forgetting, standing=self._standing(field),
            gap_m=parameters.wall_gap_m, proofs=parameters.proof_rays,
            first_only=pings.first_only,
        )  # fmt: skip
        estimate.estimate_powers(ROUNDS + self._more_rounds)
        return estimate

    def _standing(self, field: Field) -> BoolArray | None:
        """Cells of a field that were occupied before."""
        if self._earlier is None:
            return None
        standing = np.zeros(field.shape, bool)
        left, bottom = self._earlier.geometry.first_cell
        rows, columns = np.nonzero(self._earlier.predicted())
        rows, columns = rows + bottom - field.first_row, columns + left - field.first_column
        inside = (rows >= 0) & (columns >= 0) & (rows < field.rows) & (columns < field.columns)
        standing[rows[inside], columns[inside]] = True
        return standing
