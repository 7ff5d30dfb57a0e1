"""The joint estimate of an area: powers, walls, and free space from all of its pings.

powers    ← multiplicative updates until they explain every echo and every silence
belief    ← how much worse the pings would be explained without each cell
walls     ← mirrors for echoes that no reliable cell explains, lines through believed cells
shadows   ← rays end at what is believed; and all of it again
response  ← how believed surfaces answer, by loudness and angle of incidence
free      ← where every way in which a surface could face is refuted, or sound came back through
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.cell_evidence import CellEvidence, no_evidence
from usmap_ros.mapping.joint.field import (
    BIN_M,
    GREATEST_RANGE,
    LEAST_RANGE,
    NOISE,
    RANGE_STD,
    Field,
    X,
    Y,
)
from usmap_ros.mapping.joint.lines import (
    NO_LINES,
    beyond_ends,
    drawn,
    off_line,
    points_on,
    without_doubles,
)
from usmap_ros.mapping.joint.log_odds import (
    cell_log_odds,
    hiding,
    judged,
    optical_depth,
    over_block,
)
from usmap_ros.mapping.joint.mirror_walls import Echoes, MirrorWall, mirror_walls
from usmap_ros.mapping.joint.open_space import prove_open, refute_all_surfaces, trace_open
from usmap_ros.mapping.joint.powers import Powers
from usmap_ros.mapping.joint.ray_casting import cast_all_rays
from usmap_ros.mapping.joint.response import NO_NORMAL, Response, learn_response, listen
from usmap_ros.mapping.joint.round_columns import RoundColumn, drawn_columns, round_columns
from usmap_ros.mapping.joint.surface_lines import surface_lines
from usmap_ros.mapping.looks import Looks
from usmap_ros.mapping.ping_bins import UNJUDGED
from usmap_ros.numerics.arrays import BoolArray, FloatArray

#: Sweeps before anything hides anything, after each of which what has no power goes; rounds of
#: shadows and sweeps, and sweeps in each.
FIRST_SWEEPS, ROUNDS, SWEEPS = (4, 4, 5), 6, 4
#: Rounds in which walls are found, and rounds of shadows in each.
WALL_ROUNDS, WALL_SHADOWS = 2, 2
#: Share of a belief in what hides that a round takes over: first, and with walls.
FIRST_DAMPING, WALL_DAMPING = 0.6, 0.7
#: Log-odds from which on a cell is shown as occupied, from which on it is where a line goes
#: through it, and from which on it is reliable: its echoes are explained.
SHOWN, ON_A_LINE, RELIABLE = 0.62, 0.0, 1.0
#: Ghosts lie beside a line, so many cells off it, and are so much less certain than its cells.
BESIDE_CELLS, GHOST_MARGIN = 4.0, 1.5
#: Pings whose ranges are less certain, by their poses, find no round columns, m.
MOST_RANGE_STD_M = 0.01
#: Range bins around a mirror's echo that say nothing of cells.
MIRROR_BINS = 2
#: Log-odds from which on a cell that is not shown is not free either.
SUSPECTED = -0.5
#: Rounds of free space; optical depth of what is occupied, of what may be, and opacity.
FREE_ROUNDS, OCCUPIED, FREE_OPACITY = 4, 0.97, 2.0
#: Log-likelihood ratio at which a cell is refuted, and belief that unknown ones hide what is behind
#: them: among lone things, and among walls.
LONE, WALLED = (-1.3, 0.02), (-2.5, 0.1)
#: Share of occupied cells on lines at which a place is one of walls.
WALLED_SHARE = 0.3
#: Within this distance of where a robot stood nothing else stands.
STOOD_M = 0.12
#: Walls may go on beyond their ends so far, m.
GOING_ON_M = 0.2
#: Range bins, in cells, to either side of a cell's that belong to it.
LISTENING_CELLS = 0.75


@dataclass(frozen=True)
class Walls:
    """Cells that are shown as occupied, and the lines that they are on.

    Parameters
    ----------
    occupied, filled : (rows, columns) bool arrays
        Cells by their own evidence, and cells that lines go through.
    lines, mirrors : (lines, 5) arrays
        See `usmap_ros.mapping.joint.lines`.
    """

    occupied: BoolArray
    filled: BoolArray
    lines: FloatArray
    mirrors: FloatArray

    @property
    def all_lines(self) -> FloatArray:
        """Lines of both kinds."""
        return np.concatenate([self.lines, self.mirrors])

    @property
    def shown(self) -> BoolArray:
        """All that is occupied."""
        return self.occupied | self.filled


class JointEstimate:
    """All that some pings say together.

    Parameters
    ----------
    looks : Looks
        Pings; `kind` is changed where mirrors explain echoes.
    pings : (pings,) integer array
        Rows of those that count, in the order of their stamps.
    weights : (pings,) float32 array
        How much each counts.
    echoes : Echoes
        Their echoes.
    field : Field
        The cells.
    opacity : float
        Optical depth of a cell, over -ln(1 - p).
    forgetting : float
        Share of what speaks for a cell that is forgotten with a ping that contradicts it.
    standing : (rows, columns) bool array, optional
        Cells that are known to be occupied from before.
    gap_m : float
        Widest gap in a run of believed cells that counts as wall; 0: nothing is filled.
    proofs : float
        Pings whose sound must have come back through a cell, to prove that it is free.
    first_only : (pings,) bool array, optional
        Pings of sensors that report the first thing only: no smooth thing is needed to explain
        what they hear.
    """

    def __init__(  # noqa: PLR0913, PLR0917
        self,
        looks: Looks,
        pings: NDArray[np.int64],
        weights: NDArray[np.float32],
        echoes: Echoes,
        field: Field,
        opacity: float = 1.0,
        forgetting: float = 0.0,
        standing: BoolArray | None = None,
        gap_m: float = 0.5,
        proofs: float = 3.0,
        first_only: BoolArray | None = None,
    ) -> None:
        self.looks, self.pings, self.weights, self.echoes = looks, pings, weights, echoes
        self.field, self._opacity, self._forgetting = field, opacity, forgetting
        self._gap_m, self._proofs = gap_m, proofs
        self._first_only = np.zeros(len(pings), bool) if first_only is None else first_only
        self._standing = np.zeros(field.shape, bool) if standing is None else standing
        self._powers = Powers(looks, pings, weights, field)
        numbers = looks.numbers[pings]
        self._stood = field.cells_within(numbers[:, X], numbers[:, Y], STOOD_M)
        self.evidence: CellEvidence = no_evidence(field)
        self.depth = np.zeros(field.shape, np.float32)
        self._hiding: FloatArray = np.zeros(field.shape)
        self.mirrors: list[MirrorWall] = []
        self.columns: list[RoundColumn] = []
        self.response: Response | None = None

    # ------------------------------------------------------------------ powers and belief

    def estimate(self, more_rounds: int = 0) -> Walls:
        """Find powers, beliefs and walls.

        Parameters
        ----------
        more_rounds : int
            Beyond `ROUNDS`.
        """
        self.estimate_powers(ROUNDS + more_rounds)
        self._find_smooth_things()
        self._take_out_smooth_things()
        for _ in range(WALL_ROUNDS):
            filled = self.walls().filled
            for _ in range(WALL_SHADOWS):
                self._cast_shadows(filled, WALL_DAMPING)
        return self.walls()

    def estimate_powers(self, rounds: int, between: Callable[[], None] = lambda: None) -> None:
        """Find powers and beliefs alone.

        Parameters
        ----------
        rounds : int
            Of shadows.
        between : callable
            Called between pieces of work.
        """
        self._powers.start()
        for sweeps in FIRST_SWEEPS:
            self._powers.sweep(sweeps)
            self._powers.renew_shadows(self.depth)
        no_walls = np.zeros(self.field.shape, bool)
        self._weigh()
        for _ in range(rounds):
            between()
            self._cast_shadows(no_walls, FIRST_DAMPING)

    def evidence_of(self, some: BoolArray) -> CellEvidence:
        """What some of the pings say of the cells by themselves, by the powers of all.

        Parameters
        ----------
        some : (pings,) bool array
            Those that count.
        """
        weights: NDArray[np.float32] = np.where(some, self.weights, np.float32(0.0))
        return self._powers.weigh(0.0, weights)

    @property
    def power(self) -> NDArray[np.float32]:
        """Powers of the quarters of all cells."""
        return self._powers.power

    @property
    def expected(self) -> NDArray[np.float32]:
        """λ of each range bin of each ping."""
        return self._powers.expected

    def _weigh(self) -> None:
        """Gather the evidence of all cells."""
        self.evidence = self._powers.weigh(self._forgetting)

    def _cast_shadows(self, walls: BoolArray, damping: float) -> None:
        """Renew what hides what by the evidence, then powers, then the evidence."""
        belief = hiding(self.evidence, self.field.shape, walls | self._standing)
        self._hiding = (1.0 - damping) * self._hiding + damping * belief
        self.depth = optical_depth(self._hiding, self._opacity)
        self._powers.renew_shadows(self.depth)
        self._powers.sweep(SWEEPS)
        self._weigh()

    # ------------------------------------------------------------------ walls

    def _explained(self) -> BoolArray:
        """Whether reliable cells explain at least half of each echo's power."""
        log_odds = cell_log_odds(self.evidence, self.field.shape)
        expected = self._powers.expected_of((log_odds > RELIABLE).ravel())
        index, bins, inside = self._echo_bins
        rows = self.pings[index]
        noise = self.looks.numbers[rows, NOISE]
        share = (expected[index, bins] - noise) / np.maximum(self.looks.power[rows, bins], 1e-12)
        explained: BoolArray = inside & (share > 0.5)
        return explained

    @cached_property
    def _echo_bins(self) -> tuple[NDArray[np.int64], NDArray[np.int64], BoolArray]:
        """Ping and range bin of each echo, and whether it is within its ping's bins."""
        index = np.repeat(np.arange(len(self.pings)), np.diff(self.echoes.start))
        numbers = self.looks.numbers[self.pings[index]]
        place = np.floor((self.echoes.range_m - numbers[:, LEAST_RANGE]) / numbers[:, BIN_M])
        inside = (place >= 0) & (place < self.looks.bins[self.pings[index]])
        return index, np.where(inside, place, 0).astype(np.int64), inside

    def _find_smooth_things(self) -> None:
        """Find mirrors, and round columns, by echoes that no reliable cell explains."""
        explained = self._explained() | np.repeat(self._first_only, np.diff(self.echoes.start))
        self.mirrors = mirror_walls(self.looks, self.pings, self.echoes, explained)
        for wall in self.mirrors:
            explained[wall.echoes] = True
        # What scatters as much as its radius may be is no circle.
        uncertain = self.looks.numbers[self.pings, RANGE_STD] > MOST_RANGE_STD_M
        explained |= np.repeat(uncertain, np.diff(self.echoes.start))
        left = cast_all_rays(self.looks, self.pings, self.field, self.depth)
        self.columns = round_columns(
            self.looks, self.pings, self.echoes, explained, self.field, left
        )

    def _smooth_echoes(self) -> Iterator[tuple[int, int]]:
        """Ping and echo of whatever smooth things explain."""
        things: list[MirrorWall | RoundColumn] = [*self.mirrors, *self.columns]
        for thing in things:
            yield from zip(thing.pings.tolist(), thing.echoes.tolist(), strict=True)

    def _take_out_smooth_things(self) -> None:
        """Let the echoes of smooth things say nothing of cells."""
        _, bins, inside = self._echo_bins
        for ping, echo in self._smooth_echoes():
            if inside[echo]:
                first = max(0, bins[echo] - MIRROR_BINS)
                row = self.pings[ping]
                self.looks.kind[row, first : bins[echo] + MIRROR_BINS + 1] = UNJUDGED

    def walls(self) -> Walls:
        """Cells that are shown, and lines through them, by today's evidence."""
        log_odds = cell_log_odds(self.evidence, self.field.shape)
        believed = log_odds > ON_A_LINE
        lines = without_doubles(
            surface_lines(log_odds, believed, self._gap_m / self.field.resolution_m)
        )
        mirrors = np.array([wall.line(self.field) for wall in self.mirrors]).reshape(-1, 5)
        rows, columns = np.nonzero(believed)
        certain = log_odds[rows, columns]
        on_line, is_ghost = (np.zeros(len(rows), bool) for _ in range(2))
        for line in np.concatenate([lines, mirrors]):
            across, along = off_line(line, rows, columns)
            beside = (along >= line[3] - 1.0) & (along <= line[4] + 1.0)
            on = beside & (np.abs(across) <= 1.3)
            usual = float(np.median(certain[on])) if on.any() else 2.0
            off = beside & ~on & (np.abs(across) <= BESIDE_CELLS)
            on_line |= on
            is_ghost |= off & (certain < usual + GHOST_MARGIN)
        kept = on_line | ((certain > SHOWN) & ~is_ghost)
        occupied = np.zeros(self.field.shape, bool)
        occupied[rows[kept], columns[kept]] = True
        filled = drawn(lines, self.field.shape) | drawn(mirrors, self.field.shape)
        filled |= drawn_columns(self.columns, self.field)
        occupied, filled = occupied & ~self._stood, filled & ~self._stood
        return Walls(occupied, filled, lines if len(lines) else NO_LINES, mirrors)

    # ------------------------------------------------------------------ free space

    def free_space(self, walls: Walls) -> BoolArray:
        """Cells that are free.

        Parameters
        ----------
        walls : Walls
            What stands.
        """
        field, occupied = self.field, walls.shown
        hides = occupied | self._standing
        listening = listen(
            self.looks, self.pings, self._with_smooth_things(), max(1, self._listening_bins())
        )
        depth = optical_depth(np.where(hides, OCCUPIED, 0.0), FREE_OPACITY)
        left = cast_all_rays(self.looks, self.pings, field, depth)
        surfaces, on_lines = self._surfaces(walls)
        self.response = learn_response(self.looks, self.pings, field, left, listening, surfaces)
        proven = self._proven(occupied, left) >= self._proofs
        numbers = self.looks.numbers[self.pings]
        away_m = self._away_m
        wanted = (away_m < numbers[:, GREATEST_RANGE].max()) & ~occupied
        stood = self._stood & ~occupied
        belief = cell_log_odds(self.evidence, field.shape)
        suspected = (belief > SUSPECTED) & ~occupied
        closed = suspected | beyond_ends(walls.all_lines, occupied, GOING_ON_M / field.resolution_m)
        walled = min(
            np.count_nonzero(occupied & on_lines) / max(1, occupied.sum()) / WALLED_SHARE, 1.0
        )
        refuted, unknown = (
            (1.0 - walled) * lone + walled * among for lone, among in zip(LONE, WALLED, strict=True)
        )
        free, worst = np.zeros(field.shape, bool), np.zeros(field.shape, np.float32)
        changed = np.ones(len(self.pings), bool)
        for turn in range(FREE_ROUNDS):
            refute_all_surfaces(
                self.looks, self.pings, field, left, listening, self.response.log_silent, wanted,
                changed, worst,
            )  # fmt: skip
            free = (wanted & ((worst < refuted) | proven) & ~closed) | stood
            if turn < FREE_ROUNDS - 1:
                # What was not refuted while all was open is not when less is.
                wanted &= free | proven | closed
                belief = np.where(hides & ~free, OCCUPIED, np.where(free, 0.0, unknown))
                depth, before = optical_depth(belief, FREE_OPACITY), left
                left = cast_all_rays(self.looks, self.pings, field, depth)
                changed = (left != before).any(axis=(1, 2))
        return free

    @cached_property
    def _away_m(self) -> FloatArray:
        """Distance of each cell from where robots stood."""
        # Whoever only looks at recordings need not wait for it.
        from scipy.ndimage import distance_transform_edt

        numbers = self.looks.numbers[self.pings]
        away: FloatArray = distance_transform_edt(
            ~self.field.cells_at(numbers[:, X], numbers[:, Y])
        )
        return away * self.field.resolution_m

    def _listening_bins(self) -> int:
        bin_m = float(np.median(self.looks.numbers[self.pings, BIN_M]))
        return round(LISTENING_CELLS * self.field.resolution_m / bin_m)

    def _with_smooth_things(self) -> NDArray[np.float32]:
        """Expected powers, with what smooth things return."""
        expected = self.expected.copy()
        _, bins, inside = self._echo_bins
        for ping, echo in self._smooth_echoes():
            if inside[echo]:
                around = slice(max(0, bins[echo] - MIRROR_BINS), bins[echo] + MIRROR_BINS + 1)
                limits = self.looks.limit[self.pings[ping], around]
                here = expected[ping, around]
                here[:] = np.maximum(here, 100.0 * limits[: len(here)])
        return expected

    def _surfaces(self, walls: Walls) -> tuple[FloatArray, BoolArray]:
        """Row, column and normal of what stands; and cells near lines."""
        found, near = [], np.zeros(self.field.shape, bool)
        row_count, column_count = self.field.shape
        for line in walls.all_lines:
            rows, columns = points_on(line, line[3], line[4])
            normal = float(np.arctan2(line[1], line[0]))
            for row, column in dict.fromkeys(zip(rows.tolist(), columns.tolist(), strict=True)):
                if 1 <= row < row_count - 1 and 1 <= column < column_count - 1:
                    found.append((row, column, normal))
                    near[row - 1 : row + 2, column - 1 : column + 2] = True
        strength = judged(self.evidence, self.field.shape)
        peaks = walls.occupied & ~near & (strength >= over_block(strength))
        found += [(row, column, NO_NORMAL) for row, column in np.argwhere(peaks)]
        return np.array(found, dtype=float).reshape(-1, 3), near

    def _proven(self, occupied: BoolArray, left: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Pings whose sound is known to have passed each cell."""
        proven = np.zeros(self.field.shape, np.float32)
        prove_open(
            self.looks, self.pings, self.field, left, self.expected, self.power, occupied, proven,
            self.weights,
        )  # fmt: skip
        last = np.full(self.field.shape, -1, np.int32)
        for wall in self.mirrors:
            for ping, echo in zip(wall.pings, wall.echoes, strict=True):
                numbers = self.looks.numbers[self.pings[ping]]
                way_m = self.echoes.range_m[echo] - 1.5 * self.field.resolution_m
                trace_open(
                    numbers[X], numbers[Y], wall.normal_rad, way_m, self.field, int(ping), last,
                    proven, self.weights[ping],
                )  # fmt: skip
        for column in self.columns:
            for ping, echo in zip(column.pings, column.echoes, strict=True):
                x_m, y_m = self.looks.numbers[self.pings[ping], [X, Y]]
                angle_rad = math.atan2(column.y_m - y_m, column.x_m - x_m)
                way_m = self.echoes.range_m[echo] - 1.5 * self.field.resolution_m
                trace_open(
                    x_m, y_m, angle_rad, way_m, self.field, int(ping), last, proven,
                    self.weights[ping],
                )  # fmt: skip
        return proven
