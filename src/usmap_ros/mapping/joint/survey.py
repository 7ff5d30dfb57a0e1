"""The map of all kept pings, worked out once, in any thread."""

import threading
from collections.abc import Callable

import numpy as np

from usmap_ros.grids import OccupancyMap
from usmap_ros.mapping.extent import check_size
from usmap_ros.mapping.joint.area_state import AreaState
from usmap_ros.mapping.joint.drawing import copied, drawn_map
from usmap_ros.mapping.joint.estimate import ROUNDS, JointEstimate
from usmap_ros.mapping.joint.first_pings import first_log_odds
from usmap_ros.mapping.joint.forward_model.log_odds import NOTHING, cell_log_odds
from usmap_ros.mapping.joint.kept_pings import KeptPings, Pings
from usmap_ros.mapping.joint.surfaces.lines import NO_LINES
from usmap_ros.mapping.joint.surfaces.walls import SHOWN, Walls
from usmap_ros.mapping.joint.visibility.field import Field, field_around
from usmap_ros.mapping.ping_table import ping_in_row
from usmap_ros.numerics.arrays import BoolArray
from usmap_ros.parameters import MappingParameters
from usmap_ros.processes.memory import give_back_memory

Tell = Callable[[list[AreaState], KeptPings, OccupancyMap | None], None]


class Survey:
    """The map of some pings; to make it takes little, to ask it for anything seconds.

    Parameters
    ----------
    kept : KeptPings
        The pings, which nobody else changes.
    parameters : MappingParameters
        Of the map.
    earlier : callable, optional
        Returns what was known before, which holds where the pings say nothing.
    more_rounds : int
        Rounds of shadows and sweeps beyond the usual ones.
    frame_id, stamp_ns
        Of the map.
    tell : callable
        Told what is known of the areas, by which pings, and beside what was known before them, when
        that is worked out.
    """

    def __init__(
        self,
        kept: KeptPings,
        parameters: MappingParameters,
        earlier: Callable[[], OccupancyMap] | None,
        more_rounds: int,
        frame_id: str,
        stamp_ns: int,
        tell: Tell = lambda areas, kept, earlier: None,
    ) -> None:
        self._kept, self._parameters, self._before = kept, parameters, earlier
        self._more_rounds, self.frame_id, self.stamp_ns = more_rounds, frame_id, stamp_ns
        self._tell, self._lock = tell, threading.Lock()
        self._earlier: OccupancyMap | None = None
        self._map: OccupancyMap | None = None

    def occupancy_map(self) -> OccupancyMap:
        """The map; whoever asked may change it."""
        with self._lock:
            if self._map is None:
                self._earlier = self._before and self._before()
                areas = [self._area(group) for group in self._kept.islands()]
                self._map = drawn_map(
                    areas, self._parameters, self._earlier, self.frame_id, self.stamp_ns
                )
                self._tell(areas, self._kept, self._earlier)
                # Nothing stays but the map: what it was made from is many times as large, and
                # earlier surveys hold those that were before them.
                self._kept, self._before = KeptPings(self._parameters), None
                self._earlier, self._tell = None, lambda areas, kept, earlier: None
                del areas
                give_back_memory()
            return copied(self._map)

    @property
    def is_made(self) -> bool:
        """Whether the map is there."""
        return self._map is not None

    def _area(self, group: list[int]) -> AreaState:
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
            belief = cell_log_odds(estimate.evidence, field.shape)
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
            opacity=parameters.opacity if parameters.occlusion else 0.0,
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
