"""Straight walls in a map: what is known of it after a first pass, to improve the next one."""

import numpy as np

from usmap_ros.numerics.arrays import BoolArray, FloatArray, IndexArray

#: Directions that are tried, and how far from a line, in cells, its cells may lie.
_DIRECTIONS = 180
_HALF_WIDTH = 1.0
#: Widest gap in a wall, and cells per length that make one, in cells.
_LARGEST_GAP = 4.0
_LEAST_DENSITY = 0.5


def straight_walls(
    centers_m: FloatArray, resolution_m: float, least_length_m: float
) -> tuple[FloatArray, FloatArray]:
    """Straight segments along occupied cells, longest first.

    The line on which most cells lie is taken (a Hough transform), then fitted to them, cut where
    there is a gap, and so on with the cells that are left.

    Parameters
    ----------
    centers_m : (n, 2) array
        Centres of occupied cells.
    resolution_m : float
        Side of a cell.
    least_length_m : float
        What is shorter is no wall.

    Returns
    -------
    starts_m, ends_m : (walls, 2) arrays
        Ends of the segments.
    """
    left, segments = centers_m, []
    while len(left) >= 2:
        on_line = _densest_line(left, resolution_m)
        run = _longest_run(left, on_line, resolution_m)
        start_m, end_m = _ends(left[run])
        length_m = float(np.linalg.norm(end_m - start_m))
        if length_m < least_length_m:
            break
        if len(run) * resolution_m >= _LEAST_DENSITY * length_m:
            # Its last cells may have gone to a wall that it meets in a corner.
            whole = _along(centers_m, start_m, end_m, resolution_m)
            segments.append(_ends_on(centers_m[whole], start_m, end_m))
        left = np.delete(left, _along(left, start_m, end_m, resolution_m), axis=0)
    walls = np.array(segments).reshape(-1, 2, 2)
    return walls[:, 0], walls[:, 1]


def _densest_line(points_m: FloatArray, resolution_m: float) -> IndexArray:
    """Points within half a width of the line on which most of them are."""
    best: IndexArray = np.zeros(0, dtype=np.intp)
    for angle in np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS:
        offsets = points_m @ np.array([-np.sin(angle), np.cos(angle)]) / resolution_m
        ordered = np.sort(offsets)
        last = np.searchsorted(ordered, ordered + 2.0 * _HALF_WIDTH, side="right")
        count = last - np.arange(len(ordered))
        if count.max() > len(best):
            first = ordered[int(np.argmax(count))]
            best = np.flatnonzero((offsets >= first) & (offsets <= first + 2.0 * _HALF_WIDTH))
    return best


def _longest_run(points_m: FloatArray, on_line: IndexArray, resolution_m: float) -> IndexArray:
    """Of points on a line, those of the stretch without a gap that has most of them."""
    _, along = _axis(points_m[on_line])
    order = np.argsort(along)
    cuts = np.flatnonzero(np.diff(along[order]) > _LARGEST_GAP * resolution_m) + 1
    return on_line[max(np.split(order, cuts), key=len)]


def _axis(points_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Direction in which points spread most, and how far along it each is from their mean."""
    offsets = points_m - points_m.mean(axis=0)
    direction = np.linalg.svd(offsets, full_matrices=False)[2][0]
    return direction, offsets @ direction


def _ends(points_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Ends of the segment that is fitted to points."""
    direction, along = _axis(points_m)
    middle = points_m.mean(axis=0)
    return middle + along.min() * direction, middle + along.max() * direction


def _ends_on(
    points_m: FloatArray, start_m: FloatArray, end_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Ends of a segment that is made as long as points along it reach."""
    direction = (end_m - start_m) / np.linalg.norm(end_m - start_m)
    along = (points_m - start_m) @ direction
    return start_m + along.min() * direction, start_m + along.max() * direction


def _along(
    points_m: FloatArray, start_m: FloatArray, end_m: FloatArray, resolution_m: float
) -> BoolArray:
    """Whether points are so near to a segment that they belong to its wall."""
    length_m = max(float(np.linalg.norm(end_m - start_m)), resolution_m)
    direction = (end_m - start_m) / length_m
    offsets = points_m - start_m
    along = offsets @ direction
    across = offsets @ np.array([-direction[1], direction[0]])
    margin_m = (_HALF_WIDTH + 1.0) * resolution_m
    near: BoolArray = (np.abs(across) <= margin_m) & (along >= -margin_m)
    return near & (along <= length_m + margin_m)
