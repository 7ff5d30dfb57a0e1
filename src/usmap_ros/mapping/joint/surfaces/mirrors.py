"""A mirror: a wall that is heard at the feet of perpendiculars; and how such walls face."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.visibility.echoes import Echoes
from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.numerics.arrays import BoolArray, FloatArray

#: A wall is another one's double if it is so near to it, m, and as parallel.
DOUBLE_M, DOUBLE_COSINE = 0.2, 0.9
#: Walls are parallel or square to each other up to this sine of twice the angle; they face usual
#: directions if such a share of all that was heard of walls does.
SQUARE, USUAL_SHARE = 0.1, 0.3
#: Of those the ones whose directions are so near to their median, rad, tell what is usual.
NEAR_MEDIAN_RAD = 0.025
#: A wall whose direction is off a usual one by less than this, rad, has that if its feet are too
#: close together to tell: by that turn their standard deviation is moved by less than this, m.
UNSURE_RAD, UNSURE_M = 0.1, 0.012


@dataclass(frozen=True)
class MirrorWall:
    """A mirror."""

    #: Direction of the normal, towards the wall, and distance of the wall from the origin.
    normal_rad: float
    distance_m: float
    #: Where along the tangent (-sin, cos) its feet begin and end.
    begin_m: float
    end_m: float
    #: (hits,) integer arrays: that heard it, and their echoes of it.
    pings: NDArray[np.int64]
    echoes: NDArray[np.int64]
    #: Echoes that follow behind one of its own, on the mean.
    following: float
    #: Echoes that came before one of its own, on the mean.
    before: float
    #: Logarithm of its amplitude reflectivity.
    log_mirror: float
    #: Median deviation of what its echoes tell of that.
    deviation: float
    #: By how much likelier it is than the point that explains its pings best, by whichever of their
    #: echoes: logarithm.
    over_point: float

    def bearing_from(self, x_m: float, y_m: float) -> float:
        """Direction in which a place hears it, rad: the same one everywhere."""
        return self.normal_rad

    def feet_m(self, places_m: FloatArray) -> FloatArray:
        """Where along the tangent its pings' feet are, by where all pings were heard from."""
        along = -math.sin(self.normal_rad), math.cos(self.normal_rad)
        return np.asarray(places_m[self.pings] @ along)

    def line(self, field: Field) -> FloatArray:
        """The wall on a field, its cells half a cell behind its face."""
        res = field.resolution_m
        nx, ny = math.cos(self.normal_rad), math.sin(self.normal_rad)
        x0, y0 = field.first_column * res, field.first_row * res
        distance = (self.distance_m + 0.5 * res - nx * x0 - ny * y0) / res - 0.5 * (nx + ny)
        shift = (nx * y0 - ny * x0) / res + 0.5 * (nx - ny)
        return np.array([nx, ny, distance, self.begin_m / res - shift, self.end_m / res - shift])


def on_field(walls: list[MirrorWall], field: Field) -> FloatArray:
    """Walls as (walls, 5) lines, see `usmap_ros.mapping.joint.surfaces.lines`."""
    return np.array([wall.line(field) for wall in walls]).reshape(-1, 5)


def face_usually(walls: list[MirrorWall], among: list[MirrorWall]) -> BoolArray:
    """Whether each of some walls is parallel or square to many of others."""
    hits = np.array([len(wall.echoes) for wall in among], float)
    usual: BoolArray = are_square(walls, among) @ hits > USUAL_SHARE * hits.sum()
    return usual


def usual_direction(normals_rad: FloatArray, lengths: FloatArray, weights: FloatArray) -> float:
    """Direction, rad, that the most of some walls are parallel or square to.

    Parameters
    ----------
    normals_rad : (walls,) array
        How they face.
    lengths : (walls,) array
        How long they are, in any unit: the variance of a direction falls with the square of that.
    weights : (walls,) array
        How much of all that was heard of walls is of each.
    """
    turns_rad = normals_rad - normals_rad[:, np.newaxis]
    is_square = np.abs(np.sin(2.0 * turns_rad)) < SQUARE
    most = int(np.argmax(is_square @ weights))
    off_rad = -turns_to(float(normals_rad[most]), normals_rad)
    order = np.argsort(off_rad, kind="stable")
    below = np.cumsum((is_square[most] * weights * lengths)[order])
    median_rad = off_rad[order[np.searchsorted(below, 0.5 * below[-1])]]
    # What is no wall, or a little askew, does not turn the others.
    counts = is_square[most] & (np.abs(off_rad - median_rad) < NEAR_MEDIAN_RAD)
    mean_rad = np.average(off_rad, weights=counts * weights * lengths**2)
    return float(normals_rad[most] + mean_rad)


def usual_direction_of(walls: Sequence[MirrorWall]) -> float:
    """Direction, rad, that the most of some mirrors, by their hits, are parallel or square to."""
    return usual_direction(*how_they_face(walls))


def how_they_face(walls: Sequence[MirrorWall]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Directions of the normals, rad, lengths, m, and hits of some mirrors: (walls,) arrays."""
    # Of those that other pings found these may have struck none.
    each = [(wall.normal_rad, wall.end_m - wall.begin_m, len(wall.echoes) or 1) for wall in walls]
    normals_rad, lengths_m, hits = np.array(each, float).T
    return normals_rad, lengths_m, hits


def facing_usually(walls: Sequence[MirrorWall]) -> list[MirrorWall]:
    """Those of some mirrors that are just parallel or square to most of them."""
    if not walls:
        return []
    are = np.abs(_turns_to_usual(walls)) < NEAR_MEDIAN_RAD
    return [wall for wall, is_usual in zip(walls, are, strict=True) if is_usual]


def _turns_to_usual(walls: Sequence[MirrorWall]) -> FloatArray:
    """(walls,) array: least turn of each of some mirrors by which it faces as most of them do."""
    return turns_to(usual_direction_of(walls), how_they_face(walls)[0])


def turns_to(direction_rad: float, normals_rad: FloatArray) -> FloatArray:
    """(walls,) array: least turn of each wall that makes it parallel or square to a direction."""
    quarter = 0.5 * math.pi
    turns_rad: FloatArray = (direction_rad - normals_rad + 0.5 * quarter) % quarter - 0.5 * quarter
    return turns_rad


def are_square(walls: list[MirrorWall], others: list[MirrorWall]) -> BoolArray:
    """Whether walls are parallel or square to others, a row for each of the first."""
    normals, across = (np.array([wall.normal_rad for wall in some]) for some in (walls, others))
    square: BoolArray = np.abs(np.sin(2.0 * (normals[:, np.newaxis] - across))) < SQUARE
    return square


def squared(walls: list[MirrorWall], places_m: FloatArray, echoes: Echoes) -> list[MirrorWall]:
    """Walls, the short ones turned to a usual direction that is near."""
    if not walls:
        return []
    squared = list[MirrorWall]()
    for wall, turn in zip(walls, _turns_to_usual(walls).tolist(), strict=True):
        moved_m = abs(turn) * float(wall.feet_m(places_m).std())
        is_unsure = abs(turn) < UNSURE_RAD and moved_m < UNSURE_M
        squared.append(_turned(wall, turn, places_m, echoes) if is_unsure else wall)
    return squared


def _turned(wall: MirrorWall, turn: float, places_m: FloatArray, echoes: Echoes) -> MirrorWall:
    """The wall that faces otherwise and fits its echoes best."""
    normal_rad = wall.normal_rad + turn
    ahead = math.cos(normal_rad), math.sin(normal_rad)
    distances_m = places_m[wall.pings] @ ahead + echoes.range_m[wall.echoes]
    turned = replace(wall, normal_rad=normal_rad, distance_m=float(np.median(distances_m)))
    return _between_feet(turned, places_m)


def heard_by(wall: MirrorWall, are_own: BoolArray, places_m: FloatArray) -> MirrorWall:
    """The wall as some of its pings heard it.

    Parameters
    ----------
    wall : MirrorWall
        By all of them.
    are_own : (hits,) bool array
        Which count; some do.
    places_m : (pings, 2) array
        Where pings were heard from.
    """
    if are_own.all():
        return wall
    own = replace(wall, pings=wall.pings[are_own], echoes=wall.echoes[are_own])
    return _between_feet(own, places_m)


def _between_feet(wall: MirrorWall, places_m: FloatArray) -> MirrorWall:
    """The wall as far as its pings heard it."""
    feet_m = wall.feet_m(places_m)
    return replace(wall, begin_m=float(feet_m.min()), end_m=float(feet_m.max()))


def without_doubles(walls: list[MirrorWall]) -> list[MirrorWall]:
    """Walls but for those close beside another that face the same way: echoes beside it.

    What comes first counts for more: a burst rings on, and some of it comes by way of the floor.
    """
    kept: list[MirrorWall] = []
    for wall in sorted(walls, key=lambda wall: -len(wall.echoes) / (1.0 + wall.before)):
        middle_m = 0.5 * (wall.begin_m + wall.end_m)
        x_m = wall.distance_m * math.cos(wall.normal_rad) - middle_m * math.sin(wall.normal_rad)
        y_m = wall.distance_m * math.sin(wall.normal_rad) + middle_m * math.cos(wall.normal_rad)
        for other in kept:
            cosine, sine = math.cos(other.normal_rad), math.sin(other.normal_rad)
            across_m, along_m = (
                x_m * cosine + y_m * sine - other.distance_m,
                y_m * cosine - x_m * sine,
            )
            if (
                abs(across_m) < DOUBLE_M
                and math.cos(wall.normal_rad - other.normal_rad) > DOUBLE_COSINE
                and other.begin_m < along_m < other.end_m
            ):
                break
        else:
            kept.append(wall)
    return kept
