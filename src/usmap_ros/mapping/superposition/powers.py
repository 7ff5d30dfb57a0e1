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

from usmap_ros.compiled import compiled, compiled_within, inlined
from usmap_ros.mapping.superposition.cells import QUARTERS
from usmap_ros.mapping.superposition.look import SILENCE, Look
from usmap_ros.mapping.superposition.seen import Seen

#: Range bins that a cell can reach into, and a block of nine cells.
CELL_BINS, BLOCK_BINS = 16, 48
#: Columns of `Bins.gradient`.
GRADIENTS = 4


class Bins(NamedTuple):
    """Numbers for each range bin of a look; arrays of shape (bins,), and may be longer.

    Parameters
    ----------
    expected : float64 array
        λ.
    squares : float64 array
        Sum of the squared contributions to λ.
    log_likelihood : float64 array
        Of what was heard.
    gradient : (bins, GRADIENTS) float64 array
        Sums over the bins before each, and in the last row over all, of the two parts of the
        gradient of the log-likelihood with respect to λ: what raises the powers that
        contribute, and what lowers them; then the same of bins that are not silent.
    """

    expected: NDArray[np.float64]
    squares: NDArray[np.float64]
    log_likelihood: NDArray[np.float64]
    gradient: NDArray[np.float64]


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


@compiled
def expect(
    look: Look,
    seen: Seen,
    count: int,
    power: NDArray[np.float32],
    parts: Contributions,
    bins: Bins,
) -> None:
    """Work out the expected power of each range bin, and what each cell contributes to it.

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
    bins : Bins
        `expected` and `squares` are set.
    """
    expected, squares, row = bins.expected, bins.squares, np.empty(CELL_BINS, np.float32)
    for b in range(len(look.kind)):
        expected[b], squares[b] = look.noise, 0.0
    for cell in range(count):
        low, columns = seen.low, 0
        start = math.floor(min(low[cell, 0], low[cell, 1], low[cell, 2], low[cell, 3]))
        for column in range(CELL_BINS):
            row[column] = 0.0
        for quarter in range(QUARTERS):
            returned = seen.weight[cell] * power[seen.slot[cell] * QUARTERS + quarter]
            if returned > 0.0:
                last = _spread(look, seen, cell, quarter, returned * seen.density[cell], start, row)
                columns = max(columns, last - start)
        parts.first_bin[cell], parts.columns[cell] = start, columns
        for column in range(CELL_BINS):
            parts.parts[cell, column] = row[column]
        for column in range(max(0, -start), columns):
            expected[start + column] += row[column]
            squares[start + column] += row[column] * row[column]


@compiled_within
def _spread(
    look: Look,
    seen: Seen,
    cell: int,
    quarter: int,
    density: float,
    start: int,
    row: NDArray[np.float32],
) -> int:
    """Add a quarter's power to the range bins from `start` on; returns the one after its last."""
    heard, bearing = seen.heard[cell, quarter], seen.bearing[cell]
    low, high = seen.low[cell, quarter], seen.high[cell, quarter]
    last: int = min(math.floor(high) + 1, len(look.kind), start + CELL_BINS)
    for b in range(max(math.floor(low), 0), last):
        if not (heard and look.kind[b] == SILENCE):
            row[b - start] += density * bearing_fit(look, b, bearing) * overlap(b, low, high)
    return last
