"""What pings say of the cells around them, and how likely what all others said makes each.

Far plainer than the map's own estimate, so that it can be asked how well a robot's pings would fit
if something were wrong with them, a hundred times over: every ping speaks for the cells where its
echoes may come from, and against those in its beam before the first of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.compiled import compiled, inlined
from usmap_ros.pings.cone import EchoCone

#: Probability that what stands on a beam's axis is heard, and dB of gain at which nothing is.
HEARD, UNHEARD_DB = 0.5, 30.0
#: Log-odds that there is anything in a cell before any ping, and evidence that is worth a look.
PRIOR, LEAST_EVIDENCE = -4.0, 1.0
#: Standard deviation of how loud one thing is, dB; levels among which others are as likely as any;
#: and the share of echoes whose loudness says nothing.
LEVEL_STD_DB, LEVELS_DB, UNRELATED = 1.5, 40.0, 0.1
#: Steps of the cosine off a beam's axis.
COSINES = 64
#: dB by which an echo fades with the logarithm of its range, to the base of ten.
FADING_DB = 40.0


class Sightings(NamedTuple):
    """Pings and their echoes.

    Parameters
    ----------
    x_m, y_m, axis_x, axis_y : (pings,) arrays
        Where they were sent from, and in which direction.
    least_m, greatest_m, first_m : (pings,) arrays
        Where echoes are looked for, and the first of them.
    background : (pings,) array
        Probability that an echo lies within a metre for no reason.
    beam : (pings,) int64 array
        Which of the beams.
    cos_half : (beams,) array
        Cosine of half the angle of each.
    gain_db : (beams, COSINES + 1) array
        Two-way gain by the cosine off the axis, from `cos_half` to 1.
    start : (pings + 1,) int64 array
        First echo of each ping, and the end.
    range_m, level_db : (echoes,) arrays
        Of each, and how loud it would be on the axis at a metre.
    """

    x_m: FloatArray
    y_m: FloatArray
    axis_x: FloatArray
    axis_y: FloatArray
    least_m: FloatArray
    greatest_m: FloatArray
    first_m: FloatArray
    background: FloatArray
    beam: NDArray[np.int64]
    cos_half: FloatArray
    gain_db: FloatArray
    start: NDArray[np.int64]
    range_m: FloatArray
    level_db: FloatArray


class Field(NamedTuple):
    """What pings say of cells.

    Parameters
    ----------
    west_m, south_m, cell_m, tolerance_m : float
        Where it begins, the side of a cell, and how far from an echo its cells may be.
    evidence, echoes, level_db : (rows, columns) float32 arrays
        Log-likelihood ratio of something there, echoes from there, and the sum of their levels.
    """

    west_m: float
    south_m: float
    cell_m: float
    tolerance_m: float
    evidence: NDArray[np.float32]
    echoes: NDArray[np.float32]
    level_db: NDArray[np.float32]

    def plus(self, other: Field) -> Field:
        """The sum of both, which lie alike."""
        return self._replace(
            evidence=self.evidence + other.evidence,
            echoes=self.echoes + other.echoes,
            level_db=self.level_db + other.level_db,
        )


def sightings_of(cones: Sequence[EchoCone]) -> Sightings:
    """Pings in the form that compiled functions take."""
    xy_m = np.array([cone.pose.position_m[:2] for cone in cones]).reshape(-1, 2)
    yaw_rad = np.array([cone.pose.yaw_rad for cone in cones])
    reach = [(cone.transducer.min_range_m, cone.transducer.max_range_m) for cone in cones]
    # In one piece each, so that functions are compiled once.
    least_m, greatest_m = np.ascontiguousarray(np.array(reach, float).reshape(-1, 2).T)
    beams = {id(cone.transducer.beam): cone.transducer.beam for cone in cones}
    which = {key: number for number, key in enumerate(beams)}
    cos_half = np.array([math.cos(min(b.half_angle_rad, 0.5 * math.pi)) for b in beams.values()])
    cosines = cos_half[:, np.newaxis] + np.linspace(0.0, 1.0, COSINES + 1) * (
        1.0 - cos_half[:, np.newaxis]
    )
    gains = [b.gain(np.arccos(c)) for b, c in zip(beams.values(), cosines, strict=True)]
    counts = np.array([len(cone.ranges_m) for cone in cones], np.int64)
    start = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    range_m = np.concatenate([np.zeros(0), *(cone.ranges_m.astype(float) for cone in cones)])
    amplitude = np.concatenate([np.zeros(0), *(cone.amplitudes.astype(float) for cone in cones)])
    air_db = np.repeat([2.0 * cone.attenuation_db_m for cone in cones], counts) * range_m
    near_m = np.maximum(range_m, 1e-3)
    return Sightings(
        xy_m[:, 0].copy(), xy_m[:, 1].copy(), np.cos(yaw_rad), np.sin(yaw_rad),
        least_m, greatest_m,
        np.array([float(c.ranges_m[0]) if len(c.ranges_m) else math.inf for c in cones]),
        (counts + 0.3) / np.maximum(greatest_m - least_m, 0.1),
        np.array([which[id(cone.transducer.beam)] for cone in cones], np.int64), cos_half,
        20.0 * np.log10(np.maximum(np.array(gains).reshape(-1, COSINES + 1), 1e-3)),
        start, range_m,
        20.0 * np.log10(np.maximum(amplitude, 1e-12)) + FADING_DB * np.log10(near_m) + air_db,
    )  # fmt: skip


def empty_field(
    west_m: float,
    south_m: float,
    width_m: float,
    height_m: float,
    cell_m: float,
    tolerance_m: float,
) -> Field:
    """A field of which nothing is known."""
    shape = math.ceil(height_m / cell_m) + 1, math.ceil(width_m / cell_m) + 1
    planes = [np.zeros(shape, np.float32) for _ in range(3)]
    return Field(west_m, south_m, cell_m, tolerance_m, *planes)


def said(seen: Sightings, like: Field) -> Field:
    """What pings say of cells, in a field that lies as another one."""
    own = like._replace(
        evidence=np.zeros_like(like.evidence),
        echoes=np.zeros_like(like.echoes),
        level_db=np.zeros_like(like.level_db),
    )
    _say(seen, _marks(seen, like), own)
    return own


def fits(seen: Sightings, field: Field, own: int) -> FloatArray:
    """How well a field explains pings.

    Parameters
    ----------
    seen : Sightings
        The pings.
    field : Field
        What is said of cells.
    own : int
        1 if the pings themselves have a part in it, which is taken out for each; 0 if not.

    Returns
    -------
    (pings,) array
        Log-likelihood ratio of each ping, over one that nothing explains.
    """
    gain = np.zeros(len(seen.x_m))
    _fit(seen, _marks(seen, field), field, own, gain)
    return gain


def _marks(seen: Sightings, field: Field) -> NDArray[np.int32]:
    """For each step of range, one more than the number of the echo that is there; else 0."""
    bins = math.ceil(float(seen.greatest_m.max(initial=0.0)) / field.cell_m) + 2
    marks = np.zeros((len(seen.x_m), bins), np.int32)
    _mark(seen.start, seen.range_m, field.cell_m, field.tolerance_m, marks)
    return marks


@compiled
def _mark(
    start: NDArray[np.int64],
    range_m: FloatArray,
    cell_m: float,
    tolerance_m: float,
    marks: NDArray[np.int32],
) -> None:
    for ping in range(len(start) - 1):
        for echo in range(start[ping], start[ping + 1]):
            first = max(int((range_m[echo] - tolerance_m) / cell_m), 0)
            last = min(int((range_m[echo] + tolerance_m) / cell_m), marks.shape[1] - 1)
            for step in range(first, last + 1):
                marks[ping, step] = echo + 1


@inlined
def _ratio(
    mark: int, range_m: float, silent_m: float, background: float, probability: float
) -> float:
    """Log-likelihood ratio of something at a range, by a ping."""
    if mark:
        return math.log1p((1.0 - background) * probability / background)
    return math.log1p(-probability) if range_m < silent_m else 0.0


@inlined
def _probability(gain_db: float) -> float:
    return HEARD * min(max(1.0 + gain_db / UNHEARD_DB, 0.05), 1.0)


@inlined
def _rows_within(middle_m: float, reach_m: float, cell_m: float, count: int) -> tuple[int, int]:
    first = max(0, int((middle_m - reach_m) / cell_m))
    return first, min(count, int(max(middle_m + reach_m, 0.0) / cell_m) + 1)


@inlined
def _range_and_gain(seen: Sightings, ping: int, dx_m: float, dy_m: float) -> tuple[float, float]:
    """Range of a place off a ping's, and the beam's gain there, dB; 0 where it does not reach."""
    beam, reach_m = seen.beam[ping], seen.greatest_m[ping]
    cos_half = seen.cos_half[beam]
    along_m = dx_m * seen.axis_x[ping] + dy_m * seen.axis_y[ping]
    square = dx_m * dx_m + dy_m * dy_m
    is_beside = along_m <= 0.0 or along_m * along_m <= cos_half * cos_half * square
    if is_beside or square >= reach_m * reach_m or square < seen.least_m[ping] ** 2:
        return 0.0, 0.0
    range_m = math.sqrt(square)
    step = int((along_m / range_m - cos_half) / (1.0 - cos_half) * COSINES)
    return range_m, seen.gain_db[beam, min(step, COSINES)]


@inlined
def _background(seen: Sightings, ping: int, field: Field) -> float:
    """Probability that an echo is as near to a cell for no reason."""
    nearby: float = seen.background[ping] * (2.0 * field.tolerance_m + field.cell_m)
    return min(nearby, 0.9)


@inlined
def _likeness(level_db: float, sum_db: float, others: float) -> float:
    """How much likelier a level is than one of any echo, by those of others from the same cell."""
    difference = level_db - sum_db / others
    variance = LEVEL_STD_DB * LEVEL_STD_DB * (1.0 + 1.0 / others)
    peak = LEVELS_DB / math.sqrt(2.0 * math.pi * variance)
    likeness = peak * math.exp(-0.5 * difference * difference / variance)
    return UNRELATED + (1.0 - UNRELATED) * likeness


@compiled
def _say(seen: Sightings, marks: NDArray[np.int32], field: Field) -> None:
    cell_m = field.cell_m
    rows, columns = field.evidence.shape
    for ping in range(len(seen.x_m)):
        x_m, y_m = seen.x_m[ping] - field.west_m, seen.y_m[ping] - field.south_m
        background = _background(seen, ping, field)
        silent_m = seen.first_m[ping] - field.tolerance_m
        first_row, end_row = _rows_within(y_m, seen.greatest_m[ping], cell_m, rows)
        first_column, end_column = _rows_within(x_m, seen.greatest_m[ping], cell_m, columns)
        for row in range(first_row, end_row):
            for column in range(first_column, end_column):
                range_m, gain_db = _range_and_gain(
                    seen, ping, (column + 0.5) * cell_m - x_m, (row + 0.5) * cell_m - y_m
                )
                if range_m == 0.0:
                    continue
                mark = marks[ping, int(range_m / cell_m)]
                field.evidence[row, column] += _ratio(
                    mark, range_m, silent_m, background, _probability(gain_db)
                )
                if mark:
                    field.echoes[row, column] += 1.0
                    field.level_db[row, column] += seen.level_db[mark - 1] - gain_db


@compiled
def _fit(
    seen: Sightings, marks: NDArray[np.int32], field: Field, own: int, gain: FloatArray
) -> None:
    expected, best = np.zeros(marks.shape[1]), np.zeros(len(seen.range_m))
    for ping in range(len(seen.x_m)):
        expected[:] = 0.0
        background = _background(seen, ping, field)
        _expect(seen, marks, field, own, ping, expected, best)
        for echo in range(seen.start[ping], seen.start[ping + 1]):
            gain[ping] += math.log1p((1.0 - background) * best[echo] / background)
        for at in range(1, len(expected) - 1):
            # Cells of one thing lie side by side.
            if expected[at] >= expected[at - 1] and expected[at] > expected[at + 1]:
                gain[ping] -= expected[at]


@inlined
def _expect(
    seen: Sightings,
    marks: NDArray[np.int32],
    field: Field,
    own: int,
    ping: int,
    expected: FloatArray,
    best: FloatArray,
) -> None:
    """How much would be heard of silent cells, and how well believed ones explain each echo."""
    cell_m = field.cell_m
    rows, columns = field.evidence.shape
    x_m, y_m = seen.x_m[ping] - field.west_m, seen.y_m[ping] - field.south_m
    background = _background(seen, ping, field)
    silent_m = seen.first_m[ping] - field.tolerance_m
    first_row, end_row = _rows_within(y_m, seen.greatest_m[ping], cell_m, rows)
    first_column, end_column = _rows_within(x_m, seen.greatest_m[ping], cell_m, columns)
    for row in range(first_row, end_row):
        for column in range(first_column, end_column):
            evidence = float(field.evidence[row, column])
            if evidence < LEAST_EVIDENCE:
                continue
            range_m, gain_db = _range_and_gain(
                seen, ping, (column + 0.5) * cell_m - x_m, (row + 0.5) * cell_m - y_m
            )
            at = int(range_m / cell_m)
            mark = marks[ping, at]
            if range_m == 0.0 or (not mark and range_m >= silent_m):
                continue
            probability = _probability(gain_db)
            evidence -= own * _ratio(mark, range_m, silent_m, background, probability)
            others = field.echoes[row, column] - own * (mark > 0)
            if evidence < LEAST_EVIDENCE or others < 0.5:
                continue
            probability *= 1.0 / (1.0 + math.exp(-(evidence + PRIOR)))
            if mark:
                level_db = seen.level_db[mark - 1] - gain_db
                sum_db = field.level_db[row, column] - own * level_db
                probability *= _likeness(level_db, sum_db, others)
                best[mark - 1] = max(best[mark - 1], probability)
            else:
                expected[at] = max(expected[at], -math.log1p(-probability))
