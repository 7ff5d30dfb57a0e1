"""Several pings in bins of range, stacked so that compiled functions find them."""

from collections.abc import Sequence
from typing import NamedTuple, get_type_hints

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.ping_bins import GAIN_STEPS, NEVER, BinnedEchoes, PingBins

#: Fields of a ping that are numbers of their own, and those that hold one for each range bin.
NUMBERS = tuple(name for name, kind in get_type_hints(PingBins).items() if kind is float)
BY_BIN = tuple(name for name in BinnedEchoes._fields if name != "next_echo")
#: Columns of `PingTable.numbers`.
X = NUMBERS.index("x_m")
Y = NUMBERS.index("y_m")
AXIS_X = NUMBERS.index("axis_x")
AXIS_Y = NUMBERS.index("axis_y")
AXIS_Z = NUMBERS.index("axis_z")
RISE = NUMBERS.index("rise_m")
HEADING = NUMBERS.index("heading_rad")
HALF_ANGLE = NUMBERS.index("half_angle_rad")
COS_HALF_ANGLE = NUMBERS.index("cos_half_angle")
LEAST_RANGE = NUMBERS.index("least_range_m")
GREATEST_RANGE = NUMBERS.index("greatest_range_m")
ABSORPTION = NUMBERS.index("absorption_per_m")
RANGE_STD = NUMBERS.index("range_std_m")
BIN_M = NUMBERS.index("bin_m")
NOISE = NUMBERS.index("noise")


class PingTable(NamedTuple):
    """Several pings, one a row: to hand over one at a time would take longer than to use it."""

    #: (rows, NUMBERS) float64 array: what is a number of its own.
    numbers: NDArray[np.float64]
    #: (rows,) int64 array: how many range bins each has; what its rows below hold after those is of
    #: no meaning.
    bins: NDArray[np.int64]
    #: (rows, …) arrays: see `usmap_ros.mapping.ping_bins.PingBins`.
    power_gain: NDArray[np.float32]
    kind: NDArray[np.uint8]
    power: NDArray[np.float32]
    next_echo: NDArray[np.int32]
    limit: NDArray[np.float32]
    bearing: NDArray[np.float32]
    bearing_weight: NDArray[np.float32]


def ping_in_row(pings: PingTable, row: int) -> PingBins:
    """One of several pings."""
    bins = pings.bins[row]
    by_bin = {name: getattr(pings, name)[row, :bins] for name in BY_BIN}
    return PingBins(
        **dict(zip(NUMBERS, pings.numbers[row].tolist(), strict=True)),
        **by_bin,
        power_gain=pings.power_gain[row],
        next_echo=pings.next_echo[row, : bins + 1],
    )


def stacked(pings: Sequence[PingBins]) -> PingTable:
    """Several pings in one table, a row each."""
    rows, bins = len(pings), max((len(ping.kind) for ping in pings), default=0)
    power, limit, bearing, weight = (np.zeros((rows, bins), np.float32) for _ in range(4))
    several = PingTable(
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
    for row, ping in enumerate(pings):
        own = len(ping.kind)
        several.numbers[row] = [getattr(ping, name) for name in NUMBERS]
        several.bins[row] = own
        several.next_echo[row, : own + 1] = ping.next_echo
        several.power_gain[row] = ping.power_gain
        for name in BY_BIN:
            getattr(several, name)[row, :own] = getattr(ping, name)
    return several
