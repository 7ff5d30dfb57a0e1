"""Leave-one-out: what the map owes to each robot, and expects of a ping without its word."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.grid import TiledGrid
from usmap_ros.mapping.superposition.cells import QUARTERS, Tiles
from usmap_ros.mapping.superposition.inverse_sensor_model import (
    Bounds,
    Evidence,
    add_evidence,
    prepare_bins,
)
from usmap_ros.mapping.superposition.log_odds import Scale, find_hiding, set_depth, set_log_odds
from usmap_ros.mapping.superposition.ping_bins import Look, look_of
from usmap_ros.mapping.superposition.workspace import Workspace
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

#: Evidence at which the others are believed to have seen something, relative to that at which the
#: map, with all pings, believes it.
PART_THRESHOLD = 0.5
#: Errors of heading that are looked for.
TURNS_RAD = (-0.35, -0.2, -0.1, 0.1, 0.2, 0.35)


class Expected(NamedTuple):
    """A ping, and what the map that the others made expects of it.

    Parameters
    ----------
    look : Look
        The ping in bins of range.
    power : (bins,) array
        Expected power of each range bin, the receiver's noise included.
    turned : (TURNS_RAD, bins) array
        The same if the robot faced elsewhere than it says, by each of the turns.
    """

    look: Look
    power: FloatArray
    turned: FloatArray


class LeaveOneOutMap:
    """Splits a map by whom its evidence comes from.

    Parameters
    ----------
    grid : TiledGrid
        A copy of the map, with `LAYERS`; nothing in it is changed.
    parameters : MappingParameters
        Of the model.
    scale : Scale
        How evidence becomes log-odds.
    bounds : Bounds
        How much can be said of a cell.
    opacity : float
        Of what is believed in.
    """

    #: Power of each quarter of a cell, cells with any, and their optical depth.
    LAYERS = ("power", "alive", "depth")

    def __init__(
        self,
        grid: TiledGrid,
        parameters: MappingParameters,
        scale: Scale,
        bounds: Bounds,
        opacity: float,
    ) -> None:
        self._parameters, self._work = parameters, Workspace()
        self._tiles = Tiles(*grid.directory, parameters.resolution_m)
        self._power, self._alive, self._depth = (grid.layer(name) for name in self.LAYERS)
        # What is compared is a part of what the map was made of.
        self._scale = scale._replace(threshold=PART_THRESHOLD * scale.threshold)
        self._bounds, self._opacity = bounds, opacity
        self._rows, self._columns, self._slots = grid.cells(self._alive > 0.0)

    def expected(
        self,
        cones: Mapping[str, Sequence[EchoCone]],
        between: Callable[[], None] = lambda: None,
        of: Collection[str] | None = None,
    ) -> dict[str, list[Expected]]:
        """What is expected of robots' pings; see `usmap_ros.mapping.fusion.LeaveOneOut`."""
        asked = cones.keys() if of is None else of
        looks = {t: [look_of(cone, self._parameters) for cone in own] for t, own in cones.items()}
        evidence = {
            robot: self._evidence(pings, between)
            for robot, pings in looks.items()
            if any(robot != other for other in asked)
        }
        found: dict[str, list[Expected]] = {}
        for robot in asked:
            others = [said for other, said in evidence.items() if other != robot]
            own, block = (np.zeros_like(self._alive) for _ in range(2))
            for said in others:
                own += said.own
                block += said.block
            believed, depth = self._believed(own, block)
            found[robot] = []
            for look in looks[robot]:
                between()
                found[robot].append(self._expected(look, believed, depth))
        return found

    def _evidence(self, looks: Sequence[Look], between: Callable[[], None]) -> Evidence:
        """What some pings say of the cells of the map."""
        evidence = Evidence(*(np.zeros_like(self._alive) for _ in Evidence._fields))
        for look in looks:
            between()
            count = self._work.expect(look, self._tiles, self._depth, self._alive, self._power)
            _, seen, bins, parts = self._work.scratch
            prepare_bins(look, bins)
            add_evidence(look, seen, count, bins, parts, self._tiles, self._bounds, evidence)
        return evidence

    def _believed(
        self, own: NDArray[np.float32], block: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Powers of cells that evidence speaks for, and how they hide what is behind them."""
        log_odds = np.full_like(self._alive, self._scale.least)
        hiding, depth = np.zeros_like(self._alive), np.zeros_like(self._alive)
        cells = (self._slots, self._rows, self._columns, self._tiles)
        set_log_odds(*cells, own, block, self._scale, log_odds)
        find_hiding(*cells, own, block, self._scale, hiding)
        set_depth(*cells, hiding, self._opacity, depth)
        return np.where(np.repeat(log_odds > 0.0, QUARTERS), self._power, np.float32(0.0)), depth

    def _expected(
        self, look: Look, believed: NDArray[np.float32], depth: NDArray[np.float32]
    ) -> Expected:
        def power(seen: Look) -> FloatArray:
            self._work.expect(seen, self._tiles, depth, self._alive, believed)
            return self._work.scratch.bins.expected[: len(look.kind)].astype(float)

        return Expected(look, power(look), np.array([power(_turned(look, by)) for by in TURNS_RAD]))


def _turned(look: Look, by_rad: float) -> Look:
    """The same if the robot faced elsewhere."""
    cosine, sine = math.cos(by_rad), math.sin(by_rad)
    return look._replace(
        axis_x=cosine * look.axis_x - sine * look.axis_y,
        axis_y=sine * look.axis_x + cosine * look.axis_y,
        heading_rad=look.heading_rad + by_rad,
    )
