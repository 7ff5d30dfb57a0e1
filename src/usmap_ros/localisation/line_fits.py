"""Lines through the places that walls would answer from, and points: compiled."""

import math
from typing import NamedTuple

from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.compiled import compiled, inlined

#: How well the peak of the votes says the direction, rad, and the farthest step from it.
_PEAK_RAD, _MOST_TURN_RAD = 0.02, 0.05
#: How well the peak of the votes says where a point is, m.
_PEAK_M = 0.1
#: Steps of a fit, echoes that it needs, and how well a distance is known beforehand, per m².
_STEPS, _LEAST_ECHOES, _DISTANCE = 4, 1e-3, 1e-6
#: How far behind a line echoes are that cannot be its, m.
_NOT_ITS_M = 1e9


class LandmarkEchoes(NamedTuple):
    """Echoes that may be walls', and where they were heard from: (echoes,) arrays."""

    #: The poses.
    x_m: FloatArray
    y_m: FloatArray
    yaw_rad: FloatArray
    #: How far their objects are.
    range_m: FloatArray
    #: How far off the axis the foot of a perpendicular may be, and by how much it may miss that.
    reach_rad: FloatArray
    aslant_rad: FloatArray
    #: How much each counts.
    weight: FloatArray


@inlined
def _place(rows: LandmarkEchoes, echo: int, angle: float) -> tuple[bool, float, float]:
    """Where a wall that faces so would answer from, and whether it can."""
    yaw, reach = rows.yaw_rad[echo], rows.reach_rad[echo]
    off_rad = angle - yaw
    off_rad -= 2.0 * math.pi * math.floor(off_rad / (2.0 * math.pi) + 0.5)
    heading = yaw + min(max(off_rad, -reach), reach)
    x_m = rows.x_m[echo] + rows.range_m[echo] * math.cos(heading)
    y_m = rows.y_m[echo] + rows.range_m[echo] * math.sin(heading)
    return abs(off_rad) <= reach + rows.aslant_rad[echo], x_m, y_m


@compiled
def put_on_line(
    rows: LandmarkEchoes,
    wanted: BoolArray,
    angle: float,
    distance_m: float,
    along_m: FloatArray,
    behind_m: FloatArray,
) -> None:
    """Set where along a line echoes would come from, and how far behind it.

    Parameters
    ----------
    rows : LandmarkEchoes
        The echoes.
    wanted : (echoes,) bool array
        Those that may be its.
    angle, distance_m : float
        Its normal, rad, and how far it is along that.
    along_m, behind_m : (echoes,) arrays
        Set; kilometres behind, if they cannot be.
    """
    cosine, sine = math.cos(angle), math.sin(angle)
    for echo in range(len(rows.x_m)):
        can_be, x_m, y_m = _place(rows, echo, angle)
        along_m[echo] = y_m * cosine - x_m * sine
        is_its = can_be and wanted[echo]
        behind_m[echo] = x_m * cosine + y_m * sine - distance_m if is_its else _NOT_ITS_M


@compiled
def fit_line(
    rows: LandmarkEchoes,
    wanted: BoolArray,
    line: tuple[float, float],
    coarse_m: float,
    sigma_m: float,
) -> tuple[float, float]:
    """A line through what is near it, by least squares.

    Parameters
    ----------
    rows, wanted
        As of `put_on_line`.
    line : (float, float)
        Its normal, rad, and how far it is along that, nearly.
    coarse_m, sigma_m : float
        How far what is its may be off, at first and then (standard deviations).

    Returns
    -------
    angle, distance_m : float
        Of the line.
    """
    angle, distance_m = line
    scale_m, known = max(coarse_m, sigma_m), (sigma_m / _PEAK_RAD) ** 2
    for _ in range(_STEPS):
        cosine, sine = math.cos(angle), math.sin(angle)
        total, first, second, turned, moved = 0.0, 0.0, known, 0.0, 0.0
        for echo in range(len(rows.x_m)):
            if not wanted[echo]:
                continue
            can_be, x_m, y_m = _place(rows, echo, angle)
            off_m = x_m * cosine + y_m * sine - distance_m
            if not can_be or abs(off_m) >= 3.0 * scale_m:
                continue
            weight = rows.weight[echo] * math.exp(-0.5 * (off_m / scale_m) ** 2)
            along_m = y_m * cosine - x_m * sine
            total += weight
            first += weight * along_m
            second += weight * along_m * along_m
            turned -= weight * along_m * off_m
            moved += weight * off_m
        if total < _LEAST_ECHOES:
            break
        both = total + _DISTANCE
        determinant = second * both - first * first
        turn = (turned * both + first * moved) / determinant
        distance_m += (second * moved + first * turned) / determinant
        angle += min(max(turn, -_MOST_TURN_RAD), _MOST_TURN_RAD)
        scale_m = sigma_m
    return angle, distance_m


@inlined
def _ray(
    rows: LandmarkEchoes, echo: int, x_m: float, y_m: float
) -> tuple[bool, float, float, float]:
    """Whether an echo may be of a point, the unit vector there, and how far behind it it is."""
    x, y = x_m - rows.x_m[echo], y_m - rows.y_m[echo]
    far_m = math.hypot(x, y) + 1e-9
    off_rad = math.atan2(y, x) - rows.yaw_rad[echo]
    off_rad -= 2.0 * math.pi * math.floor(off_rad / (2.0 * math.pi) + 0.5)
    can_be = abs(off_rad) <= rows.reach_rad[echo]
    return can_be, x / far_m, y / far_m, rows.range_m[echo] - far_m


@compiled
def put_on_point(
    rows: LandmarkEchoes, wanted: BoolArray, x_m: float, y_m: float, behind_m: FloatArray
) -> None:
    """Set how far behind a point echoes are; kilometres, if they cannot be its.

    Parameters are those of `put_on_line`.
    """
    for echo in range(len(rows.x_m)):
        can_be, _, _, off_m = _ray(rows, echo, x_m, y_m)
        behind_m[echo] = off_m if can_be and wanted[echo] else _NOT_ITS_M


@compiled
def fit_point(
    rows: LandmarkEchoes,
    wanted: BoolArray,
    place: tuple[float, float],
    coarse_m: float,
    sigma_m: float,
) -> tuple[float, float]:
    """A point at what is near it, by least squares.

    Parameters are those of `fit_line`, but for where it is nearly, and so is what is returned.
    """
    x_m, y_m = place
    scale_m, known = max(coarse_m, sigma_m), (sigma_m / _PEAK_M) ** 2
    for _ in range(_STEPS):
        first, mixed, second, moved_x, moved_y = known, 0.0, known, 0.0, 0.0
        for echo in range(len(rows.x_m)):
            if not wanted[echo]:
                continue
            can_be, x, y, off_m = _ray(rows, echo, x_m, y_m)
            if not can_be or abs(off_m) >= 3.0 * scale_m:
                continue
            weight = rows.weight[echo] * math.exp(-0.5 * (off_m / scale_m) ** 2)
            first += weight * x * x
            mixed += weight * x * y
            second += weight * y * y
            moved_x += weight * x * off_m
            moved_y += weight * y * off_m
        determinant = first * second - mixed * mixed
        x_m += (second * moved_x - mixed * moved_y) / determinant
        y_m += (first * moved_y - mixed * moved_x) / determinant
        scale_m = sigma_m
    return x_m, y_m
