"""Fusion in which an echo is shared among the cells that may have returned it."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from scipy.special import expit

from usmap_ros.cone import EchoCone
from usmap_ros.mapping.export import EXPOSURE, LOG_ODDS
from usmap_ros.mapping.footprint import Footprint, footprint
from usmap_ros.mapping.fusion import Fusion
from usmap_ros.mapping.grid import FloatArray, IndexArray
from usmap_ros.mapping.reflectivity import LogReflectivity, silence
from usmap_ros.mapping.ring import Ring, find_ring, ring_evidence
from usmap_ros.mapping.sensor_model import log_reflectivity_bound, prior_reflectivity
from usmap_ros.mapping.visibility import Rays, cast_rays, visibility
from usmap_ros.parameters import MappingParameters

#: Layers of the grid: the belief about ln reflectivity, beyond its prior.
PRECISION, INFORMATION = "precision", "information"


@dataclass
class _Look:
    """A ping in the window: the cells on its rings, and what they owe to it."""

    slots: IndexArray
    ring: Ring
    bound: FloatArray
    audibility: FloatArray
    log_odds: FloatArray
    precision: FloatArray
    information: FloatArray


class NoisyOrFusion(Fusion):
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
        super().__init__(parameters, {PRECISION: 0.0, INFORMATION: 0.0})
        self._window: deque[_Look] = deque(maxlen=parameters.window)
        self._next_revisit = 0

    def _take_up(self, cone: EchoCone) -> None:
        cells = footprint(cone, self.parameters.resolution_m)
        slots = self._grid.slots(cells.rows, cells.columns)
        bound = log_reflectivity_bound(cone, cells)
        rays = cast_rays(cells, self.parameters.resolution_m)
        look = self._look(cone, cells, rays, slots, bound)
        self._deal(look)
        self._free_silent(rays, slots, bound, look.ring)
        self._window.append(look)
        for _ in range(self.parameters.revisits):
            self._next_revisit = (self._next_revisit + 1) % len(self._window)
            self._deal(self._window[self._next_revisit])

    def _look(
        self,
        cone: EchoCone,
        cells: Footprint,
        rays: Rays,
        slots: IndexArray,
        bound: FloatArray,
    ) -> _Look:
        """Find the rings of a cone; nothing is owed to it yet."""
        ring = find_ring(cone, cells, self.parameters)
        audibility = self._audibility(rays, slots)
        nothing = np.zeros(len(ring.cells))
        return _Look(
            slots=slots[ring.cells],
            ring=ring,
            bound=bound[ring.cells],
            audibility=audibility[ring.cells],
            log_odds=nothing,
            precision=nothing,
            information=nothing,
        )

    def _deal(self, look: _Look) -> None:
        """Take back what the cells of a ping's rings owe to it, and deal it anew."""
        slots = look.slots
        if len(slots) == 0:
            return
        log_odds = self._grid.layer(LOG_ODDS)
        without = log_odds[slots].astype(float) - look.log_odds
        belief = self._belief_without(look)
        quiet = silence(belief, look.bound, look.audibility, self.parameters.fluctuation)
        evidence = ring_evidence(look.ring, expit(without), belief, quiet, look.audibility)
        updated = self._clamped(without + evidence.log_ratio)
        log_odds[slots] = updated
        self._grid.layer(PRECISION)[slots] += evidence.precision - look.precision
        self._grid.layer(INFORMATION)[slots] += evidence.information - look.information
        look.log_odds = updated - without
        look.precision, look.information = evidence.precision, evidence.information

    def _free_silent(self, rays: Rays, slots: IndexArray, bound: FloatArray, ring: Ring) -> None:
        """Free the cells off the rings, for good.

        After the rings were dealt: the sources of this ping's echoes hide what is behind them.
        """
        silent = np.ones(len(slots), dtype=bool)
        silent[ring.cells] = False
        audibility = self._audibility(rays, slots)[silent]
        slots = slots[silent]
        # Thousands of cells, each judged once: the grid's single precision is enough.
        belief = prior_reflectivity(
            self.parameters,
            self._grid.layer(PRECISION)[slots],
            self._grid.layer(INFORMATION)[slots],
        )
        quiet = silence(
            belief,
            bound[silent].astype(np.float32),
            audibility.astype(np.float32),
            self.parameters.fluctuation,
        )
        log_odds = self._grid.layer(LOG_ODDS)
        log_odds[slots] = self._clamped(log_odds[slots] + quiet.log_ratio)
        self._grid.layer(PRECISION)[slots] += quiet.precision
        self._grid.layer(INFORMATION)[slots] += quiet.information
        self._grid.layer(EXPOSURE)[slots] += quiet.detection_probability

    def _belief_without(self, look: _Look) -> LogReflectivity:
        """Belief about ln reflectivity on a ping's rings, without what the ping has added."""
        precision = self._grid.layer(PRECISION)[look.slots].astype(float) - look.precision
        information = self._grid.layer(INFORMATION)[look.slots].astype(float) - look.information
        return prior_reflectivity(self.parameters, precision, information)

    def _audibility(self, rays: Rays, slots: IndexArray) -> FloatArray:
        """Probability that a loud enough object in each cell is heard at all."""
        if not self.parameters.occlusion:
            return np.full(len(slots), self.parameters.audibility)
        in_sight = visibility(rays, expit(self._grid.layer(LOG_ODDS)[slots]))
        return self.parameters.audibility * in_sight
