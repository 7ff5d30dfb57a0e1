"""The map as it is given out, of what is known of its areas."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from usmap_ros.grids import AMBIGUITY, LOOKS_COS, LOOKS_SIN, NORMAL, GridGeometry, OccupancyMap
from usmap_ros.mapping.extent import check_size
from usmap_ros.mapping.fusion import LEAST_NEWS
from usmap_ros.mapping.joint.area_state import AreaState, CellStates
from usmap_ros.mapping.joint.forward_model.log_odds import NOTHING, over_block
from usmap_ros.mapping.joint.surfaces.walls import SHOWN
from usmap_ros.mapping.normals import surface_normals
from usmap_ros.numerics.arrays import BoolArray
from usmap_ros.numerics.special import entropy, logistic, logit
from usmap_ros.parameters import MappingParameters

#: Log-odds of free cells, or so much below the prior where that is less: maps are merged by what
#: they add to it.
FREE_LOG_ODDS, FREE_EVIDENCE = -3.0, -0.5
#: Least log-odds of cells that are shown as occupied: those that are filled in between have no
#: evidence of their own.
OCCUPIED_LOG_ODDS = 0.8


def drawn_map(
    areas: Sequence[AreaState],
    parameters: MappingParameters,
    earlier: OccupancyMap | None,
    frame_id: str,
    stamp_ns: int,
) -> OccupancyMap:
    """The least rectangle that holds all that is known.

    Parameters
    ----------
    areas : sequence of AreaState
        What is known of each.
    parameters : MappingParameters
        Of the map.
    earlier : OccupancyMap, optional
        What was known before, which holds where the areas say nothing.
    frame_id, stamp_ns
        Of the map.
    """
    drawn = [(area, _known(area.cells, parameters)) for area in areas]
    corners = [
        _bounds(area.field.first_row, area.field.first_column, known)
        for area, known in drawn
        if known.any()
    ]
    if earlier is not None:
        told = _told(earlier, parameters)
        if told.any():
            left, bottom = earlier.geometry.first_cell
            corners.append(_bounds(bottom, left, told))
    if not corners:
        corners.append((0, 0, 1, 1))
    bottom, left = (min(corner[axis] for corner in corners) for axis in (0, 1))
    top, right = (max(corner[axis] for corner in corners) for axis in (2, 3))
    shape, step_m = (top - bottom, right - left), parameters.resolution_m
    check_size(*shape, parameters)
    geometry = GridGeometry(step_m, (left * step_m, bottom * step_m), shape)
    log_odds = np.full(shape, logit(parameters.prior), np.float32)
    observed = np.zeros(shape, bool)
    occupancy = OccupancyMap(geometry, log_odds, observed, frame_id, stamp_ns)
    layers = {
        NORMAL: np.full(shape, np.nan, np.float32),
        **{name: np.zeros(shape, np.float32) for name in (AMBIGUITY, LOOKS_COS, LOOKS_SIN)},
    }
    if earlier is not None:
        _put_earlier(occupancy, layers, earlier)
    for area, known in drawn:
        if known.any():
            _put(occupancy, layers, area, known, parameters)
    return replace(occupancy, layers=layers)


def _put(
    occupancy: OccupancyMap,
    layers: dict[str, NDArray[np.float32]],
    area: AreaState,
    known: BoolArray,
    parameters: MappingParameters,
) -> None:
    """Put what is known of an area into the map."""
    left, bottom = occupancy.geometry.first_cell
    first_row, first_column = area.field.first_row, area.field.first_column
    row, column, end_row, end_column = _bounds(first_row, first_column, known)
    place = np.s_[row - bottom : end_row - bottom, column - left : end_column - left]
    part = np.s_[
        row - first_row : end_row - first_row, column - first_column : end_column - first_column
    ]
    shown, free, belief = area.cells.shown[part], area.cells.free[part], area.cells.belief[part]
    vacant = min(FREE_LOG_ODDS, logit(parameters.prior) + FREE_EVIDENCE)
    decided = np.where(shown, np.maximum(belief, OCCUPIED_LOG_ODDS), vacant)
    least, greatest = parameters.least_log_odds, parameters.greatest_log_odds
    log_odds, observed = occupancy.log_odds[place], occupancy.observed[place]
    suspected = (belief > NOTHING) & ~shown & ~free & ~observed
    log_odds[suspected] = np.clip(belief, least, SHOWN)[suspected]
    log_odds[shown | free] = np.clip(decided, least, greatest)[shown | free]
    observed |= shown | free
    told = shown | free | (area.cells.heard[part] > 0.0)
    for name, values in _layers(area.cells, part, occupancy, place).items():
        layers[name][place][told] = values[told]


def copied(occupancy: OccupancyMap) -> OccupancyMap:
    """A map with arrays of its own."""
    layers = {name: values.copy() for name, values in occupancy.layers.items()}
    return replace(
        occupancy,
        log_odds=occupancy.log_odds.copy(),
        observed=occupancy.observed.copy(),
        layers=layers,
    )


def _put_earlier(
    occupancy: OccupancyMap, layers: dict[str, NDArray[np.float32]], earlier: OccupancyMap
) -> None:
    """Put what was known before into the map, as far as it reaches."""
    (left, bottom), (rows, columns) = occupancy.geometry.first_cell, occupancy.geometry.shape
    column, row = (
        int(a) - int(b) for a, b in zip(earlier.geometry.first_cell, (left, bottom), strict=True)
    )
    height, width = earlier.geometry.shape
    here = np.s_[max(row, 0) : max(row + height, 0), max(column, 0) : max(column + width, 0)]
    there = np.s_[max(-row, 0) : max(rows - row, 0), max(-column, 0) : max(columns - column, 0)]
    occupancy.log_odds[here] = earlier.log_odds[there]
    occupancy.observed[here] = earlier.observed[there]
    for name in layers.keys() & earlier.layers.keys():
        layers[name][here] = earlier.layers[name][there]


def _known(cells: CellStates, parameters: MappingParameters) -> BoolArray:
    """Cells of which anything is to be said."""
    news = np.clip(cells.belief, parameters.least_log_odds, SHOWN) - logit(parameters.prior)
    suspected = (cells.belief > NOTHING) & (np.abs(news) >= LEAST_NEWS)
    known: BoolArray = cells.shown | cells.free | suspected | (cells.heard > 0.0)
    return known


def _told(earlier: OccupancyMap, parameters: MappingParameters) -> BoolArray:
    """Cells of an earlier map of which anything was said."""
    news = np.abs(earlier.log_odds - logit(parameters.prior)) >= LEAST_NEWS
    told: BoolArray = earlier.observed | news
    for name in (LOOKS_COS, LOOKS_SIN):
        if name in earlier.layers:
            told |= earlier.layers[name] != 0.0
    return told


def _bounds(first_row: int, first_column: int, known: BoolArray) -> tuple[int, int, int, int]:
    """First row and column of some cells, and the ends, counted from y = 0 and x = 0.

    Parameters
    ----------
    first_row, first_column : int
        Of the lowest left cell of the mask.
    known : (rows, columns) bool array
        Which cells.
    """
    rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    return (
        first_row + int(rows[0]), first_column + int(columns[0]),
        first_row + int(rows[-1]) + 1, first_column + int(columns[-1]) + 1,
    )  # fmt: skip


def _layers(
    cells: CellStates,
    part: tuple[slice, slice],
    occupancy: OccupancyMap,
    place: tuple[slice, slice],
) -> dict[str, NDArray[np.float32]]:
    """What else is known of the cells of an area."""
    heard, asked, axis_cos, axis_sin, from_x, from_y = (
        values[part]
        for values in (
            cells.heard, cells.asked, cells.axis_cos, cells.axis_sin, cells.from_x, cells.from_y,
        )
    )  # fmt: skip
    explained = (heard / np.maximum(asked, 1e-6)).astype(np.float32)
    is_heard, believed = heard > 0.0, np.zeros_like(heard)
    believed[is_heard] = logistic(over_block(cells.belief)[part][is_heard])
    predicted, probability = occupancy.predicted()[place], occupancy.probability()[place]
    weight = np.maximum(heard, 1e-6)
    return {
        NORMAL: surface_normals(predicted, probability, np.stack([from_x, from_y], axis=-1)),
        AMBIGUITY: undecided(explained, believed),
        LOOKS_COS: np.where(is_heard, axis_cos / weight, 0.0).astype(np.float32),
        LOOKS_SIN: np.where(is_heard, axis_sin / weight, 0.0).astype(np.float32),
    }


def undecided(explained: NDArray[np.float32], belief: NDArray[np.float32]) -> NDArray[np.float32]:
    """How undecided it is what cells hold: the entropy, in bits, of its being something.

    A block of nine cells that explains its echoes holds their source, and one whose echoes
    others explain does not.  What lies between is undecided, unless evidence has
    decided it: the cells of a wall share their echoes, and stand there all the same.

    Parameters
    ----------
    explained : (rows, columns) float32 array
        Mean share of each cell and its neighbours in the echoes that may have come from there.
    belief : (rows, columns) float32 array
        Greatest probability by the evidence of each cell and its neighbours.
    """
    probability = np.clip(np.maximum(explained, belief), 0.0, 1.0)
    bits = np.zeros_like(probability)
    # Nothing is suspected in most cells of a map, and logarithms take long.
    in_doubt = (probability > 0.0) & (probability < 1.0)
    likely = probability[in_doubt].astype(np.float64)
    nats = entropy(likely) + entropy(1.0 - likely)
    bits[in_doubt] = np.clip(nats / np.log(2.0), 0.0, 1.0)
    return bits
