"""What a map shows of a place, and what it has in common with another one.

Both maps are asked: what one holds for occupied ought to be so in the other, and speaks against a
match where that knows of free space.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt, gaussian_filter, map_coordinates

from usmap_ros.grids import FREE_VALUE, OCCUPIED_VALUE, GridGeometry, OccupancyMap
from usmap_ros.localisation.planar import between, compose
from usmap_ros.numerics.arrays import BoolArray, FloatArray

#: By how much what stands may seem to be elsewhere (standard deviation, m); of free space twice.
_OFF_M = 0.1
#: What stands in the other's free space speaks against a match by so much more than what both have
#: speaks for it.
_AGAINST = 4.0
#: Which side of what stands is free is seen within so much, m (standard deviation), where so much
#: of that is free, and farther away where less is: free space may end before a wall that is far
#: from where it was heard.  It is said of walls by so much of that side alone.
_SIDES_M, _ENOUGH_FREE, _SIDED = (0.2, 0.4, 0.8, 1.6), 0.1, 1.5
#: What stands counts by pieces of such a side, m: a pole is as much as so much of a wall.
_PIECE_M = 0.3
#: Steps of the refinement (m), and the turn that goes with the first ones (rad).
_FIRST_STEP_M, _LAST_STEP_M, _FIRST_TURN_RAD = 0.05, 0.01, math.radians(1.25)


@dataclass(frozen=True)
class Submap:
    """What a match looks at."""

    #: (n, 2) array: centres of occupied cells.
    places_m: FloatArray
    #: (n,) array: pieces that each is worth.
    weights: FloatArray
    #: (n, 2) array: towards the side that is free, of length 1 for walls that were heard from one
    #: side, 0 for poles.
    sides: FloatArray
    #: (3, rows, columns) array: what an occupied cell of another map counts here: 1 where something
    #: stands, less than 0 where it is free, 0 where nothing is known; and the sides of what stands,
    #: times that.
    worth: FloatArray
    #: Of `worth`.
    geometry: GridGeometry

    @classmethod
    def of(cls, occupancy: OccupancyMap) -> Submap:
        """From a map."""
        geometry, values = occupancy.geometry, occupancy.trinary()
        stands: BoolArray = values == OCCUPIED_VALUE
        places_m = geometry.cell_centers_m(*np.nonzero(stands))
        pieces = np.floor(places_m / _PIECE_M).astype(np.int64)
        _, piece, count = np.unique(pieces, axis=0, return_inverse=True, return_counts=True)
        weights, worth = 1.0 / count[piece.ravel()], np.zeros((3, *geometry.shape))
        if not stands.any():
            return cls(places_m, weights, np.zeros((0, 2)), worth, geometry)
        is_free, resolution_m = values == FREE_VALUE, geometry.resolution_m
        cells, nearest = distance_transform_edt(~stands, return_indices=True)
        sides = _sides(is_free, resolution_m)
        near = np.exp(-0.5 * (cells * resolution_m / _OFF_M) ** 2)
        far = 1.0 - np.exp(-0.125 * (cells * resolution_m / _OFF_M) ** 2)
        worth[0] = near - _AGAINST * is_free * far
        worth[1:] = near * sides[:, nearest[0], nearest[1]]
        return cls(places_m, weights, sides[:, stands].T, worth, geometry)

    def worth_at(self, places_m: FloatArray, sides: FloatArray) -> FloatArray:
        """What occupied cells at some places count, which are free on some sides, (n,)."""
        geometry = self.geometry
        cells = ((places_m - geometry.origin_m) / geometry.resolution_m - 0.5).T[::-1]
        worth, x, y = (
            map_coordinates(layer, cells, order=1, cval=0.0, prefilter=False)
            for layer in self.worth
        )
        # Two sides of a wall are not one.
        return np.asarray(worth + np.minimum(x * sides[:, 0] + y * sides[:, 1], 0.0))

    @property
    def centre_m(self) -> FloatArray:
        """Of what stands."""
        return np.asarray(self.places_m.mean(axis=0))

    @property
    def radius_m(self) -> float:
        """How far from there it reaches."""
        return float(np.hypot(*(self.places_m - self.centre_m).T).max())


def in_common(first: Submap, second: Submap) -> tuple[float, float]:
    """Pieces that stand in both of two maps of one frame, and in the other's free space.

    Whatever little shift or turn between them is best is made good first.
    """
    if not len(first.places_m) or not len(second.places_m):
        return 0.0, 0.0
    return counts(first, second, refined(first, second, np.zeros(3))[1])


def counts(first: Submap, second: Submap, change: FloatArray) -> tuple[float, float]:
    """Pieces that stand in both maps, and those that stand in the other's free space."""
    turn = turn_of(change[2])
    there = first.worth_at(second.places_m @ turn.T + change[:2], second.sides @ turn.T)
    back = second.worth_at((first.places_m - change[:2]) @ turn, first.sides @ turn)
    worth, weights = np.append(there, back), np.append(second.weights, first.weights)
    against = np.maximum(-worth, 0.0) / _AGAINST
    return float(np.maximum(worth, 0.0) @ weights), float(against @ weights)


def apart_m(places_m: FloatArray, change: FloatArray, other: FloatArray) -> float:
    """How far two matches put the same places from each other."""
    off_m = places_m @ (turn_of(change[2]) - turn_of(other[2])).T + change[:2] - other[:2]
    return math.sqrt(float(np.mean(np.sum(off_m**2, axis=1))))


def refined(
    first: Submap, second: Submap, change: FloatArray, held: FloatArray | None = None
) -> tuple[float, FloatArray]:
    """A change improved step by step, and what it counts.

    Parameters
    ----------
    first, second : Submap
        What is laid over each other.
    change : (3,) array
        Of the second one's frame in the first one's: x, y (m) and yaw (rad).
    held : (3,) array, optional
        How far it may be off there, about the centre of what stands in the second one (standard
        deviations): half the square of what it is moved by in these units counts against it.
    """
    about, weight = np.append(second.centre_m, 0.0), 0.0 if held is None else 1.0 / held
    start, step_m = compose(change, about), _FIRST_STEP_M
    best, at = pieces_of(first, second, change), start
    while step_m >= _LAST_STEP_M:
        steps = np.diag([step_m, step_m, _FIRST_TURN_RAD * step_m / _FIRST_STEP_M])
        has_moved = False
        for step in (*steps, *-steps):
            tried = at + step
            moved = pieces_of(first, second, compose(tried, between(about, np.zeros(3))))
            pieces = moved - 0.5 * float(np.sum(((tried - start) * weight) ** 2))
            if pieces > best:
                best, at, has_moved = pieces, tried, True
        if not has_moved:
            step_m *= 0.5
    return best, compose(at, between(about, np.zeros(3)))


def _sides(is_free: BoolArray, resolution_m: float) -> FloatArray:
    """Towards the side that is free, as vectors of length 1 at the most, (2, rows, columns)."""
    free, sides, left = is_free.astype(float), np.zeros((2, *is_free.shape)), np.ones(is_free.shape)
    for side_m in _SIDES_M:
        sigma = side_m / resolution_m
        around, *slope = (
            gaussian_filter(free, sigma, order=order, mode="constant")
            for order in ((0, 0), (0, 1), (1, 0))
        )
        # As a share of what it would be beside a wall, which parts what is free from what is not.
        scale = _SIDED * math.sqrt(0.5 * math.pi) * sigma / np.maximum(around, 1e-9)
        told = left * np.minimum(around / _ENOUGH_FREE, 1.0)
        sides += told * scale * slope / np.maximum(scale * np.hypot(*slope), 1.0)
        left = left - told
    return np.asarray(sides)


def turn_of(angle_rad: float) -> FloatArray:
    """Matrix of a turn."""
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[cosine, -sine], [sine, cosine]])


def pieces_of(first: Submap, second: Submap, change: FloatArray) -> float:
    """What counts for a match, less what counts against it."""
    both, against = counts(first, second, change)
    return both - _AGAINST * against
