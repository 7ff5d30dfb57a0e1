"""Walls as mirrors: the image sources of first order.

"As long as multi-path or other phenomena can be modeled, they can be incorporated into the
observation matrix" (Sanchez & Andersson, DSCC 2018-9140, section 4, which models the floor and
leaves walls).  A leg from a transducer to a point by way of a wall is as long as the straight line
from the transducer's mirror image, and leaves towards the point's mirror image; Allen & Berkley,
"Image method for efficiently simulating small-room acoustics", J. Acoust. Soc. Am. 65 (1979)
943-950.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.geometry import left_normals

#: What is nearer to a wall than this belongs to it, and is not seen in it.
_ON_WALL_M = 1e-3


@dataclass(frozen=True)
class Mirrors:
    """Upright plane walls that reflect, on either side."""

    #: (walls, 2) arrays: x, y of their ends.
    starts_m: FloatArray
    ends_m: FloatArray
    #: (walls,) array: amplitude reflectivity, 0 to 1.
    reflectivities: FloatArray

    @classmethod
    def none(cls) -> Mirrors:
        """No walls at all."""
        return cls(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0))

    def __len__(self) -> int:
        return len(self.starts_m)

    @property
    def normals(self) -> FloatArray:
        """Unit vectors across the walls, shape (walls, 2)."""
        return left_normals(self.starts_m, self.ends_m)

    def distances_m(self, points_m: FloatArray) -> FloatArray:
        """Distances of points (..., 2) to the line of each wall, shape (..., walls).

        Positive where the normals point to.
        """
        offsets_m = points_m[..., np.newaxis, :] - self.starts_m
        return np.asarray(np.sum(offsets_m * self.normals, axis=-1))

    def hide(self, place_m: FloatArray, points_m: FloatArray, margin_m: float) -> BoolArray:
        """Whether a wall stands between a place and points.

        Parameters
        ----------
        place_m : (2,) array
            x, y of the transducer.
        points_m : (points, 2) array
            Of the objects.
        margin_m : float
            What is no farther than this behind a wall may be the wall itself, and is not hidden.
        """
        place_side, point_side = self.distances_m(place_m), self.distances_m(points_m)
        behind = (place_side * point_side < 0.0) & (np.abs(point_side) > margin_m)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.nan_to_num(place_side / (place_side - point_side), posinf=0.0, neginf=0.0)
        crossings_m = place_m + share[..., np.newaxis] * (points_m[:, np.newaxis] - place_m)
        return np.asarray((behind & self.hold(crossings_m)).any(axis=1))

    def hold(self, spots_m: FloatArray) -> BoolArray:
        """Whether spots on the line of each wall, shape (points, walls, 2), lie on the wall."""
        along = self.ends_m - self.starts_m
        fraction = np.sum((spots_m - self.starts_m) * along, axis=-1) / np.sum(along**2, axis=-1)
        within: BoolArray = (fraction >= 0.0) & (fraction <= 1.0)
        return within


@dataclass(frozen=True)
class MirroredLegs:
    """Legs from one place to points by way of each wall."""

    #: (points, walls, 2) array: mirror images of the points: the leg leaves towards them, and is as
    #: long as the way there.
    images_m: FloatArray
    #: (points, walls, 2) array: where the leg meets the wall.
    touches_m: FloatArray
    #: (points, walls) bool array: whether it does: place and point on one side of the wall, and the
    #: wall long enough.
    exists: BoolArray


def mirrored_legs(place_m: FloatArray, points_m: FloatArray, mirrors: Mirrors) -> MirroredLegs:
    """Legs from a place to points by way of each wall, other things in the way disregarded.

    Parameters
    ----------
    place_m : (2,) array
        x, y of the transducer.
    points_m : (points, 2) array
        Of the objects.
    mirrors : Mirrors
        Walls that reflect, with the sides that they face.
    """
    place_side, point_side = mirrors.distances_m(place_m), mirrors.distances_m(points_m)
    images_m = points_m[:, np.newaxis] - 2.0 * point_side[..., np.newaxis] * mirrors.normals
    # Sides of equal sign, and the way to the image is cut by the wall in their ratio.
    same = place_side * point_side > 0.0
    clear = (np.abs(place_side) > _ON_WALL_M) & (np.abs(point_side) > _ON_WALL_M)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.nan_to_num(place_side / (place_side + point_side), posinf=0.0, neginf=0.0)
    touches_m = place_m + share[..., np.newaxis] * (images_m - place_m)
    return MirroredLegs(images_m, touches_m, same & clear & mirrors.hold(touches_m))
