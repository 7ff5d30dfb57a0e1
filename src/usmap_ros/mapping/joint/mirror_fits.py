"""Lines that echoes of mirrors vote for, and lines fitted to the best stretch of their feet."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.beams import (
    LOOKING_SHARE,
    WITHIN_GREATEST_M,
    WITHIN_LEAST_M,
    amplitude_gain,
    off_axis,
)
from usmap_ros.mapping.joint.echoes import Echoes
from usmap_ros.mapping.joint.field import (
    ABSORPTION,
    BIN_M,
    GREATEST_RANGE,
    HALF_ANGLE,
    LEAST_RANGE,
    X,
    Y,
)
from usmap_ros.mapping.looks import Looks
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.compiled import compiled

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
#: Refinement of a direction at the most, rad.
MOST_TURN = 0.05


def candidates(
    looks: Looks,
    pings: NDArray[np.int64],
    echoes: Echoes,
    is_open: BoolArray,
    mirrors: tuple[float, float],
    least_votes: int,
) -> list[tuple[float, float]]:
    """Normals and distances of lines with most votes, the best first, none twice.

    Parameters
    ----------
    looks, pings, echoes
        As in `usmap_ros.mapping.joint.mirror_walls.mirror_walls`.
    is_open : (echoes,) bool array
        Those that may vote.
    mirrors : (least, most)
        Amplitude reflectivities that a mirror may have.
    least_votes : int
        That a candidate has.
    """
    numbers = looks.numbers[pings]
    reach_m = float(1.5 * np.abs(numbers[:, :2]).max() + numbers[:, GREATEST_RANGE].max() + 1.0)
    votes = np.zeros((DIRECTIONS, int(2.0 * reach_m / STEP_M)), np.int32)
    _vote(looks, pings, echoes, is_open, mirrors, reach_m, votes)
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
def _vote(
    looks: Looks,
    pings: NDArray[np.int64],
    echoes: Echoes,
    is_open: BoolArray,
    mirrors: tuple[float, float],
    reach_m: float,
    votes: NDArray[np.int32],
) -> None:
    """Count, for each direction and distance, the pings with an echo of a mirror from there."""
    last = np.full(votes.shape, -1, np.int32)
    for index in range(len(pings)):
        numbers = looks.numbers[pings[index]]
        for echo in range(echoes.start[index], echoes.start[index + 1]):
            if not is_open[echo]:
                continue
            range_m = echoes.range_m[echo]
            level = 2.0 * echoes.amplitude[echo] * range_m
            level *= math.exp(0.5 * numbers[ABSORPTION] * range_m)
            for f in range(DIRECTIONS):
                normal = f * 2.0 * math.pi / DIRECTIONS
                off = off_axis(looks, pings[index], normal)
                if abs(off) > VOTING_SHARE * numbers[HALF_ANGLE]:
                    continue
                gain = max(amplitude_gain(looks, pings[index], off), LEAST_GAIN)
                if level < mirrors[0] * gain or level > mirrors[1] * gain:
                    continue
                foot = numbers[X] * math.cos(normal) + numbers[Y] * math.sin(normal)
                k = int((foot + range_m + reach_m) / STEP_M)
                if 0 <= k < votes.shape[1] and last[f, k] != index:
                    last[f, k] = index
                    votes[f, k] += 1


@compiled
def fit(  # noqa: C901, PLR0912, PLR0913, PLR0915, PLR0917 - a kernel is one loop
    looks: Looks,
    pings: NDArray[np.int64],
    echoes: Echoes,
    is_open: BoolArray,
    mirrors: tuple[float, float],
    normal_rad: float,
    distance_m: float,
    hit_pings: NDArray[np.int64],
    hit_echoes: NDArray[np.int64],
    feet_m: FloatArray,
) -> tuple[float, int, float, float, float, float]:
    """Refine a candidate twice by the hits of its best stretch.

    Returns
    -------
    score : float
        Hits less loud misses of the best stretch.
    hits : int
        How many of `hit_pings`, `hit_echoes` and `feet_m` are set.
    normal_rad, distance_m : float
        Refined.
    log_mirror, deviation : float
        Logarithm of the reflectivity: its median, and the median deviation from that.
    """
    count = len(pings)
    along, score_of = np.empty(count), np.empty(count)
    echo_of, ping_of = np.empty(count, np.int64), np.empty(count, np.int64)
    log_mirror, chosen = np.empty(count), np.empty(count)
    best, hits = 0.0, 0
    for turn in range(len(TOLERANCES_M)):
        cosine, sine, seen = math.cos(normal_rad), math.sin(normal_rad), 0
        for index in range(count):
            numbers = looks.numbers[pings[index]]
            across = distance_m - (numbers[X] * cosine + numbers[Y] * sine)
            least = numbers[LEAST_RANGE] + WITHIN_LEAST_M
            greatest = numbers[GREATEST_RANGE] - WITHIN_GREATEST_M
            off = off_axis(looks, pings[index], normal_rad)
            half = numbers[HALF_ANGLE]
            if across <= least or across >= greatest or abs(off) >= LOOKING_SHARE * half:
                continue
            gain = max(amplitude_gain(looks, pings[index], off), LEAST_GAIN)
            nearest, nearest_echo, mirror_of = TOLERANCES_M[turn], -1, 1.0
            for echo in range(echoes.start[index], echoes.start[index + 1]):
                away = abs(echoes.range_m[echo] - across)
                if not is_open[echo] or away >= nearest:
                    continue
                range_m = echoes.range_m[echo]
                decay = gain * math.exp(-0.5 * numbers[ABSORPTION] * range_m)
                mirror = 2.0 * echoes.amplitude[echo] * range_m / decay
                if mirrors[0] < mirror < mirrors[1]:
                    nearest, nearest_echo, mirror_of = away, echo, mirror
            b = min(
                int((across - numbers[LEAST_RANGE]) / numbers[BIN_M]), looks.bins[pings[index]] - 1
            )
            limit = math.sqrt(looks.limit[pings[index], b])
            faintest = mirrors[0] * gain * math.exp(-0.5 * numbers[ABSORPTION] * across)
            is_loud = faintest / (2.0 * across) > LOUD * limit
            if nearest_echo >= 0 or is_loud:
                along[seen], echo_of[seen], ping_of[seen] = (
                    numbers[Y] * cosine - numbers[X] * sine, nearest_echo, index,
                )  # fmt: skip
                score_of[seen] = 1.0 if nearest_echo >= 0 else -1.0
                log_mirror[seen] = math.log(mirror_of)
                seen += 1
        order = np.argsort(along[:seen])
        best, first, last, running, begin = 0.0, 0, -1, 0.0, 0
        for k in range(seen):
            if running <= 0.0 or along[order[k]] - along[order[k - 1]] > GAP_M:
                running, begin = 0.0, k
            running += score_of[order[k]]
            if running > best:
                best, first, last = running, begin, k
        hits = 0
        for k in range(first, last + 1):
            at = order[k]
            if echo_of[at] >= 0:
                hit_pings[hits], hit_echoes[hits], feet_m[hits] = (
                    ping_of[at],
                    echo_of[at],
                    along[at],
                )
                chosen[hits] = log_mirror[at]
                hits += 1
        if hits < 3:
            return 0.0, 0, normal_rad, distance_m, 0.0, 9.0
        if turn == len(TOLERANCES_M) - 1:
            break
        t_, tt_, r_, tr_ = 0.0, 0.0, 0.0, 0.0
        for k in range(hits):
            numbers = looks.numbers[pings[hit_pings[k]]]
            across = distance_m - (numbers[X] * cosine + numbers[Y] * sine)
            residual = echoes.range_m[hit_echoes[k]] - across
            t_ -= feet_m[k]
            tt_ += feet_m[k] ** 2
            r_ += residual
            tr_ -= feet_m[k] * residual
        variance = tt_ - t_ * t_ / hits
        slope = (tr_ - t_ * r_ / hits) / variance if variance > 1e-4 else 0.0
        slope = min(max(slope, -MOST_TURN), MOST_TURN)
        distance_m += (r_ - slope * t_) / hits
        normal_rad += slope
    usual = np.median(chosen[:hits])
    deviation = np.median(np.abs(chosen[:hits] - usual))
    return best, hits, normal_rad, distance_m, usual, deviation
