"""Lines that echoes of mirrors vote for, and lines fitted to the best stretch of their feet."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.visibility.beams import (
    LOOKING_SHARE,
    WITHIN_GREATEST_M,
    WITHIN_LEAST_M,
    amplitude_gain,
    off_axis,
)
from usmap_ros.mapping.joint.visibility.echoes import Echoes
from usmap_ros.mapping.ping_table import (
    ABSORPTION,
    BIN_M,
    GREATEST_RANGE,
    HALF_ANGLE,
    LEAST_RANGE,
    PingTable,
    X,
    Y,
)
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.compiled import compiled, compiled_within, inlined
from usmap_ros.numerics.ordering import ascending

#: Directions of normals that are voted for, and width of a step of ρ, m.
DIRECTIONS, STEP_M = 180, 0.025
#: Places with most votes, and candidates among them, at the most.
MOST_CANDIDATES, MOST_TRIES = 6000, 600
#: Share of the half angle within which the foot must be for votes, and least gain of a beam.
VOTING_SHARE, LEAST_GAIN = 0.9, 1e-3
#: An echo is a wall's if it is so near to where it should be: first, and after refinement.
TOLERANCES_M = (0.04, 0.03, 0.03)
#: A silent ping counts as a miss if the faintest mirror would have been so many times as loud as
#: what would have been reported.
LOUD = 1.3
#: Widest gap between feet, m.
GAP_M = 0.6
#: Refinement of a direction at the most, rad, by so many feet at the least.
MOST_TURN, LEAST_FEET = 0.05, 3


class MirrorSearch(NamedTuple):
    """Where mirrors are looked for."""

    #: Pings.
    table: PingTable
    #: (pings,) integer array: their rows.
    pings: NDArray[np.int64]
    #: Theirs.
    echoes: Echoes
    #: (echoes,) bool array: whether a mirror may explain an echo.
    is_open: BoolArray
    #: (pings,) bool array: of sensors that report the first thing only, and not how loud it was.
    first_only: BoolArray
    #: Amplitude reflectivities that a mirror may have.
    faintest: float
    loudest: float
    #: Widest gap between feet, m.
    gap_m: float = GAP_M


class Feet(NamedTuple):
    """Feet on a line of pings that looked at it squarely, in their order: (feet,) arrays."""

    #: Where along the line each is.
    along_m: FloatArray
    #: The ping, and its echo of the line; -1: there should be one, but is none.
    ping: NDArray[np.int64]
    echo: NDArray[np.int64]
    #: Logarithm of the reflectivity that the echo tells.
    log_mirror: FloatArray


def candidates(search: MirrorSearch, least_votes: int) -> list[tuple[float, float]]:
    """Normals and distances of lines with most votes, the best first, none twice.

    Parameters
    ----------
    search : MirrorSearch
        Whose open echoes vote.
    least_votes : int
        That a candidate has.
    """
    numbers = search.table.numbers[search.pings]
    reach_m = float(1.5 * np.abs(numbers[:, :2]).max() + numbers[:, GREATEST_RANGE].max() + 1.0)
    votes = np.zeros((DIRECTIONS, int(2.0 * reach_m / STEP_M)), np.int32)
    _vote(search, reach_m, votes)
    votes[:, 1:] += votes[:, :-1].copy()
    flat = votes.ravel()
    order = np.argsort(-flat, kind="stable")[:MOST_CANDIDATES]
    kept: list[tuple[int, int]] = []
    is_near = np.zeros(votes.shape, bool)
    for place in order[flat[order] >= least_votes]:
        direction, step = divmod(int(place), votes.shape[1])
        if not is_near[direction, step]:
            kept.append((direction, step))
            around = np.arange(direction - 1, direction + 2) % DIRECTIONS
            is_near[around, max(0, step - 2) : step + 3] = True
        if len(kept) == MOST_TRIES:
            break
    return [(f * 2.0 * math.pi / DIRECTIONS, k * STEP_M - reach_m) for f, k in kept]


@compiled
def _vote(search: MirrorSearch, reach_m: float, votes: NDArray[np.int32]) -> None:
    """Count, for each direction and distance, the pings with an echo of a mirror from there."""
    table, pings, echoes = search.table, search.pings, search.echoes
    last = np.full(votes.shape, -1, np.int32)
    for index in range(len(pings)):
        numbers = table.numbers[pings[index]]
        for echo in range(echoes.start[index], echoes.start[index + 1]):
            if not search.is_open[echo]:
                continue
            range_m = echoes.range_m[echo]
            level = 2.0 * echoes.amplitude[echo] * range_m
            level *= math.exp(0.5 * numbers[ABSORPTION] * range_m)
            for f in range(DIRECTIONS):
                normal = f * 2.0 * math.pi / DIRECTIONS
                off = off_axis(table, pings[index], normal)
                if abs(off) > VOTING_SHARE * numbers[HALF_ANGLE]:
                    continue
                gain = max(amplitude_gain(table, pings[index], off), LEAST_GAIN)
                is_alike = search.faintest * gain <= level <= search.loudest * gain
                if not (is_alike or search.first_only[index]):
                    continue
                foot = numbers[X] * math.cos(normal) + numbers[Y] * math.sin(normal)
                k = int((foot + range_m + reach_m) / STEP_M)
                if 0 <= k < votes.shape[1] and last[f, k] != index:
                    last[f, k] = index
                    votes[f, k] += 1


@compiled
def fit(
    search: MirrorSearch, normal_rad: float, distance_m: float
) -> tuple[float, float, float, Feet]:
    """Refine a candidate by the hits of its best stretch, as often as there are tolerances.

    Returns
    -------
    normal_rad, distance_m : float
        Refined.
    score : float
        Hits less loud misses of the best stretch.
    hits : Feet
        That it has.
    """
    score, hits = _stretch(search, normal_rad, distance_m, TOLERANCES_M[0])
    for turn in range(1, len(TOLERANCES_M)):
        if len(hits.echo) < LEAST_FEET:
            break
        turn_rad, shift_m = _refinement(search, hits, normal_rad, distance_m)
        normal_rad += turn_rad
        distance_m += shift_m
        score, hits = _stretch(search, normal_rad, distance_m, TOLERANCES_M[turn])
    return normal_rad, distance_m, score, hits


@compiled
def share_that_heard(
    search: MirrorSearch, pings: NDArray[np.int64], normal_rad: float, distance_m: float
) -> float:
    """Share of some pings that have an open echo of a mirror on a line, whoever looked there."""
    heard, cosine, sine = 0, math.cos(normal_rad), math.sin(normal_rad)
    for index in pings:
        numbers = search.table.numbers[search.pings[index]]
        across = distance_m - (numbers[X] * cosine + numbers[Y] * sine)
        off = off_axis(search.table, search.pings[index], normal_rad)
        gain = max(amplitude_gain(search.table, search.pings[index], off), LEAST_GAIN)
        nearest, _ = _nearest_echo(search, index, across, TOLERANCES_M[-1], gain)
        heard += nearest >= 0
    return heard / len(pings)


@compiled_within
def _stretch(
    search: MirrorSearch, normal_rad: float, distance_m: float, tolerance_m: float
) -> tuple[float, Feet]:
    """Score and hits of the best stretch of a line."""
    return _best_stretch(_feet(search, normal_rad, distance_m, tolerance_m), search.gap_m)


@inlined
def _feet(search: MirrorSearch, normal_rad: float, distance_m: float, tolerance_m: float) -> Feet:
    """Feet of all pings that heard a line, or should have."""
    table, pings, count = search.table, search.pings, len(search.pings)
    along_m, log_mirror = np.empty(count), np.zeros(count)
    ping, echo = np.empty(count, np.int64), np.empty(count, np.int64)
    cosine, sine, seen = math.cos(normal_rad), math.sin(normal_rad), 0
    for index in range(count):
        numbers = table.numbers[pings[index]]
        across = distance_m - (numbers[X] * cosine + numbers[Y] * sine)
        nearest_m = numbers[LEAST_RANGE] + WITHIN_LEAST_M
        greatest_m = numbers[GREATEST_RANGE] - WITHIN_GREATEST_M
        off = off_axis(table, pings[index], normal_rad)
        if across <= nearest_m or across >= greatest_m:
            continue
        if abs(off) >= LOOKING_SHARE * numbers[HALF_ANGLE]:
            continue
        gain = max(amplitude_gain(table, pings[index], off), LEAST_GAIN)
        nearest, mirror = _nearest_echo(search, index, across, tolerance_m, gain)
        b = int((across - numbers[LEAST_RANGE]) / numbers[BIN_M])
        limit = math.sqrt(table.limit[pings[index], min(b, table.bins[pings[index]] - 1)])
        least = _usual(search) if search.first_only[index] else search.faintest
        faintest = least * gain * math.exp(-0.5 * numbers[ABSORPTION] * across)
        if nearest >= 0 or faintest / (2.0 * across) > LOUD * limit:
            along_m[seen] = numbers[Y] * cosine - numbers[X] * sine
            ping[seen], echo[seen], log_mirror[seen] = index, nearest, math.log(mirror)
            seen += 1
    order = ascending(along_m[:seen])
    return Feet(along_m[order], ping[order], echo[order], log_mirror[order])


@inlined
def _nearest_echo(
    search: MirrorSearch, index: int, across_m: float, tolerance_m: float, gain: float
) -> tuple[int, float]:
    """The echo of a ping nearest to where a mirror's should be, or -1; and its reflectivity."""
    echoes, numbers = search.echoes, search.table.numbers[search.pings[index]]
    nearest_m, nearest, mirror = tolerance_m, -1, 1.0
    for echo in range(echoes.start[index], echoes.start[index + 1]):
        away_m = abs(echoes.range_m[echo] - across_m)
        if not search.is_open[echo] or away_m >= nearest_m:
            continue
        range_m = echoes.range_m[echo]
        decay = gain * math.exp(-0.5 * numbers[ABSORPTION] * range_m)
        told = 2.0 * echoes.amplitude[echo] * range_m / decay
        if search.first_only[index]:
            told = _usual(search)
        if search.faintest < told < search.loudest:
            nearest_m, nearest, mirror = away_m, echo, told
    return nearest, mirror


@inlined
def _usual(search: MirrorSearch) -> float:
    """Reflectivity that a mirror is taken to have where ranges alone are known."""
    return math.sqrt(search.faintest * search.loudest)


@inlined
def _best_stretch(feet: Feet, gap_m: float) -> tuple[float, Feet]:
    """Hits less misses of the stretch that has most, without wide gaps; and its hits."""
    best, first, end, running, begin = 0.0, 0, 0, 0.0, 0
    for k in range(len(feet.echo)):
        if running <= 0.0 or feet.along_m[k] - feet.along_m[k - 1] > gap_m:
            running, begin = 0.0, k
        running += 1.0 if feet.echo[k] >= 0 else -1.0
        if running > best:
            best, first, end = running, begin, k + 1
    hits = first + np.flatnonzero(feet.echo[first:end] >= 0)
    return best, Feet(feet.along_m[hits], feet.ping[hits], feet.echo[hits], feet.log_mirror[hits])


@inlined
def _refinement(
    search: MirrorSearch, hits: Feet, normal_rad: float, distance_m: float
) -> tuple[float, float]:
    """Turn and shift of a line by which it fits hits best, by least squares."""
    cosine, sine = math.cos(normal_rad), math.sin(normal_rad)
    t_, tt_, r_, tr_, count = 0.0, 0.0, 0.0, 0.0, len(hits.echo)
    for k in range(count):
        numbers = search.table.numbers[search.pings[hits.ping[k]]]
        across = distance_m - (numbers[X] * cosine + numbers[Y] * sine)
        residual = search.echoes.range_m[hits.echo[k]] - across
        t_ -= hits.along_m[k]
        tt_ += hits.along_m[k] ** 2
        r_ += residual
        tr_ -= hits.along_m[k] * residual
    variance = tt_ - t_ * t_ / count
    slope = (tr_ - t_ * r_ / count) / variance if variance > 1e-4 else 0.0
    slope = min(max(slope, -MOST_TURN), MOST_TURN)
    return slope, (r_ - slope * t_) / count
