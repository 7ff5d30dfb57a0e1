"""The map of all kept pings, worked out once, in any thread."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from usmap_ros.grids import AMBIGUITY, LOOKS_COS, LOOKS_SIN, NORMAL, GridGeometry, OccupancyMap
from usmap_ros.mapping.export import LEAST_NEWS
from usmap_ros.mapping.extent import check_size
from usmap_ros.mapping.joint.estimate import ROUNDS, JointEstimate
from usmap_ros.mapping.joint.field import Field, field_around
from usmap_ros.mapping.joint.first_pings import first_log_odds
from usmap_ros.mapping.joint.kept_pings import KeptPings, Pings
from usmap_ros.mapping.joint.lines import NO_LINES
from usmap_ros.mapping.joint.log_odds import NOTHING, cell_log_odds, over_block
from usmap_ros.mapping.joint.walls import SHOWN, Walls
from usmap_ros.mapping.looks import look_in_row
from usmap_ros.mapping.normals import surface_normals
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.special import entropy, logistic, logit
from usmap_ros.parameters import MappingParameters

#: Log-odds of free cells, or so much below the prior where that is less: maps are merged by what
#: they add to it.
FREE_LOG_ODDS, FREE_EVIDENCE = -3.0, -0.5
#: Least log-odds of cells that are shown as occupied: those that are filled in between have no
#: evidence of their own.
OCCUPIED_LOG_ODDS = 0.8


@dataclass(frozen=True)
class Area:
    """What is known of one area.

    Parameters
    ----------
    estimate : JointEstimate
        Its powers and evidence.
    walls : Walls
        What stands.
    free : (rows, columns) bool array
        Free cells.
    belief : (rows, columns) array
        Log-odds that each cell holds or touches a surface.
    """

    estimate: JointEstimate
    walls: Walls
    free: BoolArray
    belief: FloatArray

    @property
    def field(self) -> Field:
        """Its cells."""
        return self.estimate.field


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
    """

    def __init__(
        self,
        kept: KeptPings,
        parameters: MappingParameters,
        earlier: Callable[[], OccupancyMap] | None,
        more_rounds: int,
        frame_id: str,
        stamp_ns: int,
    ) -> None:
        self._kept, self._parameters, self._before = kept, parameters, earlier
        self._more_rounds, self._frame_id, self._stamp_ns = more_rounds, frame_id, stamp_ns
        self._lock = threading.Lock()
        self._earlier: OccupancyMap | None = None
        self._map: OccupancyMap | None = None

    def occupancy_map(self) -> OccupancyMap:
        """The map; whoever asked may change it."""
        with self._lock:
            if self._map is None:
                self._earlier = self._before and self._before()
                islands = self._kept.islands()
                self._map = self._made([self._area(group) for group in islands])
                # Nothing stays but the map: what it was made from is many times as large, and
                # earlier surveys hold those that were before them.
                self._kept, self._before = KeptPings(self._parameters), None
                self._earlier = None
            return copied(self._map)

    @property
    def is_made(self) -> bool:
        """Whether the map is there."""
        return self._map is not None

    def _area(self, group: list[int]) -> Area:
        parameters, pings = self._parameters, self._kept.pings(group)
        estimate = self._estimate(pings)
        if parameters.weigh_robots:
            credit = estimate.credit(pings.sources)
            if min(credit.values()) < 1.0:
                pings = self._kept.pings(group, credit)
                estimate = self._estimate(pings)
        field, walls = estimate.field, estimate.estimate_walls()
        belief = None
        if self._earlier is None:
            belief = first_log_odds(
                (look_in_row(pings.looks, row) for row in pings.rows), field, parameters
            )
        if belief is None:
            belief = cell_log_odds(estimate.evidence, field.shape)
            return Area(estimate, *estimate.free_space(walls), belief)
        walls = Walls(belief > SHOWN, np.zeros(field.shape, bool), NO_LINES, NO_LINES)
        walls, free = estimate.free_space(walls)
        return Area(estimate, walls, free & (belief == NOTHING), belief)

    def _estimate(self, pings: Pings) -> JointEstimate:
        """Powers and beliefs of an area."""
        parameters = self._parameters
        field = field_around(pings.looks, pings.rows, parameters.resolution_m)
        # Without the rim, which nothing is known of.
        check_size(field.rows - 2, field.columns - 2, parameters)
        estimate = JointEstimate(
            pings.looks, pings.rows, pings.weights, pings.echoes, field,
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

    def _made(self, areas: list[Area]) -> OccupancyMap:
        """The least rectangle that holds all that is known."""
        drawn = [(area, _known(area, self._parameters)) for area in areas]
        corners = [
            _bounds(area.field.first_row, area.field.first_column, known)
            for area, known in drawn
            if known.any()
        ]
        if self._earlier is not None:
            told = _told(self._earlier, self._parameters)
            if told.any():
                left, bottom = self._earlier.geometry.first_cell
                corners.append(_bounds(bottom, left, told))
        if not corners:
            corners.append((0, 0, 1, 1))
        bottom, left = (min(corner[axis] for corner in corners) for axis in (0, 1))
        top, right = (max(corner[axis] for corner in corners) for axis in (2, 3))
        shape, step_m = (top - bottom, right - left), self._parameters.resolution_m
        check_size(*shape, self._parameters)
        geometry = GridGeometry(step_m, (left * step_m, bottom * step_m), shape)
        log_odds = np.full(shape, logit(self._parameters.prior), np.float32)
        observed = np.zeros(shape, bool)
        occupancy = OccupancyMap(geometry, log_odds, observed, self._frame_id, self._stamp_ns)
        layers = {
            NORMAL: np.full(shape, np.nan, np.float32),
            **{name: np.zeros(shape, np.float32) for name in (AMBIGUITY, LOOKS_COS, LOOKS_SIN)},
        }
        if self._earlier is not None:
            _put_earlier(occupancy, layers, self._earlier)
        for area, known in drawn:
            if known.any():
                self._put(occupancy, layers, area, known)
        return replace(occupancy, layers=layers)

    def _put(
        self,
        occupancy: OccupancyMap,
        layers: dict[str, NDArray[np.float32]],
        area: Area,
        known: BoolArray,
    ) -> None:
        """Put what is known of an area into the map."""
        left, bottom = occupancy.geometry.first_cell
        first_row, first_column = area.field.first_row, area.field.first_column
        row, column, end_row, end_column = _bounds(first_row, first_column, known)
        place = np.s_[row - bottom : end_row - bottom, column - left : end_column - left]
        part = np.s_[
            row - first_row : end_row - first_row, column - first_column : end_column - first_column
        ]
        shown, free = area.walls.shown[part], area.free[part]
        belief = area.belief[part]
        vacant = min(FREE_LOG_ODDS, logit(self._parameters.prior) + FREE_EVIDENCE)
        decided = np.where(shown, np.maximum(belief, OCCUPIED_LOG_ODDS), vacant)
        least, greatest = self._parameters.least_log_odds, self._parameters.greatest_log_odds
        log_odds, observed = occupancy.log_odds[place], occupancy.observed[place]
        suspected = (belief > NOTHING) & ~shown & ~free & ~observed
        log_odds[suspected] = np.clip(belief, least, SHOWN)[suspected]
        log_odds[shown | free] = np.clip(decided, least, greatest)[shown | free]
        observed |= shown | free
        heard = area.estimate.evidence.heard.reshape(area.field.shape)[part]
        told = shown | free | (heard > 0.0)
        for name, values in _layers(area, part, occupancy, place).items():
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


def _known(area: Area, parameters: MappingParameters) -> BoolArray:
    """Cells of which anything is to be said."""
    belief = area.belief
    news = np.clip(belief, parameters.least_log_odds, SHOWN) - logit(parameters.prior)
    suspected = (belief > NOTHING) & (np.abs(news) >= LEAST_NEWS)
    undecided = area.estimate.evidence.heard.reshape(area.field.shape) > 0.0
    known: BoolArray = area.walls.shown | area.free | suspected | undecided
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
    area: Area, part: tuple[slice, slice], occupancy: OccupancyMap, place: tuple[slice, slice]
) -> dict[str, NDArray[np.float32]]:
    """What else is known of the cells of an area."""
    evidence, shape = area.estimate.evidence, area.field.shape
    heard, asked, axis_cos, axis_sin, from_x, from_y = (
        values.reshape(shape)[part]
        for values in (
            evidence.heard, evidence.asked, evidence.axis_cos, evidence.axis_sin, evidence.from_x,
            evidence.from_y,
        )
    )  # fmt: skip
    belief = logistic(cell_log_odds(evidence, shape))
    explained = (heard / np.maximum(asked, 1e-6)).astype(np.float32)
    believed = over_block(belief)[part].astype(np.float32)
    predicted, probability = occupancy.predicted()[place], occupancy.probability()[place]
    weight = np.maximum(heard, 1e-6)
    return {
        NORMAL: surface_normals(predicted, probability, np.stack([from_x, from_y], axis=-1)),
        AMBIGUITY: undecided(explained, np.where(heard > 0.0, believed, 0.0).astype(np.float32)),
        LOOKS_COS: np.where(heard > 0.0, axis_cos / weight, 0.0).astype(np.float32),
        LOOKS_SIN: np.where(heard > 0.0, axis_sin / weight, 0.0).astype(np.float32),
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
