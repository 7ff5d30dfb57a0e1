"""Fusion by superposition: a window of pings, explained together and gathered again in turn."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from usmap_ros.grids import OccupancyMap
from usmap_ros.mapping.export import LOG_ODDS
from usmap_ros.mapping.fusion import Fusion
from usmap_ros.mapping.grid import TILE_SIDE
from usmap_ros.mapping.superposition.cells import QUARTERS, Tiles
from usmap_ros.mapping.superposition.evidence_layers import (
    ALIVE,
    ATTRACTION,
    BELIEF,
    DEFAULTS,
    DEPTH,
    EVERYWHERE,
    EVIDENCE,
    GATHERED,
    HIDING,
    LASTING,
    LOOKS,
    POWER,
    PRESSURE,
    RELEVANT,
    SEVERAL,
    SHOWN,
    VACANCY,
    accumulators_of,
    layer_of,
    responsibilities_of,
)
from usmap_ros.mapping.superposition.first_pings import explain, set_first_log_odds
from usmap_ros.mapping.superposition.layers import Suspects
from usmap_ros.mapping.superposition.leave_one_out import LeaveOneOutMap
from usmap_ros.mapping.superposition.log_odds import (
    Scale,
    find_hiding,
    scale_of,
    set_depth,
    set_log_odds,
)
from usmap_ros.mapping.superposition.ping_bins import Look, look_of
from usmap_ros.mapping.superposition.ping_update import (
    Batch,
    CellState,
    Model,
    rules_of,
)
from usmap_ros.mapping.superposition.power_estimation import LEAST_POWER, Powers, seed_unexplained
from usmap_ros.mapping.superposition.responsibilities import Responsibilities
from usmap_ros.mapping.superposition.resuming import take_up_evidence
from usmap_ros.mapping.superposition.snapshot import CLEAR, SILENT, Snapshot
from usmap_ros.mapping.superposition.visible_cells import VisibleCells
from usmap_ros.mapping.superposition.window import Window
from usmap_ros.mapping.superposition.workspace import Workspace
from usmap_ros.numerics.arrays import IndexArray
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

#: A few pings need many passes to settle, many pings few: passes, and visits, for a new ping.
MOST_PASSES, EARLY_VISITS = 40, 60
#: In a full window, a ping that the map explains brings little news: it is followed by a part of
#: the visits only, one of so many.
SETTLED = 2
#: Earlier pings that are learnt from again at once when a new one cannot be explained.
RECENT = 3
#: Passes through the window after pings were taken out of it: what hid what is known after one.
PASSES_WITHOUT = 2
#: So few pings are explained from the start whenever there is one more, with so many passes to
#: see what is free.  Later this is done less and less often: each time after this share more.
FEW_PINGS, FIRST_PASSES, FRESH_STARTS = 6, 2, 0.5
#: More than a window can hold.
MANY_PINGS = 1 << 30
#: Of evidence that is not clamped: more would not fit a probability.
MOST_LOG_ODDS = 30.0
#: A cell that no ping of a pass has anything to say of is given up after so many looks.
FAIR_LOOKS = 3


class SuperpositionFusion(Fusion):
    """A map whose cells together explain the powers of all echoes of recent pings.

    Each new ping is followed by visits to earlier ones, in the order of their stamps and then
    from the start again.  A visit works out what the map expects of the ping, and gathers what
    the ping says of cells' being there and of free space; their powers are learnt at once.  When
    a pass through the window ends, beliefs are renewed, with them what hides what, and nothing of
    what was gathered under the old beliefs remains: silence too is gathered anew.

    Parameters
    ----------
    parameters : MappingParameters
        Of the model.
    """

    LASTING_LAYERS = (POWER,)

    def __init__(self, parameters: MappingParameters) -> None:
        super().__init__(parameters, DEFAULTS, SEVERAL)
        self._window = Window()
        self._next = 0
        # Size of the window at which its pings are explained from the start again.
        self._fresh_start = 1
        self._are_few = False
        # Whether there is evidence of pings that are not in the window, to explain them from.
        self._has_lasting = False
        self._work = Workspace()
        # Without occlusion everything is transparent.
        self._opacity = parameters.opacity if parameters.occlusion else 0.0
        self._rules, self._scale = rules_of(parameters), scale_of(parameters)

    # ------------------------------------------------------------------ a new ping

    def _take_up(self, cone: EchoCone, source: str) -> None:
        look = look_of(cone, self.parameters)
        self._cover(look)
        if len(self._window) == self.parameters.window:
            self._retire()
        is_explained = is_expected = self._suspect(look)
        self._window.append(look, source)
        if not self._has_lasting and len(self._window) >= self._fresh_start:
            self._start_over()
            is_expected = False
        if self._are_few:
            return
        pings = len(self._window)
        recent = 0 if is_explained else min(RECENT, pings - 1)
        self._send(pings - 1 - recent, pings, SHOWN, unheard=recent, is_expected=is_expected)
        early = min(MOST_PASSES * pings, EARLY_VISITS // pings)
        is_settled = is_explained and pings == self.parameters.window
        revisits = self.parameters.revisits // (SETTLED if is_settled else 1)
        self._visit(max(revisits, early))

    def _cover(self, look: Look) -> None:
        """Make tiles wherever the look reaches."""
        side_m, reach_m = TILE_SIDE * self.parameters.resolution_m, look.greatest_range_m
        (left, right), (top, bottom) = (
            (math.floor((center_m - reach_m) / side_m), math.ceil((center_m + reach_m) / side_m))
            for center_m in (look.x_m, look.y_m)
        )
        self._grid.cover(top, bottom, left, right)

    def _suspect(self, look: Look) -> bool:
        """Suspect every cell that may have returned an unexplained echo.

        Returns
        -------
        is_explained : bool
            Whether there is no such echo: what is expected of the look is known until another one
            is visited.
        """
        layer = self._grid.layer
        self._expect(look)
        found = self._work.find_sources(look, self._tiles(), layer(EVERYWHERE))
        if found is None:
            return True
        seed_unexplained(look, *found, self._work.scratch.bins, layer(POWER), layer(ALIVE))
        return False

    def _start_over(self) -> None:
        """Explain the pings so far from the start, if they are few enough."""
        layer, count = self._grid.layer, len(self._window)
        layer(DEPTH)[:] = 0.0
        explained = explain(self._window, self._find, len(layer(ALIVE)), self.parameters)
        self._are_few = explained is not None and count <= FEW_PINGS
        if explained is None:
            self._fresh_start = MANY_PINGS
            return
        self._fresh_start = count + max(1, round(FRESH_STARTS * (count - FEW_PINGS)))
        for name in (POWER, ATTRACTION, PRESSURE, LOOKS, ALIVE, HIDING):
            layer(name)[:] = 0.0
        layer(BELIEF)[:] = self._scale.least
        power = explained.power.astype(np.float32)
        layer(POWER).reshape(-1, QUARTERS)[explained.slots] = power
        layer(ALIVE)[explained.slots] = (power >= LEAST_POWER).any(axis=1)
        layer(VACANCY)[:] = 0.0
        layer(VACANCY)[explained.slots] = explained.vacancy
        self._next = 0
        self._visit(FIRST_PASSES * count)

    def _retire(self) -> None:
        """Let the oldest ping go, and what it said stay."""
        self._send(0, 1, LASTING, is_taught=False)
        self._window.pop_oldest()
        self._has_lasting, self._are_few = True, False
        self._next = max(self._next - 1, 0)

    def _forget_newest(self) -> None:
        """Let the newest ping go, and begin the pass anew."""
        self._window.pop_newest()
        self._next = 0

    def leave_out(self, is_left_out: Callable[[str], bool]) -> int:
        """Take some sources' pings out of the window, and explain the others without them.

        What pings said that have left the window stays.
        """
        pings = len(self._window)
        kept = self._window.without(is_left_out)
        if len(kept) == pings:
            return 0
        self._window, self._next = kept, 0
        if not kept:
            self._fresh_start = MANY_PINGS if self._has_lasting else 1
            self._begin_pass()
            self._end_pass()
        elif len(kept) <= FEW_PINGS and not self._has_lasting:
            self._start_over()
        else:
            self.refine(PASSES_WITHOUT)
        return pings - len(kept)

    # ------------------------------------------------------------------ visits

    def _visit(self, visits: int) -> None:
        """Visit the next pings of the pass, and begin another after the last."""
        while visits:
            if self._next == 0:
                self._begin_pass()
            end = min(self._next + visits, len(self._window))
            self._send(self._next, end, GATHERED, is_taught=not self._are_few)
            visits -= end - self._next
            self._next = end
            if end == len(self._window):
                self._end_pass()

    def refine(self, passes: int) -> None:
        """Go through the window a few times more, as it is done anyway while cones come in."""
        if passes and len(self._window):
            self._visit(passes * len(self._window) + (-self._next) % len(self._window))

    def _expect(self, look: Look) -> None:
        """Work out what the map expects of a ping."""
        layer = self._grid.layer
        self._work.expect(look, self._tiles(), layer(DEPTH), layer(ALIVE), layer(POWER))

    def _find(self, look: Look, among: NDArray[np.float32]) -> tuple[VisibleCells, int]:
        """Find the cells that a ping sees, of those that are not 0 in `among`."""
        return self._work.see(look, self._tiles(), self._grid.layer(DEPTH), among)

    def _send(
        self,
        first: int,
        end: int,
        stage: str,
        *,
        unheard: int = 0,
        is_taught: bool = True,
        is_expected: bool = False,
    ) -> None:
        """Visit pings of the window, from the first to the one before the end.

        Parameters
        ----------
        first, end : int
            Numbers of the first ping in the window, and of the one after the last.
        stage : str
            Of the evidence that what they say is added to.
        unheard : int
            From so many of them it is only learnt.
        is_taught : bool
            Whether powers are learnt.
        is_expected : bool
            Whether it is known what the map expects of the first.
        """
        layer, looks = self._grid.layer, self._window.looks
        state = CellState(
            depth=layer(DEPTH), log_odds=layer(BELIEF), clear=layer(layer_of(SHOWN, CLEAR))
        )
        powers = Powers(**{name: layer(name) for name in Powers._fields})
        least_news = 1.0 / (1 + len(self._window))
        batch = Batch(self._window.row(first), end - first, unheard, is_taught, least_news)
        model = Model(self._tiles(), state, powers, self._rules)
        self._work.visit(
            looks, batch, model, accumulators_of(layer, stage), is_expected=is_expected
        )

    def _begin_pass(self) -> None:
        """Gather anew, beside what pings said that have left the window."""
        layer = self._grid.layer
        for name in EVIDENCE:
            lasting = layer(layer_of(LASTING, name)) if self._has_lasting else 0.0
            layer(layer_of(GATHERED, name))[:] = lasting

    def _end_pass(self) -> None:
        """Show what the pass has gathered, and renew what hides what."""
        self._next = 0
        layer, tiles = self._grid.layer, self._tiles()
        for name in EVIDENCE:
            self._grid.exchange(layer_of(SHOWN, name), layer_of(GATHERED, name))
        alive = layer(ALIVE)
        given_up = np.flatnonzero(
            (alive > 0.0) & (layer(RELEVANT) == 0.0) & (layer(LOOKS) >= FAIR_LOOKS)
        )
        # What pings found that have left the window stays, though none is left to say it again.
        given_up = given_up[layer(layer_of(LASTING, "block"))[given_up] <= 0.0]
        layer(POWER).reshape(-1, QUARTERS)[given_up] = 0.0
        alive[given_up] = 0.0
        layer(LOOKS)[given_up] = 0.0
        layer(RELEVANT)[:] = 0.0
        layer(BELIEF)[:] = self._scale.least
        layer(HIDING)[:] = 0.0
        layer(DEPTH)[:] = 0.0
        suspected = rows, columns, slots = self._grid.cells(alive > 0.0)
        evidence = (layer(layer_of(SHOWN, "own")), layer(layer_of(SHOWN, "block")), self._scale)
        self._judge(suspected, self._scale, layer(BELIEF))
        find_hiding(slots, rows, columns, tiles, *evidence, layer(HIDING))
        set_depth(slots, rows, columns, tiles, layer(HIDING), self._opacity, layer(DEPTH))

    def _judge(
        self,
        suspected: tuple[IndexArray, IndexArray, IndexArray],
        scale: Scale,
        log_odds: NDArray[np.float32],
    ) -> None:
        """Set the log-odds of suspected cells by the evidence that is shown."""
        layer = self._grid.layer
        rows, columns, slots = suspected
        if self._are_few:
            set_first_log_odds(slots, rows, columns, self._tiles(), layer(VACANCY), scale, log_odds)
            return
        own, block = layer(layer_of(SHOWN, "own")), layer(layer_of(SHOWN, "block"))
        set_log_odds(slots, rows, columns, self._tiles(), own, block, scale, log_odds)

    def _tiles(self) -> Tiles:
        return Tiles(*self._grid.directory, self.parameters.resolution_m)

    # ------------------------------------------------------------------ robots

    def by_others(self) -> LeaveOneOutMap:
        """A copy of the map that tells what each robot owes to the others, in any thread."""
        copy = self._grid.copied({name: name for name in LeaveOneOutMap.LAYERS})
        return LeaveOneOutMap(copy, self.parameters, self._scale, self._rules.bounds, self._opacity)

    # ------------------------------------------------------------------ maps

    def snapshot(self) -> Callable[[], OccupancyMap]:
        """What makes the map as it is now, in its own time and in any thread."""
        layer, scale = self._grid.layer, self._scale
        suspected = self._grid.cells(layer(ALIVE) > 0.0)
        open_scale = scale._replace(least=-MOST_LOG_ODDS, greatest=MOST_LOG_ODDS)
        # The layer is of no other use here: what is kept is the evidence.
        self._judge(suspected, open_scale, layer(LOG_ODDS))
        slots = suspected[-1]
        log_odds = layer(LOG_ODDS)[slots]
        shown = responsibilities_of(layer, SHOWN)
        responsibilities = Responsibilities(*(values[slots] for values in shown))
        return Snapshot(
            self._grid.copied({CLEAR: layer_of(SHOWN, CLEAR), SILENT: layer_of(SHOWN, SILENT)}),
            Suspects(*suspected, log_odds, responsibilities),
            self._are_few, scale, self.parameters, self.frame_id, self.stamp_ns,
        ).occupancy_map  # fmt: skip

    def resume(self, occupancy: OccupancyMap) -> None:
        """Start from a map that was exported before.

        Raises
        ------
        ValueError
            If its resolution or origin does not fit this grid.
        """
        super().resume(occupancy)
        self._has_lasting = True
        take_up_evidence(self._grid, occupancy, self.parameters, self._scale)
