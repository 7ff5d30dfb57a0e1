"""Walls that answer from any side: straight runs of believed cells, found by a Hough transform."""

import math

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.forward_model.cell_evidence import CellEvidence
from usmap_ros.mapping.joint.surfaces.lines import BEGIN, END, NO_LINES, off_line
from usmap_ros.numerics.arrays import BoolArray, FloatArray, IndexArray
from usmap_ros.numerics.compiled import compiled, inlined
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
#: Cells within this distance of a line are on it.
ON_LINE_CELLS = 1.3
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
def _find_runs(  # noqa: C901, PLR0912, PLR0915 - a kernel is one loop
    places: NDArray[np.float64],
    weights: NDArray[np.float64],
    gap: float,
    lines: NDArray[np.float64],
) -> int:
    """Take the heaviest line out of the cells again and again; returns how many were found."""
    count, cells = 0, len(places)
    cosines, sines = np.empty(DIRECTIONS), np.empty(DIRECTIONS)
    for f in range(DIRECTIONS):
        cosines[f], sines[f] = (
            math.cos(f * math.pi / DIRECTIONS),
            math.sin(f * math.pi / DIRECTIONS),
        )
    reach = 0.0
    for i in range(cells):
        reach = max(reach, math.sqrt(places[i, 0] ** 2 + places[i, 1] ** 2))
    middle = int(reach) + 4
    votes = np.zeros((DIRECTIONS, 2 * middle + 2))
    alive, along, members = np.ones(cells, np.uint8), np.empty(cells), np.empty(cells, np.int64)
    for i in range(cells):
        for f in range(DIRECTIONS):
            votes[f, round(places[i, 0] * cosines[f] + places[i, 1] * sines[f]) + middle] += (
                weights[i]
            )
    most, best_at = np.empty(DIRECTIONS), np.empty(DIRECTIONS, np.int64)
    for f in range(DIRECTIONS):
        most[f], best_at[f] = _most_votes(votes[f])
    for _ in range(4 * len(lines)):
        best, direction, bucket = _heaviest(votes, most, best_at)
        if best < LEAST_WEIGHT or count == len(lines):
            break
        nx, ny, distance = cosines[direction], sines[direction], float(bucket - middle)
        for turn in range(2):
            tolerance = 1.6 if turn == 0 else ON_LINE_CELLS
            w_, t_, d_, tt_, td_ = 0.0, 0.0, 0.0, 0.0, 0.0
            for i in range(cells):
                if alive[i]:
                    across = places[i, 0] * nx + places[i, 1] * ny - distance
                    if abs(across) <= tolerance:
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
            w_, d_ = 0.0, 0.0
            for i in range(cells):
                if alive[i]:
                    across = places[i, 0] * nx + places[i, 1] * ny - distance
                    if abs(across) <= tolerance + 0.5:
                        w_ += weights[i]
                        d_ += weights[i] * across
            if w_ > 0.0:
                distance += d_ / w_
        found = 0
        for i in range(cells):
            if alive[i] and abs(places[i, 0] * nx + places[i, 1] * ny - distance) <= ON_LINE_CELLS:
                members[found], along[found] = i, places[i, 1] * nx - places[i, 0] * ny
                found += 1
        order, any_run, begin = ascending(along[:found]), False, 0
        while begin < found:
            end = begin
            while end + 1 < found and along[order[end + 1]] - along[order[end]] <= gap:
                end += 1
            length = along[order[end]] - along[order[begin]]
            weight, distinct, last, widest = 0.0, 0, -1e9, 0.0
            for k in range(begin, end + 1):
                weight += weights[members[order[k]]]
                if k > begin:
                    widest = max(widest, along[order[k]] - along[order[k - 1]])
                if round(along[order[k]]) != last:
                    distinct, last = distinct + 1, round(along[order[k]])
            is_run = weight >= LEAST_WEIGHT and distinct >= LEAST_CELLS
            is_run = is_run and length >= LEAST_LENGTH_CELLS and widest <= MOST_GAP_SHARE * length
            if is_run and distinct / (length + 1.0) >= LEAST_DENSITY and count < len(lines):
                any_run = True
                lines[count, 0], lines[count, 1], lines[count, 2] = nx, ny, distance
                lines[count, 3], lines[count, 4] = along[order[begin]], along[order[end]]
                count += 1
                for k in range(begin, end + 1):
                    i = members[order[k]]
                    alive[i] = 0
                    for f in range(DIRECTIONS):
                        at = round(places[i, 0] * cosines[f] + places[i, 1] * sines[f]) + middle
                        votes[f, at] -= weights[i]
            begin = end + 1
        if not any_run:
            # Not looked at again, but its cells may be part of other lines.
            for k in range(max(0, bucket - 1), min(2 * middle + 2, bucket + 2)):
                votes[direction, k] = -1e9
    return count


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
