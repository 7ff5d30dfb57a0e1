"""Round columns: smooth convex things, which answer each view from their nearest point.

A column of radius R about c returns one echo to each ping that looks at it, from range |c - p| - R:
another point of its surface each time, so that no cell of it explains many pings.  Echoes that no
reliable cell explains vote for centres, for some radii; hits from many directions count for a
column, the more the nearer they are to where they should be and the fewer other echoes are around,
and silence where one would have been loud counts against it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.beams import (
    LOOKING_SHARE,
    WITHIN_GREATEST_M,
    WITHIN_LEAST_M,
    amplitude_gain,
    off_axis,
)
from usmap_ros.mapping.joint.echoes import Echoes, count_between
from usmap_ros.mapping.joint.field import (
    BIN_M,
    GREATEST_RANGE,
    HALF_ANGLE,
    HEADING,
    LEAST_RANGE,
    RANGE_STD,
    Field,
    X,
    Y,
)
from usmap_ros.mapping.joint.log_odds import over_block
from usmap_ros.mapping.joint.ray_casting import RAYS, STEPS, WHOLE
from usmap_ros.mapping.looks import Looks
from usmap_ros.mapping.ping_bins import SILENCE
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.compiled import compiled

#: Radii that are tried, m.
RADII_M = np.array([0.08, 0.12, 0.16, 0.2, 0.25, 0.32])
#: An echo is a column's if it is so near to where it should be, m, or within so many standard
#: deviations of the range by the ping's pose.
TOLERANCE_M, WITHIN_STDS = 0.03, 2.5
#: Pings whose ranges are less certain, by their poses, find no columns, m: what scatters as much as
#: its radius may be is no circle.
MOST_RANGE_STD_M = 0.04
#: Candidates that are looked at, and columns that are found, at the most.
MOST_TRIES, MOST_COLUMNS = 600, 60
#: Hits that a column has, and hits that one is suspected by; how far the directions of hits must
#: spread for the first: least eigenvalue of the mean of u uᵀ.
LEAST_HITS, SUSPECT_HITS, LEAST_SPREAD = 12, 6, 0.1
#: A column is heard by such a share of the pings that should hear it; its ranges scatter so much,
#: m, or as the poses do, but for the share of those that are something else's.
HIT_SHARE, RANGE_STD_M, STRAY_SHARE = 0.9, 0.006, 0.1
#: Log-likelihood ratio of a column to chance, among the echoes that crowd around within a reach,
#: m: in all, and on the mean of its hits, times the spread of directions; least radius, m, for
#: corners and poles fit as well, but are points.
LEAST_LOG_RATIO, LEAST_LOG_RATIO_A_HIT, CROWD_M, LEAST_RADIUS_M = 55.0, 0.16, 0.4, 0.1
#: In all, and on the mean of its hits, at which a column is suspected, from wherever it was heard.
SUSPECT_LOG_RATIO, SUSPECT_LOG_RATIO_A_HIT = 20.0, 2.5
#: How many more echoes of a ping there may be within `CROWD_M` before a column than behind it: of
#: one thing beside it, but not of the two walls of a corner.
MOST_MORE_BEFORE = 1.2
#: Amplitude reflectivity of the faintest column that a silent ping counts against, how much louder
#: than what would have been reported it would be, and share of the sound that must get there.
FAINTEST, LOUD, CLEAR_SHARE = 0.3, 1.3, 0.6
#: Least amplitude gain of a beam.
LEAST_GAIN = 1e-4
#: Steps of Gauss and Newton to the point that hits of a column are compared with.
POINT_STEPS = 5
#: No surface is nearer to a robot's path than this.
CLEARANCE_M = 0.05


@dataclass(frozen=True)
class RoundColumn:
    """A column.

    Parameters
    ----------
    x_m, y_m, radius_m : float
        Its middle and radius.
    pings, echoes : (hits,) integer arrays
        That heard it, and their echoes of it.
    is_certain : bool
        Whether it was heard often enough, and from enough directions, to be shown.
    """

    x_m: float
    y_m: float
    radius_m: float
    pings: NDArray[np.int64]
    echoes: NDArray[np.int64]
    is_certain: bool

    def bearing_from(self, x_m: float, y_m: float) -> float:
        """Direction in which a place hears it, rad."""
        return math.atan2(self.y_m - y_m, self.x_m - x_m)


def round_columns(
    looks: Looks,
    pings: NDArray[np.int64],
    echoes: Echoes,
    is_explained: BoolArray,
    field: Field,
    left: NDArray[np.uint8],
) -> list[RoundColumn]:
    """Columns that explain echoes which nothing else does, suspected ones among them.

    Parameters
    ----------
    looks : Looks
        Pings.
    pings : (pings,) integer array
        Their rows.
    echoes : Echoes
        Theirs.
    is_explained : (echoes,) bool array
        Whether cells or mirrors explain an echo.
    field : Field
        The cells, which centres are looked for at.
    left : (pings, RAYS, STEPS) uint8 array
        By `usmap_ros.mapping.joint.ray_casting.cast_rays`.
    """
    stds_m = np.repeat(looks.numbers[pings, RANGE_STD], np.diff(echoes.start))
    is_open, found = ~is_explained & (stds_m <= MOST_RANGE_STD_M), list[RoundColumn]()
    candidates = []
    telling = _telling(echoes, stds_m)
    for radius_m in RADII_M:
        votes = np.zeros(field.shape, np.float32)
        _vote(looks, pings, echoes, is_open, telling, field, radius_m, votes)
        rows, columns = np.nonzero((votes >= SUSPECT_LOG_RATIO) & (votes >= over_block(votes)))
        candidates += [
            (float(votes[row, column]), row, column, radius_m)
            for row, column in zip(rows.tolist(), columns.tolist(), strict=True)
        ]
    candidates.sort(key=lambda candidate: -candidate[0])
    for _, row, column, radius_m in candidates[:MOST_TRIES]:
        x_m = (field.first_column + column + 0.5) * field.resolution_m
        y_m = (field.first_row + row + 0.5) * field.resolution_m
        if any(math.hypot(x_m - c.x_m, y_m - c.y_m) < radius_m + c.radius_m for c in found):
            continue
        fitted = _fitted(looks, pings, echoes, is_open, left, x_m, y_m, radius_m)
        if fitted is not None:
            found.append(fitted)
            is_open[fitted.echoes] = False
        if len(found) == MOST_COLUMNS:
            break
    return found


def drawn_columns(columns: list[RoundColumn], field: Field) -> BoolArray:
    """Cells at the surface of columns."""
    mask = np.zeros(field.shape, bool)
    res = field.resolution_m
    for column in columns:
        reach = int(column.radius_m / res) + 2
        middle_row = math.floor(column.y_m / res) - field.first_row
        middle_column = math.floor(column.x_m / res) - field.first_column
        for row in range(max(0, middle_row - reach), min(field.rows, middle_row + reach + 1)):
            for place in range(
                max(0, middle_column - reach), min(field.columns, middle_column + reach + 1)
            ):
                x_m = (field.first_column + place + 0.5) * res - column.x_m
                y_m = (field.first_row + row + 0.5) * res - column.y_m
                beyond_m = math.hypot(x_m, y_m) - column.radius_m
                mask[row, place] |= -res <= beyond_m < 0.25 * res
    return mask


def discs(columns: list[RoundColumn], field: Field) -> BoolArray:
    """Cells that columns cover, and those beside them."""
    x_m = (field.first_column + np.arange(field.columns) + 0.5) * field.resolution_m
    y_m = (field.first_row + np.arange(field.rows) + 0.5) * field.resolution_m
    mask = np.zeros(field.shape, bool)
    for column in columns:
        away_m = np.hypot(x_m[np.newaxis] - column.x_m, y_m[:, np.newaxis] - column.y_m)
        covered: BoolArray = away_m < column.radius_m + field.resolution_m
        mask |= covered
    return mask


def _fitted(
    looks: Looks,
    pings: NDArray[np.int64],
    echoes: Echoes,
    is_open: BoolArray,
    left: NDArray[np.uint8],
    x_m: float,
    y_m: float,
    radius_m: float,
) -> RoundColumn | None:
    """The column near a candidate, if it is one."""
    hit_pings, hit_echoes = (np.empty(len(pings), np.int64) for _ in range(2))
    place = np.array([x_m, y_m, radius_m])
    hits, misses = _look_at(looks, pings, echoes, is_open, left, place, 2.0, hit_pings, hit_echoes)
    for _ in range(3):
        if hits < SUSPECT_HITS:
            return None
        _refine(looks.numbers[pings[hit_pings[:hits]]], echoes.range_m[hit_echoes[:hits]], place)
        hits, misses = _look_at(
            looks, pings, echoes, is_open, left, place, 1.0, hit_pings, hit_echoes
        )
    if hits < SUSPECT_HITS:
        return None
    numbers = looks.numbers[pings[hit_pings[:hits]]]
    directions = place[:2] - numbers[:, [X, Y]]
    across_m = np.hypot(*directions.T) - place[2]
    directions /= np.linalg.norm(directions, axis=1)[:, np.newaxis]
    spread = np.linalg.eigvalsh(directions.T @ directions / hits)[0]
    away_m = np.hypot(*(looks.numbers[pings][:, [X, Y]] - place[:2]).T).min()
    if not LEAST_RADIUS_M < place[2] < away_m - CLEARANCE_M:
        return None
    crowd = count_between(echoes, hit_pings[:hits], across_m - CROWD_M, across_m + CROWD_M) - 1
    off_m = echoes.range_m[hit_echoes[:hits]] - across_m
    stds_m = numbers[:, RANGE_STD]
    log_ratio = _log_ratio(off_m, stds_m, crowd, misses)
    is_certain = hits >= LEAST_HITS and spread >= LEAST_SPREAD
    is_certain &= log_ratio >= LEAST_LOG_RATIO
    is_certain &= log_ratio * spread >= LEAST_LOG_RATIO_A_HIT * hits
    is_suspected = log_ratio >= max(SUSPECT_LOG_RATIO, SUSPECT_LOG_RATIO_A_HIT * hits)
    if not is_certain and not is_suspected:
        # Most are neither, and are not compared with points.
        return None
    off_point_m = _off_point(numbers, echoes.range_m[hit_echoes[:hits]], place)
    is_certain &= log_ratio > _log_ratio(off_point_m, stds_m, crowd, misses)
    is_certain &= not _is_corner(echoes, hit_pings[:hits], across_m, stds_m)
    if not is_certain and not is_suspected:
        return None
    return RoundColumn(
        float(place[0]), float(place[1]), float(place[2]),
        hit_pings[:hits].copy(), hit_echoes[:hits].copy(), bool(is_certain),
    )  # fmt: skip


def _tolerance(stds_m: FloatArray) -> FloatArray:
    """How near to where it should be an echo is a column's, m, by how uncertain ranges are."""
    tolerances_m: FloatArray = np.maximum(TOLERANCE_M, WITHIN_STDS * stds_m)
    return tolerances_m


def _is_corner(
    echoes: Echoes, pings: NDArray[np.int64], across_m: FloatArray, stds_m: FloatArray
) -> bool:
    """Whether most is heard before: two walls are heard before their corner, and after columns."""
    near_m = _tolerance(stds_m)
    before = count_between(echoes, pings, across_m - CROWD_M, across_m - near_m)
    behind = count_between(echoes, pings, across_m + near_m, across_m + CROWD_M)
    return bool(before.mean() > behind.mean() + MOST_MORE_BEFORE)


def _off_point(numbers: FloatArray, ranges_m: FloatArray, place: FloatArray) -> FloatArray:
    """How far ranges are off those to the point that fits them best, near a column's surface, m."""
    offsets = place[:2] - numbers[:, [X, Y]]
    towards = (offsets / np.hypot(*offsets.T)[:, np.newaxis]).mean(axis=0)
    point = place[:2] - place[2] * towards
    for _ in range(POINT_STEPS):
        offsets = point - numbers[:, [X, Y]]
        distances = np.hypot(*offsets.T)
        step, *_ = np.linalg.lstsq(offsets / distances[:, np.newaxis], ranges_m - distances, None)
        point = point + step
    off_m: FloatArray = ranges_m - np.hypot(*(point - numbers[:, [X, Y]]).T)
    return off_m


def _echoes_per_m(crowd: NDArray[np.int64]) -> FloatArray:
    """How dense echoes are around one, beside which there are so many within `CROWD_M`."""
    density: FloatArray = (crowd.astype(np.float64) + 0.5) / (2.0 * CROWD_M)
    return density


def _telling(echoes: Echoes, stds_m: FloatArray) -> FloatArray:
    """Log-likelihood ratio of a hit just where it should be, for each echo."""
    std_m = np.maximum(stds_m, RANGE_STD_M)
    crowd = np.zeros(len(echoes.range_m), np.int64)
    _count_around(echoes, crowd)
    peak = HIT_SHARE * (1.0 - STRAY_SHARE) / (std_m * math.sqrt(2.0 * math.pi))
    telling: FloatArray = np.log(np.maximum(peak / _echoes_per_m(crowd), 1.0))
    return telling


@compiled
def _count_around(echoes: Echoes, crowd: NDArray[np.int64]) -> None:
    """Set how many other echoes of the same ping are within `CROWD_M` of each."""
    for ping in range(len(echoes.start) - 1):
        for echo in range(echoes.start[ping], echoes.start[ping + 1]):
            for other in range(echoes.start[ping], echoes.start[ping + 1]):
                if other != echo and abs(echoes.range_m[other] - echoes.range_m[echo]) < CROWD_M:
                    crowd[echo] += 1


def _log_ratio(
    off_m: FloatArray, stds_m: FloatArray, crowd: NDArray[np.int64], misses: int
) -> float:
    """Log-likelihood ratio of what was heard, with a column to with echoes of anything there.

    Parameters
    ----------
    off_m : (hits,) array
        Distance of each hit from where the column's echo should be.
    stds_m : (hits,) array
        Standard deviation of each range by the ping's pose.
    crowd : (hits,) integer array
        Other echoes of the ping within `CROWD_M` of it.
    misses : int
        Pings that should have heard the column but did not.
    """
    echoes_per_m = _echoes_per_m(crowd)
    std_m, width_m = np.maximum(stds_m, RANGE_STD_M), 2.0 * _tolerance(stds_m)
    normal = np.exp(-0.5 * (off_m / std_m) ** 2) / (std_m * math.sqrt(2.0 * math.pi))
    stray = 1.0 / width_m
    of_column = HIT_SHARE * ((1.0 - STRAY_SHARE) * normal + STRAY_SHARE * stray)
    silent = math.exp(-float((width_m * echoes_per_m).mean()))
    missed = misses * math.log((1.0 - HIT_SHARE) / silent)
    return float(np.log(of_column / echoes_per_m).sum() + missed)


def _refine(numbers: FloatArray, ranges_m: FloatArray, place: FloatArray) -> None:
    """One step of Gauss and Newton on |c - p| - R = range, with a prior on the radius."""
    offsets = place[:2] - numbers[:, [X, Y]]
    distances = np.hypot(*offsets.T)
    residuals = ranges_m - (distances - place[2])
    jacobian = np.column_stack([offsets / distances[:, np.newaxis], -np.ones(len(distances))])
    weight = (0.02 / 0.05) ** 2
    normal = jacobian.T @ jacobian + np.diag([weight, weight, weight])
    place += np.clip(np.linalg.solve(normal, jacobian.T @ residuals), -0.05, 0.05)
    place[2] = np.clip(place[2], 0.5 * RADII_M[0], 1.5 * RADII_M[-1])


@compiled
def _vote(
    looks: Looks,
    pings: NDArray[np.int64],
    echoes: Echoes,
    is_open: BoolArray,
    telling: FloatArray,
    field: Field,
    radius_m: float,
    votes: NDArray[np.float32],
) -> None:
    """Add up, for each centre, how telling the open echoes are that a column there would return.

    Of each ping the first one counts.
    """
    last = np.full((field.rows, field.columns), -1, np.int32)
    res = field.resolution_m
    for index in range(len(pings)):
        numbers = looks.numbers[pings[index]]
        half = numbers[HALF_ANGLE]
        for echo in range(echoes.start[index], echoes.start[index + 1]):
            if not is_open[echo]:
                continue
            distance = echoes.range_m[echo] + radius_m
            steps = int(2.0 * half * distance / (0.7 * res)) + 1
            for k in range(steps + 1):
                angle = numbers[HEADING] - half + 2.0 * half * k / steps
                column = math.floor((numbers[X] + distance * math.cos(angle)) / res)
                row = math.floor((numbers[Y] + distance * math.sin(angle)) / res)
                row, column = row - field.first_row, column - field.first_column
                if row < 1 or column < 1 or row >= field.rows - 1 or column >= field.columns - 1:
                    continue
                if last[row, column] != index:
                    last[row, column] = index
                    votes[row, column] += telling[echo]


@compiled
def _look_at(  # noqa: PLR0913, PLR0917 - a kernel takes arrays
    looks: Looks,
    pings: NDArray[np.int64],
    echoes: Echoes,
    is_open: BoolArray,
    left: NDArray[np.uint8],
    place: FloatArray,
    tolerance: float,
    hit_pings: NDArray[np.int64],
    hit_echoes: NDArray[np.int64],
) -> tuple[int, int]:
    """Pings that heard a column, and how many should have but did not."""
    hits, misses = 0, 0
    for index in range(len(pings)):
        ping = pings[index]
        numbers = looks.numbers[ping]
        x, y = place[0] - numbers[X], place[1] - numbers[Y]
        distance = math.sqrt(x * x + y * y)
        across = distance - place[2]
        least, greatest = (
            numbers[LEAST_RANGE] + WITHIN_LEAST_M, numbers[GREATEST_RANGE] - WITHIN_GREATEST_M,
        )  # fmt: skip
        if across <= least or across >= greatest:
            continue
        off = off_axis(looks, ping, math.atan2(y, x))
        half = numbers[HALF_ANGLE]
        if abs(off) >= LOOKING_SHARE * half:
            continue
        ray = min(max(int((off + half) * RAYS / (2.0 * half)), 0), RAYS - 1)
        step = min(max(int((across - 0.15) * STEPS / numbers[GREATEST_RANGE]), 0), STEPS - 1)
        if left[index, ray, step] < CLEAR_SHARE * WHOLE:
            continue
        widest = max(TOLERANCE_M, WITHIN_STDS * numbers[RANGE_STD])
        nearest, nearest_echo, any_echo = tolerance * widest, -1, False
        for echo in range(echoes.start[index], echoes.start[index + 1]):
            away = abs(echoes.range_m[echo] - across)
            any_echo = any_echo or away < 2.0 * tolerance * widest
            if is_open[echo] and away < nearest:
                nearest, nearest_echo = away, echo
        if nearest_echo >= 0:
            hit_pings[hits], hit_echoes[hits] = index, nearest_echo
            hits += 1
            continue
        if any_echo:
            # Somebody else's echo covers it.
            continue
        gain = max(amplitude_gain(looks, ping, off), LEAST_GAIN)
        b = min(int((across - numbers[LEAST_RANGE]) / numbers[BIN_M]), looks.bins[ping] - 1)
        limit = math.sqrt(looks.limit[ping, b])
        if looks.kind[ping, b] == SILENCE and FAINTEST * gain / across**2 > LOUD * limit:
            misses += 1
    return hits, misses
