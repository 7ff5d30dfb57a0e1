"""What stands in the way: lines of sight and clearances among wall segments and discs.

Everything works on whole arrays, since a map's scene has hundreds of wall segments and as many
scatterers in view.
"""

import numpy as np

from usmap_ros.numerics.arrays import BoolArray, FloatArray, IntArray

#: A target that belongs to no wall or disc.
NO_OWNER = -1


def cross(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the z component of the cross product of vectors in the plane, over the last axis."""
    product: FloatArray = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
    return product


def hidden_by_walls(
    origin_m: FloatArray,
    targets_m: FloatArray,
    starts_m: FloatArray,
    ends_m: FloatArray,
    owners: IntArray,
) -> BoolArray:
    """Whether a wall crosses the line of sight to each target.

    Parameters
    ----------
    origin_m : (2,) array
        Where one looks from.
    targets_m : (n, 2) array
        What one looks at.
    starts_m, ends_m : (m, 2) arrays
        End points of the walls.
    owners : (n,) int array
        The wall that each target lies on, which does not hide it; `NO_OWNER`: none.

    Returns
    -------
    (n,) bool array
    """
    if len(starts_m) == 0 or len(targets_m) == 0:
        return np.zeros(len(targets_m), dtype=bool)
    sight = (targets_m - origin_m)[:, np.newaxis]
    wall = (ends_m - starts_m)[np.newaxis]
    to_start = (starts_m - origin_m)[np.newaxis]
    # origin + u * sight = start + v * wall, solved by Cramer's rule.
    determinant = cross(sight, wall)
    # A wall parallel to the line of sight divides by zero, and then compares false: it is seen
    # edge-on and hides nothing.
    with np.errstate(divide="ignore", invalid="ignore"):
        along_sight = cross(to_start, wall) / determinant
        along_wall = cross(to_start, sight) / determinant
    crossed = (along_sight > 0.0) & (along_sight < 1.0)
    crossed &= (along_wall >= 0.0) & (along_wall <= 1.0)
    crossed &= owners[:, np.newaxis] != np.arange(len(starts_m))
    return np.asarray(crossed.any(axis=1))


def hidden_by_discs(
    origin_m: FloatArray,
    targets_m: FloatArray,
    centers_m: FloatArray,
    radii_m: FloatArray,
    owners: IntArray,
) -> BoolArray:
    """Whether a disc lies across the line of sight to each target.

    Parameters
    ----------
    origin_m : (2,) array
        Where one looks from.
    targets_m : (n, 2) array
        What one looks at.
    centers_m : (m, 2) array
        Centres of the discs.
    radii_m : (m,) array
        Their radii; a disc of radius 0 hides nothing.
    owners : (n,) int array
        The disc that each target lies on, which does not hide it; `NO_OWNER`: none.

    Returns
    -------
    (n,) bool array
    """
    if len(centers_m) == 0 or len(targets_m) == 0:
        return np.zeros(len(targets_m), dtype=bool)
    distances = point_segment_distances(
        centers_m[np.newaxis], origin_m[np.newaxis, np.newaxis], targets_m[:, np.newaxis]
    )
    crossed = distances < radii_m
    crossed &= owners[:, np.newaxis] != np.arange(len(centers_m))
    return np.asarray(crossed.any(axis=1))


def point_segment_distances(
    points_m: FloatArray, starts_m: FloatArray, ends_m: FloatArray
) -> FloatArray:
    """Distance from points to segments; the arrays broadcast up to their last axis, x and y."""
    along = ends_m - starts_m
    length_squared = np.maximum(np.sum(along**2, axis=-1), np.finfo(float).tiny)
    fraction = np.sum((points_m - starts_m) * along, axis=-1) / length_squared
    nearest = starts_m + np.clip(fraction, 0.0, 1.0)[..., np.newaxis] * along
    distances: FloatArray = np.hypot(
        points_m[..., 0] - nearest[..., 0], points_m[..., 1] - nearest[..., 1]
    )
    return distances


def path_wall_distances(
    start_m: FloatArray, end_m: FloatArray, starts_m: FloatArray, ends_m: FloatArray
) -> FloatArray:
    """Distance from one stretch of path to every wall, shape (walls,); 0 where they cross."""
    distances = np.minimum.reduce(
        [
            point_segment_distances(start_m, starts_m, ends_m),
            point_segment_distances(end_m, starts_m, ends_m),
            point_segment_distances(starts_m, start_m, end_m),
            point_segment_distances(ends_m, start_m, end_m),
        ]
    )
    path, walls = end_m - start_m, ends_m - starts_m
    # The ends of each lie on different sides of the other.
    path_parts = cross(walls, start_m - starts_m) * cross(walls, end_m - starts_m) < 0.0
    wall_parts = cross(path, starts_m - start_m) * cross(path, ends_m - start_m) < 0.0
    return np.where(path_parts & wall_parts, 0.0, distances)
