"""Fusing the cones of many robots into one map."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d
from scipy.special import expit, logit

from usmap_ros.cone import EchoCone
from usmap_ros.errors import MalformedMessageError
from usmap_ros.grids import OccupancyMap
from usmap_ros.mapping.export import as_map, load_map
from usmap_ros.mapping.footprint import Footprint, footprint
from usmap_ros.mapping.grid import FloatArray, IndexArray, TiledGrid
from usmap_ros.mapping.reflectivity import LogReflectivity, silence
from usmap_ros.mapping.ring import Ring, find_ring, ring_evidence
from usmap_ros.mapping.visibility import visibility
from usmap_ros.parameters import MappingParameters

#: Layers of the grid.  Beside the log-odds: the belief about ln reflectivity beyond its prior,
#: and how often an object would have been heard.
LOG_ODDS, PRECISION, INFORMATION, EXPOSURE = "log_odds", "precision", "information", "exposure"
#: Deviations of range, from the pose's uncertainty, over which a detection limit is taken.
LIMIT_DEVIATIONS = 1.5


@dataclass
class _Look:
    """A ping in the window: the cells on its rings and what they owe to it."""

    slots: IndexArray
    ring: Ring
    bound: FloatArray
    audibility: FloatArray
    log_odds: FloatArray
    precision: FloatArray
    information: FloatArray


class NoisyOrFusion:
    """A map that weighs the evidence of recent pings against each other.

    Every cell carries its log-odds and a belief about its reflectivity.  A ping frees the cells
    where silence would have been broken, and shares each echo among the cells of its ring.
    The shares of recent pings are taken back and dealt again as the map changes: belief
    propagation over a sliding window, in a fixed order, so that the same cones in the same
    order always give the same map.

    Parameters
    ----------
    parameters : MappingParameters
        Prior, clamps and sensor model.
    """

    def __init__(self, parameters: MappingParameters) -> None:
        self.parameters = parameters
        self._prior = float(logit(parameters.prior))
        self._grid = TiledGrid(
            parameters.resolution_m,
            {LOG_ODDS: self._prior, PRECISION: 0.0, INFORMATION: 0.0, EXPOSURE: 0.0},
        )
        self._window: deque[_Look] = deque(maxlen=parameters.window)
        self._next_revisit = 0
        self._frame_id = ""
        self._stamp_ns = 0

    def fuse(self, cone: EchoCone) -> None:
        """Take up the evidence of one ping.

        Raises
        ------
        MalformedMessageError
            If the cone's frame is not the map's.
        """
        self._check_frame(cone)
        look,rest = self._hear(cone)
        self._weigh(look)
        cells,slots,bound,quiet=rest
        audibility = self.parameters.audibility * self._visibility(cells, slots)
        self._free(slots[quiet], bound[quiet], audibility[quiet])
        self._window.append(look)
        for _ in range(self.parameters.revisits):
            self._next_revisit = (self._next_revisit + 1) % len(self._window)
            self._weigh(self._window[self._next_revisit])

    def occupancy_map(self) -> OccupancyMap:
        """Return the map so far.

        A cell counts as observed if an object in it would probably have been heard, or if it
        is not believed to be free: a silent cell that echoes could neither free nor fill is
        not.
        """
        return as_map(self._grid, self.parameters, self._frame_id, self._stamp_ns)

    def resume(self, occupancy: OccupancyMap) -> None:
        """Start from a map that was exported before.

        Raises
        ------
        ValueError
            If its resolution or origin does not fit this grid.
        """
        load_map(self._grid, occupancy, self.parameters)
        self._frame_id, self._stamp_ns = occupancy.frame_id, occupancy.stamp_ns

    def _check_frame(self, cone: EchoCone) -> None:
        if self._frame_id and cone.frame_id != self._frame_id:
            raise MalformedMessageError(
                "header.frame_id", f"is '{cone.frame_id}', the map's is '{self._frame_id}'"
            )
        self._frame_id = cone.frame_id
        self._stamp_ns = max(self._stamp_ns, cone.stamp_ns)

    def _hear(self, cone: EchoCone) -> _Look:
        """Free the silent cells of a cone for good, and collect those on its rings."""
        parameters = self.parameters
        cells = footprint(cone, parameters.resolution_m)
        slots = self._grid.slots(cells.rows, cells.columns)
        ring = find_ring(cone, cells, parameters.range_error_m, parameters.fluctuation, parameters.clutter)
        bound = np.log(_limit_at(cone, cells)) - cells.log_unit_amplitude
        audibility = parameters.audibility * self._visibility(cells, slots)

        quiet = np.ones(len(slots), dtype=bool)
        quiet[ring.cells] = False
        on_ring = ring.cells
        nothing = np.zeros(len(on_ring))
        return _Look(
            slots[on_ring], ring, bound[on_ring], audibility[on_ring], nothing, nothing, nothing
        ),(cells,slots,bound,quiet)

    def _free(self, slots: IndexArray, bound: FloatArray, audibility: FloatArray) -> None:
        heard_nothing = silence(
            self._belief(slots), bound, audibility, self.parameters.fluctuation
        )
        log_odds = self._grid.layer(LOG_ODDS)
        log_odds[slots] = self._clamped(log_odds[slots] + heard_nothing.log_ratio)
        self._grid.layer(PRECISION)[slots] += heard_nothing.precision
        self._grid.layer(INFORMATION)[slots] += heard_nothing.information
        self._grid.layer(EXPOSURE)[slots] += heard_nothing.detection_probability

    def _weigh(self, look: _Look) -> None:
        """Take back what the cells owe to a ping, and deal it anew."""
        slots, parameters = look.slots, self.parameters
        log_odds = self._grid.layer(LOG_ODDS)
        without = log_odds[slots].astype(float) - look.log_odds
        belief = self._belief(slots, look.precision, look.information)
        quiet = silence(belief, look.bound, look.audibility, parameters.fluctuation)
        evidence = ring_evidence(
            look.ring, expit(without), belief, quiet, look.audibility
        )
        updated = self._clamped(without + evidence.log_ratio)
        log_odds[slots] = updated
        self._grid.layer(PRECISION)[slots] += evidence.precision - look.precision
        self._grid.layer(INFORMATION)[slots] += evidence.information - look.information
        look.log_odds = updated - without
        look.precision, look.information = evidence.precision, evidence.information

    def _belief(
        self,
        slots: IndexArray,
        less_precision: FloatArray | float = 0.0,
        less_information: FloatArray | float = 0.0,
    ) -> LogReflectivity:
        """Belief about ln reflectivity, optionally without what one ping has added."""
        prior_precision = 1.0 / self.parameters.reflectivity_spread**2
        prior_information = prior_precision * np.log(self.parameters.reflectivity)
        gained = self._grid.layer(PRECISION)[slots].astype(float) - less_precision
        learnt = self._grid.layer(INFORMATION)[slots].astype(float) - less_information
        # Single precision may leave a trace less than nothing after taking back.
        return LogReflectivity(
            prior_precision + np.maximum(gained, 0.0), prior_information + learnt
        )

    def _visibility(self, cells: Footprint, slots: IndexArray) -> FloatArray | float:
        if not self.parameters.occlusion:
            return np.ones(len(slots))
        probability = expit(self._grid.layer(LOG_ODDS)[slots].astype(float))
        return visibility(cells, probability, self.parameters.resolution_m)

    def _clamped(self, log_odds: FloatArray | NDArray[np.float32]) -> FloatArray:
        clamped: FloatArray = np.clip(
            log_odds, self.parameters.least_log_odds, self.parameters.greatest_log_odds
        )
        return clamped


def _limit_at(cone: EchoCone, cells: Footprint) -> FloatArray:
    """Detection limit at each cell: the highest over the ranges at which the cell may lie."""
    limits = cone.limit_amplitudes()
    reach_m = cells.half_depth_m + LIMIT_DEVIATIONS * cells.range_std_m
    bins = int(np.ceil(reach_m.max(initial=0.0) / cone.limit_step_m))
    highest = maximum_filter1d(limits, 2 * bins + 1, mode="nearest")
    index = ((cells.range_m - cone.transducer.min_range_m) / cone.limit_step_m).astype(np.intp)
    limit: FloatArray = highest[np.clip(index, 0, len(highest) - 1)]
    return limit
