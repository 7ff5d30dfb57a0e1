"""The map at one instant, made into a rectangle while the fusion goes on."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from usmap_ros.grids import OCCUPIED_PROBABILITY, OccupancyMap
from usmap_ros.mapping.continuity import bridge_gaps
from usmap_ros.mapping.export import EXPOSURE, LOG_ODDS, as_map
from usmap_ros.mapping.grid import TiledGrid
from usmap_ros.mapping.superposition.layers import Suspects, map_layers
from usmap_ros.mapping.superposition.log_odds import (
    SILENT_LOOK,
    Scale,
    beside_free_space,
    calibrated,
    seen_free,
)
from usmap_ros.parameters import MappingParameters

#: Layers of `Snapshot.cells`: rays that are known to have passed, and trusted silence.
CLEAR, SILENT = "clear", "silent"


@dataclass(frozen=True)
class Snapshot:
    """All that a map by superposition is made of, copied.

    Parameters
    ----------
    cells : TiledGrid
        Layers `CLEAR` and `SILENT`.
    suspects : Suspects
        Cells that may hold something.
    are_few : bool
        Whether their log-odds are those of few pings, and are shown as they are.
    scale : Scale
        How evidence becomes log-odds.
    parameters : MappingParameters
        Of the map.
    frame_id, stamp_ns
        Of the map.
    """

    cells: TiledGrid
    suspects: Suspects
    are_few: bool
    scale: Scale
    parameters: MappingParameters
    frame_id: str
    stamp_ns: int

    def occupancy_map(self) -> OccupancyMap:
        """Make the map."""
        scale, parameters = self.scale, self.parameters
        grid = self.cells.copied({EXPOSURE: CLEAR, LOG_ODDS: SILENT})
        clear, silent = self.cells.layer(CLEAR), self.cells.layer(SILENT)
        exposure = seen_free(clear, silent, parameters.proof_rays, parameters.observed_exposure)
        grid.layer(EXPOSURE)[:] = exposure
        log_odds = grid.layer(LOG_ODDS)
        log_odds[:] = np.maximum(scale.prior - SILENT_LOOK * exposure, scale.least)
        slots = self.suspects.slots
        believed = self._believed(exposure[slots] >= parameters.observed_exposure)
        log_odds[slots] = np.clip(believed, scale.least, scale.greatest)
        # What is as likely there as not is unknown, and not observed, though sound went through.
        grid.layer(EXPOSURE)[slots[believed > 0.0]] = 0.0
        occupancy = as_map(grid, parameters, self.frame_id, self.stamp_ns, OCCUPIED_PROBABILITY)
        occupancy = bridge_gaps(occupancy, parameters.bridged_gap_m)
        return replace(occupancy, layers=map_layers(occupancy, self.suspects))

    def _believed(self, is_exposed: NDArray[np.bool_]) -> NDArray[np.float32]:
        """Log-odds that suspected cells turn out to have, by evidence and by what passed them."""
        if self.are_few:
            return self.suspects.log_odds
        raw = self.suspects.log_odds
        shown = calibrated(raw, self.scale)
        return np.where(is_exposed, beside_free_space(raw, shown, self.scale), shown)
