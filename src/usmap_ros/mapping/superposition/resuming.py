"""A map that was exported before, taken up as evidence."""

from __future__ import annotations

import numpy as np

from usmap_ros.grids import OccupancyMap
from usmap_ros.mapping.export import EXPOSURE, LOG_ODDS
from usmap_ros.mapping.grid import TiledGrid
from usmap_ros.mapping.superposition.cells import QUARTERS
from usmap_ros.mapping.superposition.evidence_layers import ALIVE, LASTING, POWER, SHOWN, layer_of
from usmap_ros.mapping.superposition.layers import directions_heard_from
from usmap_ros.mapping.superposition.log_odds import SILENT_LOOK, Scale, uncalibrated
from usmap_ros.mapping.superposition.snapshot import CLEAR, SILENT
from usmap_ros.parameters import MappingParameters


def take_up_evidence(
    grid: TiledGrid, occupancy: OccupancyMap, parameters: MappingParameters, scale: Scale
) -> None:
    """Set the evidence, and the powers, that a map would have come from.

    Parameters
    ----------
    grid : TiledGrid
        With the log-odds and the exposure of the map; its other layers are set.
    occupancy : OccupancyMap
        The map that was exported, with its layers.
    parameters : MappingParameters
        Of the model.
    scale : Scale
        How evidence becomes log-odds.
    """
    log_odds = grid.layer(LOG_ODDS)
    known = log_odds != np.float32(scale.prior)
    # Silence that could make a cell so unlikely would have made it observed.
    in_doubt = (grid.layer(EXPOSURE) == 0.0) & (log_odds < scale.prior - SILENT_LOOK)
    suspected = known & ((log_odds > scale.prior) | in_doubt)
    free = known & ~suspected
    evidence = np.where(suspected, uncalibrated(log_odds, scale), 0.0)
    heard_x, heard_y = directions_heard_from(grid, occupancy)
    said = {
        "own": evidence,
        "block": evidence,
        "heard_x": heard_x,
        "heard_y": heard_y,
        CLEAR: grid.layer(EXPOSURE) * (parameters.proof_rays / parameters.observed_exposure),
        SILENT: np.where(free, (scale.prior - log_odds) / SILENT_LOOK, 0.0),
    }
    for stage in (SHOWN, LASTING):
        for name, values in said.items():
            grid.layer(layer_of(stage, name))[:] = values
    grid.layer(ALIVE)[:] = suspected
    power = np.where(suspected, parameters.reflectivity**2, 0.0)
    grid.layer(POWER)[:] = np.repeat(power, QUARTERS)
