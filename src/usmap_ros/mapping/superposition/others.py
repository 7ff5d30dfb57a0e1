"""What the map owes to each robot, and what it expects of a ping without that robot's word."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.arrays import FloatArray
from usmap_ros.mapping.grid import TiledGrid
from usmap_ros.mapping.superposition.belief import Scale, find_hiding, judge, set_depth
from usmap_ros.mapping.superposition.cells import Tiles
from usmap_ros.mapping.superposition.evidence import Bounds, Evidence, add_evidence, prepare_bins
from usmap_ros.mapping.superposition.look import Look
from usmap_ros.mapping.superposition.workspace import Workspace

#: Evidence at which the others are believed to have seen something, relative to that at which the
#: map, with all pings, believes it.
PART_THRESHOLD = 0.5


class Expected(NamedTuple):
    """A ping, and what the map that the others made expects of it.

    Parameters
    ----------
    look : Look
        The ping.
    power : (bins,) array
        Expected power of each range bin, the receiver's noise included.
    """

    look: Look
    power: FloatArray


class MapByOthers:
    """Splits a map by whom its evidence comes from.

    Parameters
    ----------
    grid : TiledGrid
        The map; nothing in it is changed.
    tiles : Tiles
        Where its cells are.
    work : Workspace
        Scratch memory.
    power, alive, depth : float32 arrays
        Its layers: power of each quarter, cells with any, and their optical depth.
    scale : Scale
        How evidence becomes log-odds.
    bounds : Bounds
        Of evidence.
    opacity : float
        Of what is believed in.
    """

    def __init__(
        self,
        grid: TiledGrid,
        tiles: Tiles,
        work: Workspace,
        layers: tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]],
        scale: Scale,
        bounds: Bounds,
        opacity: float,
    ) -> None:
        self._tiles, self._work = tiles, work
        self._power, self._alive, self._depth = layers
        # What is compared is a part of what the map was made of.
        self._scale = scale._replace(threshold=PART_THRESHOLD * scale.threshold)
        self._bounds, self._opacity = bounds, opacity
        self._rows, self._columns, self._slots = grid.cells(self._alive > 0.0)

    def expected(self, looks: Mapping[str, Sequence[Look]]) -> dict[str, list[Expected]]:
        """What the map expects of each robot's pings by what the others' pings say.

        Parameters
        ----------
        looks : mapping of str to sequence of Look
            Pings of each robot.
        """
        evidence = {robot: self._evidence(pings) for robot, pings in looks.items()}
        found = {}
        for robot, pings in looks.items():
            others = [said for other, said in evidence.items() if other != robot]
            own, block = (np.zeros_like(self._alive) for _ in range(2))
            for said in others:
                own += said.own
                block += said.block
            believed, depth = self._believed(own, block)
            found[robot] = [self._expected(look, believed, depth) for look in pings]
        return found

    def _evidence(self, looks: Sequence[Look]) -> Evidence:
        """What some pings say of the cells of the map."""
        evidence = Evidence(*(np.zeros_like(self._alive) for _ in Evidence._fields))
        for look in looks:
            count = self._work.expect(look, self._tiles, self._depth, self._alive, self._power)
            _, seen, bins, parts = self._work.scratch
            prepare_bins(look, bins)
            add_evidence(look, seen, count, bins, parts, self._tiles, self._bounds, evidence)
        return evidence

    def _believed(
        self, own: NDArray[np.float32], block: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Cells that evidence speaks for, and how they hide what is behind them."""
        log_odds = np.full_like(self._alive, self._scale.least)
        hiding, depth = np.zeros_like(self._alive), np.zeros_like(self._alive)
        cells = (self._slots, self._rows, self._columns, self._tiles)
        judge(*cells, own, block, self._scale, log_odds)
        find_hiding(*cells, own, block, self._scale, hiding)
        set_depth(*cells, hiding, self._opacity, depth)
        return (log_odds > 0.0).astype(np.float32), depth

    def _expected(
        self, look: Look, among: NDArray[np.float32], depth: NDArray[np.float32]
    ) -> Expected:
        self._work.expect(look, self._tiles, depth, among, self._power)
        return Expected(look, self._work.scratch.bins.expected[: len(look.kind)].copy())
