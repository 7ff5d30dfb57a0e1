"""Round columns: smooth convex things, which answer each view from their nearest point.

A column of radius R about c returns one echo to each ping that looks at it, from range |c - p| - R:
another point of its surface each time, so that no cell of it explains many pings.  Echoes that no
reliable cell explains vote for centres, for some radii; hits from many directions count for a
column, and silence where one would have been loud against it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.field import BIN_M, GREATEST_RANGE, HALF_ANGLE, HEADING, Field, X, Y
from usmap_ros.mapping.joint.mirror_walls import Echoes, count_between
from usmap_ros.mapping.joint.ray_casting import RAYS, STEPS, WHOLE
from usmap_ros.mapping.looks import Looks
from usmap_ros.mapping.ping_bins import GAIN_STEPS, SILENCE
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.compiled import compiled

#: Radii that are tried, m.
RADII_M = np.array([0.08, 0.12, 0.16, 0.2, 0.25, 0.32])
#: An echo is a column's if it is so near to where it should be.
TOLERANCE_M = 0.03
#: Candidates that are looked at, and columns that are found, at the most.
MOST_TRIES, MOST_COLUMNS = 400, 60
#: Least hits, least share of hits among the pings that would have heard it, and how far the
#: directions of the hits must spread: least eigenvalue of the mean of u uᵀ.
LEAST_HITS, LEAST_HIT_SHARE, LEAST_SPREAD = 12, 0.75, 0.12
#: Largest standard deviation of the ranges, m (chance alone has 0.017); least hits over one and
#: the echoes that crowd around each within a reach, m: among many, chance fits anything.
MOST_DEVIATION_M, LEAST_HITS_IN_CROWD, CROWD_M = 0.0125, 6.0, 0.4
#: Amplitude reflectivity of the faintest column that a silent ping counts against, how much louder
#: than what would have been reported it would be, and share of the sound that must get there.
FAINTEST, LOUD, CLEAR_SHARE = 0.3, 1.3, 0.6
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
    """

    x_m: float
    y_m: float
    radius_m: float
    pings: NDArray[np.int64]
    echoes: NDArray[np.int64]


def round_columns(
    looks: Looks,
    pings: NDArray[np.int64],
    echoes: Echoes,
    is_explained: BoolArray,
    field: Field,
    left: NDArray[np.uint8],
) -> list[RoundColumn]:
    """Columns that explain echoes which nothing else does.

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
    is_open, found = ~is_explained, list[RoundColumn]()
    candidates = []
    for radius_m in RADII_M:
        votes = np.zeros(field.shape, np.int32)
        _vote(looks, pings, echoes, is_open, field, radius_m, votes)
        rows, columns = np.nonzero(votes >= LEAST_HITS)
        candidates += [
            (int(votes[row, column]), row, column, radius_m)
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
    hits, misses = _look_at(
        looks, pings, echoes, is_open, left, place, 2.0 * TOLERANCE_M, hit_pings, hit_echoes
    )
    for _ in range(3):
        if hits < LEAST_HITS:
            return None
        _refine(looks.numbers[pings[hit_pings[:hits]]], echoes.range_m[hit_echoes[:hits]], place)
        hits, misses = _look_at(
            looks, pings, echoes, is_open, left, place, TOLERANCE_M, hit_pings, hit_echoes
        )
    if hits < LEAST_HITS or hits < LEAST_HIT_SHARE * (hits + misses):
        return None
    numbers = looks.numbers[pings[hit_pings[:hits]]]
    directions = place[:2] - numbers[:, [X, Y]]
    directions /= np.linalg.norm(directions, axis=1)[:, np.newaxis]
    spread = np.linalg.eigvalsh(directions.T @ directions / hits)[0]
    away_m = np.hypot(*(looks.numbers[pings][:, [X, Y]] - place[:2]).T).min()
    if spread < LEAST_SPREAD or away_m < place[2] + CLEARANCE_M:
        return None
    across_m = np.hypot(*(place[:2] - numbers[:, [X, Y]]).T) - place[2]
    if np.std(echoes.range_m[hit_echoes[:hits]] - across_m) > MOST_DEVIATION_M:
        return None
    crowd = np.mean(
        [
            count_between(echoes, ping, across - CROWD_M, across + CROWD_M) - 1
            for ping, across in zip(hit_pings[:hits], across_m, strict=True)
        ]
    )
    if hits < LEAST_HITS_IN_CROWD * (1.0 + crowd):
        return None
    return RoundColumn(
        float(place[0]), float(place[1]), float(place[2]),
        hit_pings[:hits].copy(), hit_echoes[:hits].copy(),
    )  # fmt: skip


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
    field: Field,
    radius_m: float,
    votes: NDArray[np.int32],
) -> None:
    """Count, for each centre, the pings with an open echo that a column there would return."""
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
                    votes[row, column] += 1


@compiled
def _look_at(  # noqa: PLR0913, PLR0917
    looks: Looks,
    pings: NDArray[np.int64],
    echoes: Echoes,
    is_open: BoolArray,
    left: NDArray[np.uint8],
    place: FloatArray,
    tolerance_m: float,
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
        if across <= numbers[9] + 0.02 or across >= numbers[GREATEST_RANGE] - 0.05:
            continue
        off = math.atan2(y, x) - numbers[HEADING]
        off -= 2.0 * math.pi * math.floor((off + math.pi) / (2.0 * math.pi))
        half = numbers[HALF_ANGLE]
        if abs(off) >= 0.93 * half:
            continue
        ray = min(max(int((off + half) * RAYS / (2.0 * half)), 0), RAYS - 1)
        step = min(max(int((across - 0.15) * STEPS / numbers[GREATEST_RANGE]), 0), STEPS - 1)
        if left[index, ray, step] < CLEAR_SHARE * WHOLE:
            continue
        nearest, nearest_echo, any_echo = tolerance_m, -1, False
        for echo in range(echoes.start[index], echoes.start[index + 1]):
            away = abs(echoes.range_m[echo] - across)
            any_echo = any_echo or away < 2.0 * tolerance_m
            if is_open[echo] and away < nearest:
                nearest, nearest_echo = away, echo
        if nearest_echo >= 0:
            hit_pings[hits], hit_echoes[hits] = index, nearest_echo
            hits += 1
            continue
        if any_echo:
            # Somebody else's echo covers it.
            continue
        entry = int((1.0 - math.cos(off)) / (1.0 - math.cos(half)) * GAIN_STEPS)
        gain = math.sqrt(max(looks.power_gain[ping, min(max(entry, 0), GAIN_STEPS)], 1e-8))
        b = min(int((across - numbers[9]) / numbers[BIN_M]), looks.bins[ping] - 1)
        limit = math.sqrt(looks.limit[ping, b])
        if looks.kind[ping, b] == SILENCE and FAINTEST * gain / across**2 > LOUD * limit:
            misses += 1
    return hits, misses
