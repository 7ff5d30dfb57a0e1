"""All that a recording tells of ranges, fitted together: sound speed, offset, floor, places.

An object at distance r from the transducer returns echoes that are L/2 away, with L the length of
a path: 2 r, r + u or 2 u, where u² = r² + (2 h)² is the leg over the floor.  Read with the sound
speed c₀ that messages state, while it is c in truth and ranges come out too long by δ, an echo
seems to be (c₀ / c) (L/2 + δ) away.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from usmap_ros.acoustics.propagation import FloorModel
from usmap_ros.calibration.echo_table import EchoTable
from usmap_ros.numerics.arrays import BoolArray, FloatArray, IndexArray

#: Where c₀ / c, δ (m) and h (m) are in the vector of unknowns; places follow.
SLOWNESS, OFFSET, HEIGHT, PLACES = 0, 1, 2, 3
#: How little is known beforehand of c₀ / c, offset and height: standard deviations.
UNKNOWN_SLOWNESS = 0.1
UNKNOWN_OFFSET_M = 0.5
_UNKNOWN_HEIGHT_M = 2.0
#: Of what is no unknown.
_FIXED_M = 1e-9
#: Error of a range that neither trace nor pose states.
_RANGE_ERROR_M = 0.001
#: Residuals beyond so many standard deviations count less and less.
_ROBUST_DEVIATIONS = 2.0


@dataclass(frozen=True)
class Model:
    """What explains the ranges."""

    #: c₀ / c, the stated sound speed over the true one.
    slowness: float
    #: By how much ranges come out too long.
    offset_m: float
    #: Height of the transducers above the floor; None: no floor is heard.
    floor_m: float | None
    #: (objects, 2) array: where objects stand.
    places_m: FloatArray
    #: (objects,) array: distance of their surface from there.
    radii_m: FloatArray
    #: (objects,) bool array: whether the place is known.
    is_fixed: BoolArray
    floor_model: FloorModel = FloorModel.IMAGE
    #: How far slowness may be from 1.
    slowness_std: float = UNKNOWN_SLOWNESS

    def having(self, objects: IndexArray) -> Model:
        """The same with some of the objects only."""
        return replace(
            self,
            places_m=self.places_m[objects],
            radii_m=self.radii_m[objects],
            is_fixed=self.is_fixed[objects],
        )

    def with_objects(self, places_m: FloatArray, radii_m: FloatArray, *, is_fixed: bool) -> Model:
        """The same with more objects, behind the others."""
        return replace(
            self,
            places_m=np.concatenate([self.places_m, places_m]),
            radii_m=np.append(self.radii_m, radii_m),
            is_fixed=np.append(self.is_fixed, np.full(len(places_m), is_fixed)),
        )

    @property
    def path_count(self) -> int:
        """Paths of different lengths to each object."""
        if self.floor_m is None:
            return 1
        return 2 if self.floor_model is FloorModel.CORNER else 3

    def half_paths_m(self, distance_m: FloatArray) -> FloatArray:
        """L/2 of every path, shape (..., paths)."""
        if self.floor_m is None:
            return np.asarray(distance_m)[..., np.newaxis]
        if self.floor_model is FloorModel.CORNER:
            return np.stack([distance_m, np.hypot(distance_m, self.floor_m)], axis=-1)
        over_m = np.hypot(distance_m, 2.0 * self.floor_m)
        return np.stack([distance_m, 0.5 * (distance_m + over_m), over_m], axis=-1)

    def path_slopes(
        self, distance_m: FloatArray, paths: IndexArray
    ) -> tuple[FloatArray, FloatArray]:
        """Change of L/2 of given paths with the distance, and with the floor's height."""
        height_m = self.floor_m or 0.0
        if self.floor_model is FloorModel.CORNER:
            corner_m = np.maximum(np.hypot(distance_m, height_m), 1e-6)
            by_floor = paths > 0
            return (
                np.where(by_floor, distance_m / corner_m, 1.0),
                np.where(by_floor, height_m / corner_m, 0.0),
            )
        over_m = np.maximum(np.hypot(distance_m, 2.0 * height_m), 1e-6)
        # Share of the path's half length that goes over the floor: 0, 1/2 or 1.
        share = 0.5 * paths
        return (1.0 - share) + share * distance_m / over_m, share * 4.0 * height_m / over_m

    def apparent_m(self, distance_m: FloatArray) -> FloatArray:
        """Where the echoes of objects at a distance seem to be, shape (..., paths)."""
        return self.slowness * (self.half_paths_m(distance_m) + self.offset_m)


@dataclass(frozen=True)
class EchoMatches:
    """Echoes that are explained, each array of shape (matches,)."""

    #: Which echo came from which object over which path (0: direct, 1: one way, 2: both ways; of a
    #: floor with corners 1: by the corner).
    echoes: IndexArray
    objects: IndexArray
    paths: IndexArray

    def where(self, kept: BoolArray) -> EchoMatches:
        """Some of them."""
        return EchoMatches(self.echoes[kept], self.objects[kept], self.paths[kept])


@dataclass(frozen=True)
class FittedModel:
    """A fitted model."""

    model: Model
    #: (3,) array: standard deviations of slowness, offset (m) and height (m).
    stds: FloatArray
    #: (matches,) array: residuals in units of what is expected of them.
    deviations: FloatArray

    def with_offset_of(self, other: FittedModel) -> FittedModel:
        """The same, with the offset and its standard deviation from another fit."""
        stds = self.stds.copy()
        stds[OFFSET] = other.stds[OFFSET]
        return replace(self, model=replace(self.model, offset_m=other.model.offset_m), stds=stds)


def fit(
    table: EchoTable, matches: EchoMatches, start: Model, *, offset_std_m: float = UNKNOWN_OFFSET_M
) -> FittedModel:
    """Least squares over all unknowns, with a loss that outliers cannot dominate.

    Parameters
    ----------
    table : EchoTable
        All echoes of the recording, with poses and pings.
    matches : EchoMatches
        What they came from.
    start : Model
        Where to start; what it says of fixed places and of having a floor stays.
    offset_std_m : float
        Standard deviation of the offset, around 0, as it is known beforehand.
    """
    problem = _Problem(table, matches, start, offset_std_m)
    # Here, because it takes a third of a second, and to look at a recording it is not needed.
    from scipy.optimize import least_squares

    solution = least_squares(
        problem.residuals,
        problem.start(),
        jac=problem.jacobian,
        loss="soft_l1",
        f_scale=_ROBUST_DEVIATIONS,
        x_scale="jac",
        max_nfev=50,
    )
    unknowns = np.asarray(solution.x, dtype=float)
    stds = problem.standard_deviations(unknowns)
    deviations = problem.residuals(unknowns)[: len(matches.echoes)]
    return FittedModel(problem.model(unknowns), stds, deviations)


class _Problem:
    """Residuals, in standard deviations, and their derivatives."""

    def __init__(
        self, table: EchoTable, matches: EchoMatches, start: Model, offset_std_m: float
    ) -> None:
        pings = table.pings[matches.echoes]
        self.matches, self._start = matches, start
        self.positions_m = table.positions_m[pings]
        self.apparent_m = table.ranges_m[matches.echoes]
        self.std_m = np.sqrt(
            table.range_stds_m[matches.echoes] ** 2
            + table.position_stds_m[pings] ** 2
            + _RANGE_ERROR_M**2
        )
        self._free_objects = np.flatnonzero(~start.is_fixed)
        height_std_m = _FIXED_M if start.floor_m is None else _UNKNOWN_HEIGHT_M
        self._prior_stds = np.array([start.slowness_std, offset_std_m, height_std_m])
        self._prior = np.array([1.0, 0.0, start.floor_m or 0.0])

    def start(self) -> FloatArray:
        model = self._start
        head = [model.slowness, model.offset_m, model.floor_m or 0.0]
        return np.concatenate([head, model.places_m[self._free_objects].reshape(-1)])

    def model(self, unknowns: FloatArray) -> Model:
        places_m = self._start.places_m.copy()
        places_m[self._free_objects] = unknowns[PLACES:].reshape(-1, 2)
        return replace(
            self._start,
            slowness=float(unknowns[SLOWNESS]),
            offset_m=float(unknowns[OFFSET]),
            floor_m=None if self._start.floor_m is None else float(unknowns[HEIGHT]),
            places_m=places_m,
        )

    def residuals(self, unknowns: FloatArray) -> FloatArray:
        model = self.model(unknowns)
        _, distance_m = self._legs(model)
        paths = model.half_paths_m(distance_m)[np.arange(len(distance_m)), self.matches.paths]
        apparent_m = model.slowness * (paths + model.offset_m)
        known = (unknowns[:PLACES] - self._prior) / self._prior_stds
        return np.concatenate([(apparent_m - self.apparent_m) / self.std_m, known])

    def jacobian(self, unknowns: FloatArray) -> FloatArray:
        model = self.model(unknowns)
        offset_m, distance_m = self._legs(model)
        path, count = self.matches.paths, len(distance_m)
        paths = model.half_paths_m(distance_m)[np.arange(count), path]
        slope, height_slope = model.path_slopes(distance_m, path)
        slopes = np.zeros((count + PLACES, len(unknowns)))
        slopes[:count, SLOWNESS] = paths + model.offset_m
        slopes[:count, OFFSET] = model.slowness
        slopes[:count, HEIGHT] = model.slowness * height_slope
        column = np.full(len(model.places_m), -1)
        column[self._free_objects] = PLACES + 2 * np.arange(len(self._free_objects))
        mine = column[self.matches.objects]
        free = np.flatnonzero(mine >= 0)
        distance_m = np.maximum(distance_m + model.radii_m[self.matches.objects], 1e-6)
        direction = offset_m / distance_m[:, np.newaxis]
        for axis in (0, 1):
            slopes[free, mine[free] + axis] = (model.slowness * slope * direction[:, axis])[free]
        slopes[:count] /= self.std_m[:, np.newaxis]
        slopes[count + np.arange(PLACES), np.arange(PLACES)] = 1.0 / self._prior_stds
        return slopes

    def standard_deviations(self, unknowns: FloatArray) -> FloatArray:
        """Of slowness, offset and height: the larger of what two estimates say.

        One takes residuals for independent, with the spread that they have.  The other lets all
        of an object's be off together, as they are where it is no point (the "sandwich" with
        objects as clusters; Liang & Zeger, Biometrika 73, 1986).
        """
        count = len(self.matches.echoes)
        slopes, residuals = self.jacobian(unknowns), self.residuals(unknowns)
        weights = 1.0 / np.sqrt(1.0 + (residuals / _ROBUST_DEVIATIONS) ** 2)
        weights[count:] = 1.0
        weighted = slopes * weights[:, np.newaxis]
        information = slopes.T @ weighted
        # Unknowns differ by many orders of magnitude in how well they are known.
        scale = 1.0 / np.sqrt(np.maximum(np.diagonal(information), 1e-12))
        scaled = information * scale * scale[:, np.newaxis] + 1e-12 * np.eye(len(scale))
        bread = np.linalg.inv(scaled) * scale * scale[:, np.newaxis]
        spread = max(1.0, 1.4826 * float(np.median(np.abs(residuals[:count])))) if count else 1.0
        variance = spread**2 * np.diagonal(bread)[:PLACES]
        scores = weighted[:count] * residuals[:count, np.newaxis]
        clusters = np.zeros((len(self._start.places_m), len(unknowns)))
        np.add.at(clusters, self.matches.objects, scores)
        objects = np.count_nonzero(np.bincount(self.matches.objects, minlength=1))
        if objects > 1:
            correction = objects / (objects - 1.0)
            between = correction * ((clusters @ bread[:, :PLACES]) ** 2).sum(axis=0)
            variance = np.maximum(variance, between)
        return np.sqrt(variance)

    def _legs(self, model: Model) -> tuple[FloatArray, FloatArray]:
        """Offset of each match's object from its ping, and distance of its surface."""
        offset_m = model.places_m[self.matches.objects] - self.positions_m
        distance_m = np.hypot(offset_m[:, 0], offset_m[:, 1])
        return offset_m, np.maximum(distance_m - model.radii_m[self.matches.objects], 0.0)
