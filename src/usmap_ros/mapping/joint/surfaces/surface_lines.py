"""Walls that answer from any side: straight runs of believed cells, found by a Hough transform."""

import math

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.forward_model.cell_evidence import CellEvidence
from usmap_ros.mapping.joint.surfaces.lines import BEGIN, END, NO_LINES, off_line
from usmap_ros.numerics.arrays import BoolArray, FloatArray, IndexArray
from usmap_ros.numerics.compiled import compiled, compiled_within, inlined
from usmap_ros.numerics.ordering import ascending
from usmap_ros.numerics.special import logistic

#: Directions that are looked for.
DIRECTIONS = 120
#: A run has so many cells (by their probability), so many different ones along it, such a length
#: and density.
LEAST_WEIGHT, LEAST_CELLS, LEAST_LENGTH_CELLS, LEAST_DENSITY = 4.0, 5, 6.0, 0.35
#: Share of a run that its widest gap may take: two things side by side are no wall.
MOST_GAP_SHARE = 0.4
MOST_LINES = 200
#: Candidates that are looked at, over that.
MOST_TRIES = 4
#: Cells within this distance of a line are on it.
ON_LINE_CELLS = 1.3
#: Those within this distance count when a direction is first corrected.
NEAR_LINE_CELLS = 1.6
#: A run that is one thing's arc may be moved so far across before ranges to it tell.
ARC_CELLS = 1.0
#: Largest correction of a direction by least squares, rad.
MOST_TURN = 0.03


def surface_lines(
    log_odds: FloatArray, believed: BoolArray, gap_cells: float
) -> NDArray[np.float64]:
    """Lines through believed cells, the heaviest first.

    Parameters
    ----------
    log_odds : (rows, columns) array
        Of each cell.
    believed : (rows, columns) bool array
        Those that count.
    gap_cells : float
        Widest gap in a run.

    Returns
    -------
    lines : (lines, 5) array
        See `usmap_ros.mapping.joint.surfaces.lines`.
    """
    rows, columns = np.nonzero(believed)
    if len(rows) < LEAST_CELLS or gap_cells <= 0.0:
        return NO_LINES
    places = np.stack([columns, rows], axis=1).astype(np.float64)
    weights = logistic(log_odds[rows, columns]).astype(np.float64)
    lines = np.zeros((MOST_LINES, 5))
    count = _find_runs(places, weights, gap_cells, lines)
    return lines[:count]


def without_arcs(
    lines: NDArray[np.float64], believed: BoolArray, evidence: CellEvidence
) -> NDArray[np.float64]:
    """Lines but for those along the arc of one thing that was heard from one side.

    Whoever hears a thing from ahead alone knows how far away it is, and not where across: cells
    beside each other explain its echoes as well as it does, as far as one moves across without
    ranges telling, which is the less the more directions it was heard from.

    Parameters
    ----------
    lines : (lines, 5) array
        Through believed cells.
    believed : (rows, columns) bool array
        Those.
    evidence : CellEvidence
        Of all cells.
    """
    rows, columns = np.nonzero(believed)
    heard, cosine, sine = (
        each.reshape(believed.shape)[rows, columns]
        for each in (evidence.heard, evidence.axis_cos, evidence.axis_sin)
    )
    is_arc = np.zeros(len(lines), bool)
    for number, line in enumerate(lines):
        across, along = off_line(line, rows, columns)
        on = (np.abs(across) <= ON_LINE_CELLS) & (along >= line[BEGIN]) & (along <= line[END])
        # Mean square of the sine of directions off the one from which most was heard.
        total = max(float(heard[on].sum()), 1e-6)
        square = 0.5 * (1.0 - math.hypot(cosine[on].sum(), sine[on].sum()) / total)
        is_arc[number] = (line[END] - line[BEGIN]) * math.sqrt(max(square, 0.0)) < ARC_CELLS
    kept: NDArray[np.float64] = lines[~is_arc]
    return kept


@compiled
def _find_runs(places: FloatArray, weights: FloatArray, gap: float, lines: FloatArray) -> int:
    """Take the heaviest line out of the cells again and again; returns how many were found."""
    votes, most, best_at = _votes(places, weights)
    is_left, count, middle = np.ones(len(places), np.bool_), 0, votes.shape[1] // 2 - 1
    for _ in range(MOST_TRIES * len(lines)):
        best, direction, bucket = _heaviest(votes, most, best_at)
        if best < LEAST_WEIGHT or count == len(lines):
            break
        nx, ny, distance = _refined(places, weights, is_left, direction, float(bucket - middle))
        members, along = _cells_on(places, is_left, nx, ny, distance)
        before, begin = count, 0
        while begin < len(members):
            end = _end_of_run(along, begin, gap)
            run, run_along = members[begin:end], along[begin:end]
            if count < len(lines) and _is_wall(run_along, weights[run]):
                lines[count, 0], lines[count, 1], lines[count, 2] = nx, ny, distance
                lines[count, 3], lines[count, 4] = run_along[0], run_along[-1]
                count += 1
                is_left[run] = False
                _vote(places, weights, run, -1.0, votes)
            begin = end
        if count == before:
            # Not looked at again, but its cells may be part of other lines.
            votes[direction, max(0, bucket - 1) : bucket + 2] = -1e9
    return count


@inlined
def _votes(
    places: FloatArray, weights: FloatArray
) -> tuple[FloatArray, FloatArray, NDArray[np.int64]]:
    """Votes of cells for each direction and distance, and the most that each direction has."""
    reach = 0.0
    for i in range(len(places)):
        reach = max(reach, math.sqrt(places[i, 0] ** 2 + places[i, 1] ** 2))
    votes = np.zeros((DIRECTIONS, 2 * (int(reach) + 4) + 2))
    _vote(places, weights, np.arange(len(places)), 1.0, votes)
    most, best_at = np.empty(DIRECTIONS), np.empty(DIRECTIONS, np.int64)
    for f in range(DIRECTIONS):
        most[f], best_at[f] = _most_votes(votes[f])
    return votes, most, best_at


@compiled_within
def _vote(
    places: FloatArray,
    weights: FloatArray,
    cells: NDArray[np.int64],
    share: float,
    votes: FloatArray,
) -> None:
    """Add a share of what some cells weigh to the votes of all lines through them."""
    middle = votes.shape[1] // 2 - 1
    for f in range(DIRECTIONS):
        cosine, sine = math.cos(f * math.pi / DIRECTIONS), math.sin(f * math.pi / DIRECTIONS)
        for i in cells:
            at = round(places[i, 0] * cosine + places[i, 1] * sine) + middle
            votes[f, at] += share * weights[i]


@inlined
def _refined(
    places: FloatArray, weights: FloatArray, is_left: BoolArray, direction: int, distance: float
) -> tuple[float, float, float]:
    """Normal and distance of the line that fits cells near a candidate best, by least squares."""
    nx = math.cos(direction * math.pi / DIRECTIONS)
    ny = math.sin(direction * math.pi / DIRECTIONS)
    for turn in range(2):
        tolerance = NEAR_LINE_CELLS if turn == 0 else ON_LINE_CELLS
        w_, t_, d_, tt_, td_ = 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(len(places)):
            across = places[i, 0] * nx + places[i, 1] * ny - distance
            if is_left[i] and abs(across) <= tolerance:
                t = places[i, 1] * nx - places[i, 0] * ny
                w_ += weights[i]
                t_ += weights[i] * t
                d_ += weights[i] * across
                tt_ += weights[i] * t * t
                td_ += weights[i] * t * across
        if w_ <= 0.0:
            break
        variance = tt_ / w_ - (t_ / w_) ** 2
        slope = (td_ / w_ - t_ * d_ / w_**2) / variance if variance > 1e-6 else 0.0
        slope = min(max(slope, -MOST_TURN), MOST_TURN)
        nx, ny = nx + slope * ny, ny - slope * nx
        length = math.sqrt(nx * nx + ny * ny)
        nx, ny = nx / length, ny / length
        distance += _mean_off(places, weights, is_left, nx, ny, distance, tolerance + 0.5)
    return nx, ny, distance


@inlined
def _mean_off(
    places: FloatArray,
    weights: FloatArray,
    is_left: BoolArray,
    nx: float,
    ny: float,
    distance: float,
    tolerance: float,
) -> float:
    """How far cells near a line are off it, on the mean."""
    w_, d_ = 0.0, 0.0
    for i in range(len(places)):
        across = places[i, 0] * nx + places[i, 1] * ny - distance
        if is_left[i] and abs(across) <= tolerance:
            w_ += weights[i]
            d_ += weights[i] * across
    return d_ / w_ if w_ > 0.0 else 0.0


@inlined
def _cells_on(
    places: FloatArray, is_left: BoolArray, nx: float, ny: float, distance: float
) -> tuple[NDArray[np.int64], FloatArray]:
    """Cells on a line in their order along it, and where along it they are."""
    members, along, count = np.empty(len(places), np.int64), np.empty(len(places)), 0
    for i in range(len(places)):
        off = abs(places[i, 0] * nx + places[i, 1] * ny - distance)
        if is_left[i] and off <= ON_LINE_CELLS:
            members[count], along[count] = i, places[i, 1] * nx - places[i, 0] * ny
            count += 1
    order = ascending(along[:count])
    return members[order], along[order]


@inlined
def _end_of_run(along: FloatArray, begin: int, gap: float) -> int:
    """Where a run of cells without wide gaps ends that begins at some place: behind its last."""
    end = begin + 1
    while end < len(along) and along[end] - along[end - 1] <= gap:
        end += 1
    return end


@inlined
def _is_wall(along: FloatArray, weights: FloatArray) -> bool:
    """Whether a run of cells is heavy, long and dense enough for a wall."""
    weight, distinct, widest, length = 0.0, 1, 0.0, along[-1] - along[0]
    for k in range(len(along)):
        weight += weights[k]
        if k > 0:
            widest = max(widest, along[k] - along[k - 1])
            distinct += round(along[k]) != round(along[k - 1])
    is_run = weight >= LEAST_WEIGHT and distinct >= LEAST_CELLS and length >= LEAST_LENGTH_CELLS
    is_dense = widest <= MOST_GAP_SHARE * length and distinct / (length + 1.0) >= LEAST_DENSITY
    return is_run and is_dense


@inlined
def _most_votes(votes: FloatArray) -> tuple[float, int]:
    """The most votes that three buckets beside each other have, and the middle one of these."""
    most, at = 0.0, 0
    for k in range(1, len(votes) - 1):
        total = votes[k - 1] + votes[k] + votes[k + 1]
        if total > most:
            most, at = total, k
    return most, at


@inlined
def _heaviest(votes: FloatArray, most: FloatArray, at: IndexArray) -> tuple[float, int, int]:
    """Votes, direction and bucket of the line that most cells vote for.

    Votes only go: where those of a direction's best buckets are still there it is as it was, and
    one that had fewer before need not be looked at again.

    Parameters
    ----------
    votes : (DIRECTIONS, buckets) array
        Of all cells that are left.
    most, at : (DIRECTIONS,) arrays
        By `_most_votes`, when each was last looked at; renewed.
    """
    while True:
        f = int(most.argmax())
        k = at[f]
        if most[f] <= 0.0 or votes[f, k - 1] + votes[f, k] + votes[f, k + 1] == most[f]:
            return most[f], f, int(k)
        most[f], at[f] = _most_votes(votes[f])
