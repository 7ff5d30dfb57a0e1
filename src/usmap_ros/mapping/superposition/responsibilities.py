"""Responsibilities: how much of the echoes that may be a cell's it explains, and who heard them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.superposition.forward_model import Bins, Contributions
from usmap_ros.mapping.superposition.ping_bins import ECHO, Look
from usmap_ros.mapping.superposition.visible_cells import VisibleCells
from usmap_ros.numerics.compiled import compiled_within


class Responsibilities(NamedTuple):
    """Sums over the looks in which an echo may have come from a cell; (slots,) float32 arrays.

    Parameters
    ----------
    explained : float32 array
        Share of the echo's expected power that comes from the cell.
    heard : float32 array
        Number of the looks.
    axis_cos, axis_sin : float32 arrays
        Cosine and sine of twice the direction of the looks: a ring of candidates looks the same
        to a look from the opposite side.
    heard_x, heard_y : float32 arrays
        Unit vectors from the cell to those who heard it, by the share that it had.
    """

    explained: NDArray[np.float32]
    heard: NDArray[np.float32]
    axis_cos: NDArray[np.float32]
    axis_sin: NDArray[np.float32]
    heard_x: NDArray[np.float32]
    heard_y: NDArray[np.float32]


@compiled_within
def add_responsibilities(
    look: Look,
    seen: VisibleCells,
    count: int,
    bins: Bins,
    parts: Contributions,
    responsibilities: Responsibilities,
) -> None:
    """Add what a look tells of its cells' shares in its echoes.

    Of several echoes that may have come from a cell, the one counts that it explains best.

    Parameters
    ----------
    look, seen, count, bins, parts
        As in `usmap_ros.mapping.superposition.inverse_sensor_model.add_evidence`.
    responsibilities : Responsibilities
        Sums over pings, to which this one's are added.
    """
    expected, kind = bins.expected, look.kind
    for cell in range(count):
        start, best = seen.first_bin[cell], -1.0
        for column in range(seen.reach[cell]):
            b, part = start + np.uint64(column), parts.parts[cell, column]
            if part > 0.0 and kind[b] == ECHO:
                best = max(best, part / expected[b])
        if best >= 0.0:
            slot = seen.slot[cell]
            x, y = seen.x_m[cell], seen.y_m[cell]
            responsibilities.explained[slot] += best
            responsibilities.heard[slot] += 1.0
            distance = max(math.sqrt(x * x + y * y), 1e-9)
            cosine, sine = x / distance, y / distance
            responsibilities.axis_cos[slot] += cosine * cosine - sine * sine
            responsibilities.axis_sin[slot] += 2.0 * cosine * sine
            responsibilities.heard_x[slot] -= best * cosine
            responsibilities.heard_y[slot] -= best * sine
