"""Fewer pings in the place of many that look at the same cells, which thin out what may scatter."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: What scatters at all is found by pings that look at most cells so often; and the share of them
#: that is worth it, because all of them have to be looked at in the end.
ENOUGH_LOOKS, MOST_SHARE = 15.0, 0.5
#: Share of the cells that may be looked at less.
RARELY_SEEN = 0.25
#: Its multiples lie evenly between whole numbers, and those of every second or third of them, too:
#: robots take turns.
GOLDEN_RATIO = 0.5 * (5.0**0.5 - 1.0)


def fewer_pings(
    weights: NDArray[np.float32], looks: NDArray[np.float32]
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Pings that stand for all, evenly from all of their time, and what each of them counts.

    Parameters
    ----------
    weights : (pings,) float32 array
        How much each counts.
    looks : (cells,) float32 array
        How often all of them looked at each cell that may scatter.

    Returns
    -------
    some : (fewer,) integer array
        Which; all, if cells are not looked at often enough.
    weights : (fewer,) float32 array
        How much each counts in the place of others: those that count for little are left out
        more often.
    """
    usual = float(np.quantile(looks, RARELY_SEEN)) if len(looks) else 0.0
    if usual * MOST_SHARE < ENOUGH_LOOKS:
        return np.arange(len(weights)), weights
    chances = np.minimum(weights * (ENOUGH_LOOKS / usual), 1.0)
    some = np.flatnonzero(np.arange(len(weights)) * GOLDEN_RATIO % 1.0 < chances)
    return some, (weights[some] / chances[some]).astype(np.float32)
