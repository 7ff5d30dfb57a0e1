"""Several pings in bins of range, stacked so that compiled functions find them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, get_type_hints

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.ping_bins import GAIN_STEPS, NEVER, BinnedEchoes, Look

#: Fields of a look that are numbers of their own, and those that hold one for each range bin.
NUMBERS = tuple(name for name, kind in get_type_hints(Look).items() if kind is float)
BY_BIN = tuple(name for name in BinnedEchoes._fields if name != "next_echo")


class Looks(NamedTuple):
    """Several looks, one a row: to hand over one at a time would take longer than to use it.

    Parameters
    ----------
    numbers : (rows, NUMBERS) float64 array
        What is a number of its own.
    bins : (rows,) int64 array
        How many range bins each has; what its rows below hold after those is of no meaning.
    power_gain, kind, power, next_echo, limit, bearing, bearing_weight : (rows, …) arrays
        See `usmap_ros.mapping.ping_bins.Look`.
    """

    numbers: NDArray[np.float64]
    bins: NDArray[np.int64]
    power_gain: NDArray[np.float32]
    kind: NDArray[np.uint8]
    power: NDArray[np.float32]
    next_echo: NDArray[np.int32]
    limit: NDArray[np.float32]
    bearing: NDArray[np.float32]
    bearing_weight: NDArray[np.float32]


def look_in_row(looks: Looks, row: int) -> Look:
    """One of several looks."""
    bins = looks.bins[row]
    by_bin = {name: getattr(looks, name)[row, :bins] for name in BY_BIN}
    return Look(
        **dict(zip(NUMBERS, looks.numbers[row].tolist(), strict=True)),
        **by_bin,
        power_gain=looks.power_gain[row],
        next_echo=looks.next_echo[row, : bins + 1],
    )


def stacked(looks: Sequence[Look]) -> Looks:
    """Several looks in one, a row each."""
    rows, bins = len(looks), max((len(look.kind) for look in looks), default=0)
    power, limit, bearing, weight = (np.zeros((rows, bins), np.float32) for _ in range(4))
    several = Looks(
        numbers=np.zeros((rows, len(NUMBERS))),
        bins=np.zeros(rows, np.int64),
        power_gain=np.zeros((rows, GAIN_STEPS + 1), np.float32),
        kind=np.zeros((rows, bins), np.uint8),
        power=power,
        next_echo=np.full((rows, bins + 1), NEVER, np.int32),
        limit=limit,
        bearing=bearing,
        bearing_weight=weight,
    )
    for row, look in enumerate(looks):
        own = len(look.kind)
        several.numbers[row] = [getattr(look, name) for name in NUMBERS]
        several.bins[row] = own
        several.next_echo[row, : own + 1] = look.next_echo
        several.power_gain[row] = look.power_gain
        for name in BY_BIN:
            getattr(several, name)[row, :own] = getattr(look, name)
    return several
