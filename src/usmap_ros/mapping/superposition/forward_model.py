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
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.superposition.cells import CELL_BINS, QUARTERS
from usmap_ros.mapping.superposition.ping_bins import SILENCE, Look
from usmap_ros.mapping.superposition.visible_cells import VisibleCells
from usmap_ros.numerics.compiled import compiled, inlined

#: Range bins that a block of nine cells can reach into.
BLOCK_BINS = 48
#: Rows of `Bins.counted`: of a quarter that is silent as far as is known, and of
#: one that may have returned an echo.
ALL_BINS, NOT_SILENT = 0, 1
#: The same for loops: places counted without a sign cannot be meant from the end of an array, and
#: the compiler sees that they lie one beside the other.
COLUMNS = np.uint64(CELL_BINS)
#: Columns of `Bins.gradient`.
GRADIENTS = 4
_ZERO, _ONE = np.float32(0.0), np.float32(1.0)


class Bins(NamedTuple):
    """Numbers for each range bin of a look.

    Arrays go on for `CELL_BINS` after the last bin, so that no cell's bins are beyond them, and may
    be longer.  Numbers are single and loops of fixed length: so the compiler works out all bins of
    a cell at once.

    Parameters
    ----------
    every : (bins,) int32 array
        0, 1, 2 and so on.
    counted : (2, bins) float32 array
        1 for bins that count, 0 for others, for both kinds of quarters.
    expected : (bins,) float32 array
        λ, the power that each range bin should return.
    squares : (bins,) float32 array
        Sum of the squared contributions to λ.
    inverse : (bins,) float32 array
        1 / λ; 0 where nothing but noise is expected.
    least_rest : (bins,) float32 array
        Share of the noise in λ.
    is_echo : (bins,) float32 array
        1 where there was an echo, else 0.
    level : (bins,) float32 array
        Power of the echo, or below which one may have gone unreported, over λ.
    log_likelihood : (bins,) float32 array
        Of silence up to the level; 0 where there was an echo.
    gradient : (bins, GRADIENTS) float64 array
        Sums over the bins before each of the two parts of the gradient of the log-likelihood with
        respect to λ: what raises the powers that contribute, and what lowers them; then the same
        of bins that are not silent.
    """

    every: NDArray[np.int32]
    counted: NDArray[np.float32]
    expected: NDArray[np.float32]
    squares: NDArray[np.float32]
    inverse: NDArray[np.float32]
    least_rest: NDArray[np.float32]
    is_echo: NDArray[np.float32]
    level: NDArray[np.float32]
    log_likelihood: NDArray[np.float32]
    gradient: NDArray[np.float64]


class Contributions(NamedTuple):
    """Expected power of each cell of a look by range bin.

    Parameters
    ----------
    parts : (cells, CELL_BINS) float32 array
        Contributions to λ, from the cell's first bin on.
    block : (BLOCK_BINS,) float32 array
        Room for those of a cell and its eight neighbours.
    """

    parts: NDArray[np.float32]
    block: NDArray[np.float32]


@inlined
def overlap(column: np.float32, low: np.float32, high: np.float32) -> np.float32:
    """How much of a stretch of range bins lies in one of them, all counted from the same."""
    return max(min(high, column + _ONE) - max(low, column), _ZERO)


@inlined
def bearing_fit(look: Look, b: int, bearing: float) -> float:
    """How well a direction fits what was measured of an echo's: 1 where that is not known."""
    weight = look.bearing_weight[b]
    if weight == 0.0:
        return 1.0
    return math.exp(-weight * (bearing - look.bearing[b]) ** 2)


@compiled
def expect(
    look: Look,
    seen: VisibleCells,
    count: int,
    power: NDArray[np.float32],
    parts: Contributions,
    bins: Bins,
) -> None:
    """Work out the expected power of each range bin, and what each cell contributes to it.

    Parameters
    ----------
    look : Look
        The ping in bins of range.
    seen : VisibleCells
        Cells in its cone, as `place_cells` left them.
    count : int
        How many there are.
    power : (slots * QUARTERS,) float32 array
        v of each quarter.
    parts : Contributions
        Set to what each cell contributes to each of its bins.
    bins : Bins
        `counted`, `expected` and `squares` are set.
    """
    has_bearings = _clear_bins(look, bins)
    counted, expected, squares = bins.counted, bins.expected, bins.squares
    for cell in range(count):
        start, first = seen.first_bin[cell], np.float32(seen.first_bin[cell])
        scale, at = seen.weight[cell] * seen.density[cell], seen.slot[cell] * QUARTERS
        # One by one: what is read again within the loop below could have been written there.
        v0, v1, v2, v3 = power[at], power[at + 1], power[at + 2], power[at + 3]
        if v0 + v1 + v2 + v3 == _ZERO:
            for column in range(CELL_BINS):
                parts.parts[cell, column] = _ZERO
            continue
        v0, v1, v2, v3 = scale * v0, scale * v1, scale * v2, scale * v3
        low, high = seen.low, seen.high
        low0, low1 = low[cell, 0] - first, low[cell, 1] - first
        low2, low3 = low[cell, 2] - first, low[cell, 3] - first
        high0, high1 = high[cell, 0] - first, high[cell, 1] - first
        high2, high3 = high[cell, 2] - first, high[cell, 3] - first
        kind0, kind1 = seen.heard[cell, 0], seen.heard[cell, 1]
        kind2, kind3 = seen.heard[cell, 2], seen.heard[cell, 3]
        for column in range(COLUMNS):
            b, edge = start + np.uint64(column), np.float32(column)
            part = v0 * counted[kind0, b] * overlap(edge, low0, high0)
            part += v1 * counted[kind1, b] * overlap(edge, low1, high1)
            part += v2 * counted[kind2, b] * overlap(edge, low2, high2)
            part += v3 * counted[kind3, b] * overlap(edge, low3, high3)
            parts.parts[cell, column] = part
            expected[b] += part
            squares[b] += part * part
        if has_bearings:
            _fit_bearings(look, seen, cell, parts, bins)


@inlined
def _clear_bins(look: Look, bins: Bins) -> bool:
    """Expect nothing but noise; returns whether the direction of any echo is known."""
    count, has_bearings = len(look.kind), False
    for b in range(count + CELL_BINS):
        bins.expected[b], bins.squares[b], bins.inverse[b] = look.noise, _ZERO, _ZERO
        bins.counted[ALL_BINS, b] = bins.counted[NOT_SILENT, b] = _ZERO
    for b in range(count):
        bins.counted[ALL_BINS, b] = _ONE
        bins.counted[NOT_SILENT, b] = _ONE if look.kind[b] != SILENCE else _ZERO
        has_bearings = has_bearings or look.bearing_weight[b] != _ZERO
    return has_bearings


@inlined
def _fit_bearings(
    look: Look, seen: VisibleCells, cell: int, parts: Contributions, bins: Bins
) -> None:
    """Count what a cell contributes by how well its direction fits each echo's.

    That is changed afterwards: with a branch in its loop, `expect` took four times as long.
    """
    for column in range(COLUMNS):
        b, part = seen.first_bin[cell] + np.uint64(column), parts.parts[cell, column]
        if part > _ZERO:
            fitting = part * np.float32(bearing_fit(look, b, seen.bearing[cell]))
            parts.parts[cell, column] = fitting
            bins.expected[b] += fitting - part
            bins.squares[b] += fitting * fitting - part * part
