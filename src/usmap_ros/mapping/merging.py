"""Maps of several areas, or of several fusions, as one."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from usmap_ros.errors import UsmapError
from usmap_ros.grids import NORMAL, GridGeometry, OccupancyMap
from usmap_ros.mapping.extent import check_size
from usmap_ros.numerics.special import logit
from usmap_ros.parameters import MappingParameters


def merge_maps(maps: Sequence[OccupancyMap], parameters: MappingParameters) -> OccupancyMap:
    """Join maps of one frame on one grid.

    Where maps overlap, what each adds to the log-odds of the prior adds up: this counts evidence
    once if no ping is in two of them.  Further layers are those of the map that is surest of the
    cell.

    Parameters
    ----------
    maps : sequence of OccupancyMap
        At least one.
    parameters : MappingParameters
        Prior and clamps of log-odds, and how many cells there may be.

    Raises
    ------
    UsmapError
        If frames or cells differ, or the rectangle around all maps would be too large.
    """
    if len(maps) == 1:
        return maps[0]
    _check_alike(maps)
    geometry = GridGeometry.around([one.geometry for one in maps])
    check_size(*geometry.shape, parameters)
    prior = np.float32(logit(parameters.prior))
    log_odds = np.full(geometry.shape, prior, np.float32)
    observed = np.zeros(geometry.shape, np.bool_)
    surest = np.zeros(geometry.shape, np.float32)
    names = sorted({name for one in maps for name in one.layers})
    layers = {
        name: np.full(geometry.shape, np.nan if name == NORMAL else 0.0, np.float32)
        for name in names
    }
    for one in maps:
        window = one.geometry.within(geometry)
        news = one.log_odds - prior
        log_odds[window] += news
        observed[window] |= one.observed
        surer: NDArray[np.bool_] = np.abs(news) > surest[window]
        surest[window][surer] = np.abs(news)[surer]
        for name, layer in one.layers.items():
            # Neighbours of cells of which anything is known have layers, too.
            empty = surest[window] == 0.0
            taken = surer | (empty & np.isfinite(layer) & (layer != 0.0))
            layers[name][window][taken] = layer[taken]
    least, greatest = parameters.least_log_odds, parameters.greatest_log_odds
    return OccupancyMap(
        geometry,
        np.clip(log_odds, np.float32(least), np.float32(greatest)),
        observed,
        maps[0].frame_id,
        max(one.stamp_ns for one in maps),
        layers,
    )


def _check_alike(maps: Sequence[OccupancyMap]) -> None:
    first = maps[0]
    for one in maps[1:]:
        if one.frame_id != first.frame_id:
            raise UsmapError(
                f"maps in the frames '{first.frame_id}' and '{one.frame_id}' do not join"
            )
        sides_m = first.geometry.resolution_m, one.geometry.resolution_m
        if not np.isclose(*sides_m, rtol=1e-6):
            raise UsmapError(f"maps of cells of {sides_m[0]:g} m and {sides_m[1]:g} m do not join")
