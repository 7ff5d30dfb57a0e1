"""Power estimation: the powers of cells that make what was heard likeliest.

References
----------
.. [1] Févotte & Idier, "Algorithms for nonnegative matrix factorization with the
   β-divergence", Neural Computation 23 (2011) 2421-2456: the bound, and its minimum √(A / B).
.. [2] Lefèvre, Bach & Févotte, "Online algorithms for nonnegative matrix factorization with the
   Itakura-Saito divergence", WASPAA 2011: averages of the bounds instead of passes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.superposition.cells import QUARTERS
from usmap_ros.mapping.superposition.forward_model import GRADIENTS, Bins, bearing_fit
from usmap_ros.mapping.superposition.ping_bins import ECHO, NEVER, SILENCE, Look
from usmap_ros.mapping.superposition.visible_cells import VisibleCells
from usmap_ros.numerics.compiled import compiled, compiled_within, inlined

#: Share of the squared share of its strongest contributor by which a bin's power is steadier
#: than speckle: a lone object's amplitude varies by a few per cent from look to look.
STEADINESS = 0.9
#: A silent bin is trusted no more than a Gamma distribution of this shape.
MOST_SILENT_SHAPE = 4.0
#: Power that a cell starts with which may have returned an unexplained echo; an echo is unexplained
#: if it is so many times as strong as expected.
SEED_POWER, SEED_EXCESS = 0.05, 3.0
#: What is weaker vanishes; nothing is stronger: a reflector of some square metres.
LEAST_POWER, MOST_POWER = 2e-3, 6.0


class Powers(NamedTuple):
    """What is known of the powers of all cells.

    Parameters
    ----------
    power : (slots * QUARTERS,) float32 array
        v of each quarter.
    attraction, pressure : (slots * QUARTERS,) float32 arrays
        The averages A and B that it is learnt from; see `learn_powers`.
    looks : (slots,) float32 array
        Number of looks that have taught a cell.
    alive : (slots,) float32 array
        Not 0 for cells with any power.
    """

    power: NDArray[np.float32]
    attraction: NDArray[np.float32]
    pressure: NDArray[np.float32]
    looks: NDArray[np.float32]
    alive: NDArray[np.float32]


@inlined
def gamma_shape(squares: float, expected: float) -> float:
    """Shape of a power's distribution: 1 for speckle, more the more one contributor dominates."""
    return 1.0 / (1.0 - STEADINESS * min(1.0, squares / (expected * expected)))


@compiled_within
def weigh_bins(look: Look, bins: Bins) -> None:
    """Set `gradient` from what was heard in each range bin."""
    sums = bins.gradient
    # One by one: to copy a row, the compiler adds what it takes to complain of its shape.
    for column in range(GRADIENTS):
        sums[0, column] = 0.0
    for b in range(len(look.kind)):
        for column in range(GRADIENTS):
            sums[b + 1, column] = sums[b, column]
        if bins.squares[b] == 0.0:
            continue
        expected = bins.expected[b]
        shape = gamma_shape(bins.squares[b], expected)
        if look.kind[b] == ECHO:
            sums[b + 1, 0] += shape * look.power[b] / (expected * expected)
            sums[b + 1, 1] += shape / expected
            sums[b + 1, 2] += shape * look.power[b] / (expected * expected)
            sums[b + 1, 3] += shape / expected
        elif look.kind[b] == SILENCE:
            # Of the power of a silent bin it is known that it is below the limit: its mean then.
            ratio = look.limit[b] / expected
            mean = expected
            if ratio < 30.0:
                mean = max(expected - look.limit[b] / math.expm1(ratio), 0.0)
            shape = min(shape, MOST_SILENT_SHAPE)
            sums[b + 1, 0] += shape * mean / (expected * expected)
            sums[b + 1, 1] += shape / expected


@inlined
def gradient_between(
    bins: Bins, bin_count: int, low: float, high: float, heard: int
) -> tuple[float, float]:
    """Integrals over a stretch of range bins of both parts of the gradient.

    Parameters
    ----------
    bins : Bins
        Range bins with their weights, as `weigh_bins` left them.
    bin_count : int
        How many there are.
    low, high : float
        Where the stretch begins and ends.
    heard : int
        1 if silent bins are left out, else 0.
    """
    low, high = max(low, 0.0), min(high, float(bin_count))
    first, last = int(low), min(int(high), bin_count - 1)
    if low >= high:
        return 0.0, 0.0
    below, above, up = low - first, high - last, 2 * heard
    sums, down = bins.gradient, up + 1
    raises = sums[last, up] + above * (sums[last + 1, up] - sums[last, up])
    raises -= sums[first, up] + below * (sums[first + 1, up] - sums[first, up])
    lowers = sums[last, down] + above * (sums[last + 1, down] - sums[last, down])
    lowers -= sums[first, down] + below * (sums[first + 1, down] - sums[first, down])
    return raises, lowers


@compiled_within
def learn_powers(
    look: Look,
    seen: VisibleCells,
    count: int,
    bins: Bins,
    powers: Powers,
    least_news: float,
) -> None:
    """Move the powers in a look's cone towards the likeliest.

    A look's likelihood, as a function of one power v, is bounded by −(A / v + B v) + const with
    A = v₀² · (what raises it) and B = (what lowers it) at today's power v₀.  Averages of A and B
    over recent looks bound the likelihood of all of them, and √(A / B) is the best v: incremental
    majorisation-minimisation ([2]_), which learns from a look what a full pass would teach.  The
    k-th look at a cell counts k^−½.

    Parameters
    ----------
    look, seen, count, bins
        After `weigh_bins`.
    powers : Powers
        Of which those of the cells that are seen are changed.
    least_news : float
        What a look counts at least in the averages: a few pings are visited many times.
    """
    bin_count = len(look.kind)
    for cell in range(count):
        slot = seen.slot[cell]
        weight = seen.weight[cell]
        if weight <= 0.0:
            continue
        powers.looks[slot] += 1.0
        news = max(1.0 / math.sqrt(powers.looks[slot]), least_news)
        any_left = False
        for quarter in range(QUARTERS):
            index = slot * QUARTERS + quarter
            if powers.power[index] == 0.0:
                continue
            low, high = seen.low[cell, quarter], seen.high[cell, quarter]
            up, down = gradient_between(bins, bin_count, low, high, seen.heard[cell, quarter])
            share = weight * seen.density[cell]
            v = powers.power[index]
            # Sums over bins are rounded, and not even their differences may be negative.
            up, down = max(v * v * share * up, 0.0), max(share * down, 0.0)
            powers.attraction[index] += news * (up - powers.attraction[index])
            powers.pressure[index] += news * (down - powers.pressure[index])
            if powers.pressure[index] > 0.0:
                v = min(math.sqrt(powers.attraction[index] / powers.pressure[index]), MOST_POWER)
            powers.power[index] = v if v >= LEAST_POWER else 0.0
            any_left = any_left or powers.power[index] > 0.0
        if not any_left:
            powers.alive[slot] = 0.0
            powers.looks[slot] = 0.0


@compiled
def find_unexplained(look: Look, bins: Bins, following: NDArray[np.int32]) -> bool:
    """Whether an echo is much stronger than expected, and from each range bin on the first.

    Parameters
    ----------
    look, bins
        After `expect`.
    following : (bins + 1,) int32 array
        Set to the first range bin, from each on, that has such an echo, and beyond the last to
        more bins than any cell reaches to.
    """
    bin_count = len(look.kind)
    following[bin_count] = NEVER
    for b in range(bin_count - 1, -1, -1):
        following[b] = following[b + 1]
        if look.kind[b] == ECHO and look.power[b] > SEED_EXCESS * bins.expected[b]:
            following[b] = b
    return bool(following[0] != NEVER)


@compiled
def seed_unexplained(
    look: Look,
    seen: VisibleCells,
    count: int,
    bins: Bins,
    power: NDArray[np.float32],
    alive: NDArray[np.float32],
) -> None:
    """Give every quarter that may have returned an unexplained echo some power to start with.

    Parameters
    ----------
    look, seen, count, bins
        As in `expect`; here `seen` holds all cells of the cone.
    power : (slots * QUARTERS,) float32 array
        v; raised to `SEED_POWER` where it is lower.
    alive : (slots,) float32 array
        Set to 1 where there is any power now.
    """
    bin_count = len(look.kind)
    for cell in range(count):
        slot = seen.slot[cell]
        for quarter in range(QUARTERS):
            if not seen.heard[cell, quarter]:
                continue
            low, high = seen.low[cell, quarter], seen.high[cell, quarter]
            for b in range(max(math.floor(low), 0), min(math.floor(high) + 1, bin_count)):
                fit = bearing_fit(look, b, seen.bearing[cell])
                if look.kind[b] == ECHO and fit * look.power[b] > SEED_EXCESS * bins.expected[b]:
                    index = slot * QUARTERS + quarter
                    power[index] = max(power[index], SEED_POWER)
                    alive[slot] = 1.0
