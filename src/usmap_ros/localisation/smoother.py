"""Poses of all pings together with what they hear."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.ndimage import gaussian_filter

from usmap_ros.localisation.arcs import (
    MOST_SAMPLES,
    Field,
    Pulls,
    deposit,
    expect,
    pull_poses,
)
from usmap_ros.localisation.echo_table import Echoes
from usmap_ros.localisation.equations import (
    ScaleEquation,
    chain,
    covariances,
    found_spread,
    log_information,
    odometry_cost,
    on_knots,
    solve,
    solve_chain,
)
from usmap_ros.localisation.landmarks import Equations, Knots, eliminate
from usmap_ros.localisation.planar import compose
from usmap_ros.localisation.tracks import Track
from usmap_ros.localisation.wall_equations import WallEquations
from usmap_ros.localisation.walls import Walls, share_out
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.geometry import wrapped

#: Side of a field's cell, m, and the most cells, beyond which they are larger.
_CELL_M, _MOST_CELLS = 0.04, 8_000_000
#: Echoes that nothing known explains, relative to the peak of a place that every look hears.
_BACKGROUND = 0.5
#: Least weight of echoes.
_LEAST_WEIGHT = 0.03
#: Weight of an echo of a wall: what it is off, it is off for several pings alike.
_WALL_WEIGHT = 0.5
#: Pings that a place must be shared by.
_SHARED_BY = 2.0
#: Knots are not moved farther at once, m.
_LARGEST_STEP_M = 0.3
#: The field's filter ends so many standard deviations away.
_TRUNCATE = 3.0
#: Pulls for which there is room, for each echo.
_PULLS = 40


class Smoother:
    """Poses of tracks, and the field of what all of them hear.

    Parameters
    ----------
    tracks : sequence of Track
        Of the robots.
    echoes : Echoes
        Of all pings.
    """

    def __init__(self, tracks: Sequence[Track], echoes: Echoes) -> None:
        self.tracks, self.echoes = list(tracks), echoes
        self.poses = np.zeros((sum(len(track.rows) for track in tracks), 3))
        for track in tracks:
            self.poses[track.rows] = track.told
        self.knots = [track.told[track.knots].copy() for track in tracks]
        self._free = [number for number, track in enumerate(tracks) if not track.is_fixed]
        self._number_knots()
        self._corner_m, self.cell_m, shape = self._grid()
        self.weight = _LEAST_WEIGHT
        self.shares = np.zeros((len(echoes.ping), MOST_SAMPLES), np.float32)
        self.density = np.zeros(shape)
        self.active = np.zeros(len(self.poses), np.bool_)
        room = _PULLS * len(echoes.ping) + 1000
        self._pulls = Pulls(
            np.zeros(room, np.int64), np.zeros(room, np.int64), *np.zeros((3, room))
        )
        self._likelihood = 0.0
        self._pulled = 0

    def _number_knots(self) -> None:
        """Number the knots of all tracks that may move, and find each ping's."""
        self.knot = np.full(len(self.poses), -1, np.int64)
        self.share, self.first = np.zeros(len(self.poses)), {}
        count = 0
        for number in self._free:
            track = self.tracks[number]
            before, share = track.shares()
            self.first[number] = count
            self.knot[track.rows], self.share[track.rows] = count + before, share
            count += len(track.knots)
        self.knot_count = count

    def _grid(self) -> tuple[FloatArray, float, tuple[int, int]]:
        """Cells that hold all that is heard, were it drifted by as much again."""
        reach_m = float(self.echoes.range_m.max(initial=0.0)) + 1.5
        low = self.poses[:, :2].min(axis=0) - reach_m
        sides_m = self.poses[:, :2].max(axis=0) + reach_m - low
        cell_m = max(_CELL_M, math.sqrt(float(sides_m.prod()) / _MOST_CELLS))
        columns, rows = (int(count) for count in np.ceil(sides_m / cell_m))
        return low, cell_m, (rows, columns)

    def field(self, density: FloatArray, sigma_m: float) -> Field:
        """A density of echoes with the cells that it is of."""
        background = _BACKGROUND / (math.sqrt(2.0 * math.pi) * sigma_m)
        x_m, y_m = map(float, self._corner_m)
        return Field(density, x_m, y_m, self.cell_m, sigma_m, background)

    def blurred(self, heard: FloatArray, sigma_m: float) -> FloatArray:
        """Shares by cell as a field, echoes per square metre."""
        cell_m = self.cell_m
        return np.asarray(
            gaussian_filter(
                heard / cell_m**2, sigma_m / cell_m, mode="constant", truncate=_TRUNCATE
            )
        )

    def map(self, sigma_m: float) -> None:
        """Share out the echoes of active pings by the field, and make the field of the shares."""
        coarse, field = max(1, round(sigma_m / self.cell_m)), self.field(self.density, sigma_m)
        self._pulled, self._likelihood = expect(
            field, self.poses, self.active, self.echoes, coarse, self.shares, self._pulls
        )
        self.density = self.blurred(self.heard_by(self.active), sigma_m)

    def extend(self, sigma_m: float, news: BoolArray) -> None:
        """Share out the echoes of some pings only, and take them into the field."""
        field = self.field(self.density, sigma_m)
        expect(field, self.poses, news, self.echoes, 1, self.shares, self._pulls)
        self.density = self.blurred(self.heard_by(self.active), sigma_m)

    def shared(self) -> float:
        """Share of the echoes that come from places which several pings share.

        Much of what points such as poles return; walls answer from other places at each look.
        """
        cells, weights = self._pulls.cell[: self._pulled], self._pulls.weight[: self._pulled]
        if not len(cells):
            return 0.0
        _, place = np.unique(cells, return_inverse=True)
        is_shared = np.bincount(place, weights)[place] > _SHARED_BY
        return float(weights[is_shared].sum() / weights.sum())

    def trust(self, weight: float) -> None:
        """Set how much an echo counts: 1 if its range had no error but that of the field's blur."""
        self.weight = max(_LEAST_WEIGHT, weight)

    def log_posterior(self, sigma_m: float, rounds: int = 3) -> float:
        """How likely poses are by odometry and all echoes, up to a constant."""
        for _ in range(rounds):
            self.map(sigma_m)
        return self.weight * self._likelihood - 0.5 * self._odometry_cost()

    def log_posterior_of(self, walls: Walls, sigma_m: float) -> float:
        """The same by odometry and walls, of which each costs what its two unknowns are worth.

        That is by the Bayesian information criterion: or poses that are wrong would see a wall
        twice and explain as much.
        """
        heard = share_out(self.echoes, self.poses, self.active, walls, sigma_m)
        cost = len(walls.normals_rad) * math.log(max(len(self.poses), 1))
        return _WALL_WEIGHT * heard.log_likelihood - cost - 0.5 * self._odometry_cost()

    def _odometry_cost(self) -> float:
        return sum(odometry_cost(self.tracks[n], self.knots[n]) for n in self._free)

    def spread(self) -> None:
        """Bring all poses in line with the knots, and the scales of odometry."""
        for number in self._free:
            track = self.tracks[number]
            ScaleEquation.of(track, self.knots[number]).fit(track)
            self.poses[track.rows] = track.poses(self.knots[number])

    def adjust(self, sigma_m: float) -> FloatArray:
        """Improve all knots and all landmarks together, by a Gauss-Newton step.

        Returns
        -------
        (knots, 3, 3) array
            Covariances of the knots.
        """
        self.map(sigma_m)
        size = 3 * self.knot_count
        matrix, right = np.zeros((size, size)), np.zeros(size)
        order = np.argsort(self._pulls.cell[: self._pulled], kind="stable")
        knots, equations = Knots(self.knot, self.share), Equations(matrix, right, sigma_m)
        eliminate(self._pulls, order, self.echoes, self.poses, knots, equations)
        matrix *= self.weight
        right *= self.weight
        _, factor = self._solve(matrix, right)
        return covariances(factor, self.knot_count)

    def adjust_to(self, walls: Walls, sigma_m: float) -> tuple[Walls, tuple[FloatArray, bool]]:
        """Improve all knots and walls together, by a Gauss-Newton step.

        Returns
        -------
        Walls
            Where they are then.
        factor
            Decomposition for `covariances`.
        """
        heard = share_out(self.echoes, self.poses, self.active, walls, sigma_m)
        equations = WallEquations(
            walls, heard, self.echoes, self.poses, Knots(self.knot, self.share), self.knot_count,
            _WALL_WEIGHT / sigma_m**2,
        )  # fmt: skip
        size = 3 * self.knot_count
        matrix, right = np.zeros((size, size)), np.zeros(size)
        equations.add(matrix, right)
        change, factor = self._solve(matrix, right)
        return equations.moved(change), factor

    def weigh_odometry(self, factor: tuple[FloatArray, bool]) -> None:
        """Find out how well the odometry of each robot is known, by how far echoes have it off.

        Parameters
        ----------
        factor
            Decomposition of the last adjustment.
        """
        for number, first in self.first.items():
            track, knots = self.tracks[number], self.knots[number]
            if len(knots) > 1:
                known = covariances(factor, len(knots) - 1, first, together=2)
                track.spread = found_spread(track, knots, known)

    def left_open(self, factor: tuple[FloatArray, bool]) -> float:
        """Occam's factor: how much narrower echoes make what odometry left open, as a logarithm.

        Parameters
        ----------
        factor
            Decomposition of the last adjustment.
        """
        narrowed = float(np.log(np.diagonal(factor[0])).sum())
        return narrowed - sum(log_information(self.tracks[number]) for number in self._free)

    def _solve(
        self, matrix: FloatArray, right: FloatArray
    ) -> tuple[FloatArray, tuple[FloatArray, bool]]:
        """Add odometry, and move knots to where the equations have them."""
        for number in self._free:
            self._add_odometry(number, matrix, right)
        change, factor = solve(matrix, right)
        farthest_m = float(np.abs(change[:, :2]).max(initial=0.0))
        change *= min(1.0, _LARGEST_STEP_M / max(farthest_m, 1e-9))
        self.move(change)
        return change, factor

    def _add_odometry(self, number: int, matrix: FloatArray, right: FloatArray) -> None:
        blocks, above, pull = chain(self.tracks[number], self.knots[number])
        first = 3 * self.first[number]
        for row, block in enumerate(blocks):
            at = first + 3 * row
            matrix[at : at + 3, at : at + 3] += block
            right[at : at + 3] += pull[row]
            if row < len(above):
                matrix[at : at + 3, at + 3 : at + 6] += above[row]
                matrix[at + 3 : at + 6, at : at + 3] += above[row].T
        own = slice(first, first + 3 * len(blocks))
        scale = ScaleEquation.of(self.tracks[number], self.knots[number])
        scale.eliminate(matrix[own, own], right[own])

    def move(self, change: FloatArray) -> None:
        """Change all knots that may move."""
        for number in self._free:
            first = self.first[number]
            knots = self.knots[number]
            knots += change[first : first + len(knots)]
            knots[:, 2] = wrapped(knots[:, 2])
        self.spread()

    def pull(
        self, heard: FloatArray, wanted: BoolArray, sigma_m: float
    ) -> tuple[FloatArray, FloatArray]:
        """How what others heard draws the places of wanted pings; see `pull_poses`."""
        information = np.zeros((len(self.poses), 2, 2))
        gradient = np.zeros((len(self.poses), 2))
        field = self.field(self.blurred(heard, sigma_m), sigma_m)
        pull_poses(field, self.poses, wanted, self.echoes, information, gradient)
        return self.weight * information, self.weight * gradient

    def heard_by(self, wanted: BoolArray) -> FloatArray:
        """Shares of wanted pings' echoes by cell."""
        heard = np.zeros_like(self.density)
        # Of the field only its cells matter.
        field = self.field(self.density, self.cell_m)
        deposit(field, self.poses, wanted, self.echoes, self.shares, heard)
        return heard

    def predict(self, number: int, knot: int) -> None:
        """Let the knots behind one follow odometry from it."""
        track, knots = self.tracks[number], self.knots[number]
        for at in range(knot, len(knots) - 1):
            knots[at + 1] = compose(knots[at], track.increments[at])

    def match(
        self, number: int, first: int, last: int, pulls: tuple[FloatArray, FloatArray]
    ) -> None:
        """Improve the knots of a track from `first`, which is held, to `last`."""
        track = self.tracks[number]
        knots = self.knots[number][first : last + 1]
        is_whole = first == 0 and last == len(track.knots) - 1
        blocks, above, right = chain(track, knots, first, is_held=not is_whole)
        own = self.knot[track.rows] - self.first[number]
        rows = track.rows[(own >= first) & (own < max(last, 1))]
        on_knots(
            self.knot[rows] - self.first[number] - first, self.share[rows],
            pulls[0][rows], pulls[1][rows], blocks, above, right,
        )  # fmt: skip
        knots += solve_chain(blocks, above, right)
        knots[:, 2] = wrapped(knots[:, 2])
