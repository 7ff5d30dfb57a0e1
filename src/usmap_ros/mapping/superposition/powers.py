"""The forward model of a ping: expected powers, and how well they explain what was heard.

In range bin b a ping should return the power

    λ_b = n_b + Σ_c  G²(θ_c) e^{−2αr} r_c⁻⁴ · s_c · h_b(r_c) · v_c,

a sum over all quarters c of cells: noise n, gain G, absorption, spreading there and back, share s
of the sound that reaches c unblocked, share h of the quarter that lies in the bin, and the
power v that c scatters: the square of its reflectivity.  Many scatterers interfere, and their
power is exponentially distributed about λ (speckle).  One that dominates is steady: then the
power follows a Gamma distribution whose shape k says how far it does.

References
----------
.. [1] Févotte, Bertin & Durrieu, "Nonnegative matrix factorization with the Itakura-Saito
   divergence", Neural Computation 21 (2009) 793-830: the likelihood of powers.
.. [2] Févotte & Idier, "Algorithms for nonnegative matrix factorization with the
   β-divergence", Neural Computation 23 (2011) 2421-2456: the bound, and its minimum √(A / B).
.. [3] Lefèvre, Bach & Févotte, "Online algorithms for nonnegative matrix factorization with the
   Itakura-Saito divergence", WASPAA 2011: averages of the bounds instead of passes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.compiled import compiled, inlined
from usmap_ros.mapping.superposition.cells import QUARTERS, Seen
from usmap_ros.mapping.superposition.look import ECHO, SILENCE, Look

#: Range bins that a cell can reach into, and a block of nine cells.
CELL_BINS, BLOCK_BINS = 16, 48

#: Share of the squared share of its strongest contributor by which a bin's power is steadier
#: than speckle: a lone object's amplitude varies by a few per cent from look to look.
STEADINESS = 0.9
#: Power that a cell starts with which may have returned an unexplained echo; an echo is unexplained
#: if it is so many times as strong as expected.
SEED_POWER, SEED_EXCESS = 0.05, 3.0
#: What is weaker vanishes; nothing is stronger: a reflector of some square metres.
LEAST_POWER, MOST_POWER = 2e-3, 6.0
#: A silent bin is trusted no more than a Gamma distribution of this shape.
MOST_SILENT_SHAPE = 4.0


class Bins(NamedTuple):
    """Numbers for each range bin of a look; arrays of shape (bins,), and may be longer.

    Parameters
    ----------
    expected : float64 array
        λ.
    squares : float64 array
        Sum of the squared contributions to λ.
    pull, push : float64 arrays
        What raises, and what lowers, the powers that contribute: the two parts of the
        gradient of the log-likelihood with respect to λ.
    log_likelihood : float64 array
        Of what was heard.
    """

    expected: NDArray[np.float64]
    squares: NDArray[np.float64]
    pull: NDArray[np.float64]
    push: NDArray[np.float64]
    log_likelihood: NDArray[np.float64]


class Contributions(NamedTuple):
    """Expected power of each cell of a look by range bin.

    Parameters
    ----------
    first_bin : (cells,) integer array
        Range bin of the first column.
    columns : (cells,) integer array
        How many columns hold anything.
    parts : (cells, CELL_BINS) float32 array
        Contributions to λ.
    block : (BLOCK_BINS,) float64 array
        Room for those of a cell and its eight neighbours.
    """

    first_bin: NDArray[np.int64]
    columns: NDArray[np.int64]
    parts: NDArray[np.float32]
    block: NDArray[np.float64]


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
def overlap(b: int, low: float, high: float) -> float:
    """How much of a stretch of range bins lies in one of them."""
    return min(high, b + 1.0) - max(low, float(b))


@inlined
def bearing_fit(look: Look, b: int, bearing: float) -> float:
    """How well a direction fits what was measured of an echo's: 1 where that is not known."""
    weight = look.bearing_weight[b]
    if weight == 0.0:
        return 1.0
    return math.exp(-weight * (bearing - look.bearing[b]) ** 2)


@inlined
def hears_any(look: Look, low: float, high: float) -> bool:
    """Whether there is an echo in a stretch of range bins."""
    first = max(math.floor(low), 0)
    return first < len(look.kind) and look.next_echo[first] <= math.floor(high)


@inlined
def where_heard(
    look: Look, low: float, high: float, sharpness: float
) -> tuple[bool, float, float, float]:
    """Where a quarter's power belongs, whose range is blurred.

    What stands in one place echoes at once: if there is an echo where it may come from, that is
    it, and silence elsewhere in that range says nothing.

    Parameters
    ----------
    look : Look
        The ping.
    low, high, sharpness : float
        Of the quarter: see `usmap_ros.mapping.superposition.cells.Seen`.

    Returns
    -------
    heard : bool
        Whether it may have been heard: only bins count then that are not silent.
    low, high : float
        Range bins between which its power lies.
    density : float
        Share of the power in each bin that lies between.
    """
    if hears_any(look, low, high):
        return True, low, high, 1.0 / ((high - low) * sharpness)
    middle, half = 0.5 * (low + high), 0.5 * (high - low) * sharpness
    return False, middle - half, middle + half, 0.5 / half


@compiled
def split_expected(
    look: Look, seen: Seen, count: int, power: NDArray[np.float32], parts: Contributions
) -> None:
    """Work out the expected power of each cell by range bin.

    Parameters
    ----------
    look : Look
        The ping.
    seen : Seen
        Its cells.
    count : int
        How many there are.
    power : (slots * QUARTERS,) float32 array
        v of each quarter.
    parts : Contributions
        Set.
    """
    bin_count = len(look.kind)
    for cell in range(count):
        slot = seen.slot[cell]
        start = math.floor(
            min(seen.low[cell, 0], seen.low[cell, 1], seen.low[cell, 2], seen.low[cell, 3])
        )
        parts.first_bin[cell] = start
        parts.columns[cell] = 0
        for column in range(CELL_BINS):
            parts.parts[cell, column] = 0.0
        for quarter in range(QUARTERS):
            returned = seen.weight[cell] * power[slot * QUARTERS + quarter]
            if returned <= 0.0:
                continue
            heard, low, high, density = where_heard(
                look, seen.low[cell, quarter], seen.high[cell, quarter], seen.sharpness[cell]
            )
            returned *= density
            last = min(math.floor(high) + 1, bin_count, start + CELL_BINS)
            parts.columns[cell] = max(parts.columns[cell], last - start)
            for b in range(max(math.floor(low), 0), last):
                if not (heard and look.kind[b] == SILENCE):
                    fit = bearing_fit(look, b, seen.bearing[cell])
                    parts.parts[cell, b - start] += returned * fit * overlap(b, low, high)


@compiled
def expect(look: Look, count: int, parts: Contributions, bins: Bins) -> None:
    """Sum up the expected power of each range bin, and the squares of its cells' shares in it."""
    bin_count = len(look.kind)
    for b in range(bin_count):
        bins.expected[b] = look.noise
        bins.squares[b] = 0.0
    for cell in range(count):
        start = parts.first_bin[cell]
        for column in range(max(0, -start), parts.columns[cell]):
            part = parts.parts[cell, column]
            bins.expected[start + column] += part
            bins.squares[start + column] += part * part


@inlined
def gamma_shape(squares: float, expected: float) -> float:
    """Shape of a power's distribution: 1 for speckle, more the more one contributor dominates."""
    return 1.0 / (1.0 - STEADINESS * min(1.0, squares / (expected * expected)))


@compiled
def weigh_bins(look: Look, bins: Bins) -> None:
    """Set `pull` and `push` of each range bin from what was heard there."""
    for b in range(len(look.kind)):
        bins.pull[b] = 0.0
        bins.push[b] = 0.0
        if bins.squares[b] == 0.0:
            continue
        expected = bins.expected[b]
        shape = gamma_shape(bins.squares[b], expected)
        if look.kind[b] == ECHO:
            bins.pull[b] = shape * look.power[b] / (expected * expected)
            bins.push[b] = shape / expected
        elif look.kind[b] == SILENCE:
            # Of the power of a silent bin it is known that it is below the limit: its mean then.
            ratio = look.limit[b] / expected
            mean = expected
            if ratio < 30.0:
                mean = max(expected - look.limit[b] / math.expm1(ratio), 0.0)
            shape = min(shape, MOST_SILENT_SHAPE)
            bins.pull[b] = shape * mean / (expected * expected)
            bins.push[b] = shape / expected


@compiled
def learn_powers(
    look: Look,
    seen: Seen,
    count: int,
    bins: Bins,
    powers: Powers,
    price: float,
    least_news: float,
) -> None:
    """Move the powers in a look's cone towards the likeliest.

    A look's likelihood, as a function of one power v, is bounded by −(A / v + B v) + const with
    A = v₀² · pull and B = push at today's power v₀.  Averages of A and B over recent looks bound
    the likelihood of all of them, and √(A / B) is the best v: incremental
    majorisation-minimisation ([3]_), which learns from a look what a full pass would teach.  The
    k-th look at a cell counts k^−½.

    Parameters
    ----------
    look, seen, count, bins
        After `weigh_bins`.
    powers : Powers
        Changed.
    price : float
        Of power: the rate of its exponential prior.
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
            heard, low, high, density = where_heard(
                look, seen.low[cell, quarter], seen.high[cell, quarter], seen.sharpness[cell]
            )
            up, down = 0.0, 0.0
            for b in range(max(math.floor(low), 0), min(math.floor(high) + 1, bin_count)):
                if not (heard and look.kind[b] == SILENCE):
                    up += overlap(b, low, high) * bins.pull[b]
                    down += overlap(b, low, high) * bins.push[b]
            up, down = density * up, density * down
            v = powers.power[index]
            powers.attraction[index] += news * (v * v * weight * up - powers.attraction[index])
            powers.pressure[index] += news * (weight * down - powers.pressure[index])
            if powers.pressure[index] > 0.0:
                pressure = powers.pressure[index] + news * price
                v = min(math.sqrt(powers.attraction[index] / pressure), MOST_POWER)
            powers.power[index] = v if v >= LEAST_POWER else 0.0
            any_left = any_left or powers.power[index] > 0.0
        if not any_left:
            powers.alive[slot] = 0.0
            powers.looks[slot] = 0.0


@compiled
def is_explained(look: Look, bins: Bins) -> bool:
    """Whether no echo is much stronger than expected."""
    for b in range(len(look.kind)):
        if look.kind[b] == ECHO and look.power[b] > SEED_EXCESS * bins.expected[b]:
            return False
    return True


@compiled
def seed_unexplained(
    look: Look,
    seen: Seen,
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
            low, high = seen.low[cell, quarter], seen.high[cell, quarter]
            for b in range(max(math.floor(low), 0), min(math.floor(high) + 1, bin_count)):
                fit = bearing_fit(look, b, seen.bearing[cell])
                if look.kind[b] == ECHO and fit * look.power[b] > SEED_EXCESS * bins.expected[b]:
                    index = slot * QUARTERS + quarter
                    power[index] = max(power[index], SEED_POWER)
                    alive[slot] = 1.0
