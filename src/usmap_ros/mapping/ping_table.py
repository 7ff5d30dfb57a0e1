"""Several pings in bins of range, in one table that compiled functions take."""

from collections.abc import Sequence
from typing import Any, NamedTuple, get_type_hints

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.ping_bins import (
    DEAF_AMPLITUDE,
    ECHO,
    GAIN_STEPS,
    LEAST_NOISE,
    NEVER,
    NOISE_BELOW_LIMIT,
    SILENCE,
    UNJUDGED,
    PingBins,
    ping_numbers,
)
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.compiled import compiled, inlined
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import LIMIT_AMPLITUDES, EchoCone

#: Fields of a ping that are numbers of their own, and those that hold one for each range bin.
NUMBERS = tuple(name for name, kind in get_type_hints(PingBins).items() if kind is float)
BY_BIN = ("kind", "power", "limit", "bearing", "bearing_weight")
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


def ping_table_of(cones: Sequence[EchoCone], parameters: MappingParameters) -> PingTable:
    """Bring cones into the form that fusion keeps, a row each.

    Parameters
    ----------
    cones : sequence of EchoCone
        Valid ones.
    parameters : MappingParameters
        Cell size and the error of range that nobody states.
    """
    of_each = [ping_numbers(cone, parameters) for cone in cones]
    numbers = np.array([each.numbers for each in of_each]).reshape(-1, len(NUMBERS))
    width_m = numbers[:, GREATEST_RANGE] - numbers[:, LEAST_RANGE]
    bins = np.maximum(np.ceil(width_m / numbers[:, BIN_M] - 1e-9), 1.0).astype(np.int64)
    rows, most = len(cones), int(bins.max(initial=0))
    power, limit, bearing, weight = (np.zeros((rows, most), np.float32) for _ in range(4))
    table = PingTable(
        numbers=numbers,
        bins=bins,
        power_gain=np.array([each.power_gain for each in of_each]).reshape(-1, GAIN_STEPS + 1),
        kind=np.zeros((rows, most), np.uint8),
        power=power,
        next_echo=np.full((rows, most + 1), NEVER, np.int32),
        limit=limit,
        bearing=bearing,
        bearing_weight=weight,
    )
    if cones:
        _fill(table, cones, np.array([each.bearing_std_rad for each in of_each]))
    return table


def _fill(table: PingTable, cones: Sequence[EchoCone], bearing_stds_rad: FloatArray) -> None:
    """Set what is of each range bin, and the noise."""
    steps_m = np.array([cone.limit_step_m for cone in cones])
    codes = np.concatenate([cone.detection_limits for cone in cones]).astype(np.uint8)
    fill_limits(table, codes, _starts([cone.detection_limits for cone in cones]), steps_m)
    starts = _starts([cone.ranges_m for cone in cones])
    row = np.repeat(np.arange(len(cones)), np.diff(starts))
    least_m, bin_m = table.numbers[row][:, [LEAST_RANGE, BIN_M]].T
    place = (np.concatenate([cone.ranges_m for cone in cones]).astype(float) - least_m) / bin_m
    amplitudes = np.concatenate([cone.amplitudes for cone in cones]).astype(float)
    fill_echoes(table, place, amplitudes, starts)
    for number, cone in enumerate(cones):
        if cone.bearings_rad is not None and cone.bearing_stds_rad is not None:
            own, std_rad = slice(*starts[number : number + 2]), bearing_stds_rad[number]
            known = ~np.isnan(cone.bearings_rad) & (place[own] >= 0.0)
            known &= place[own] < table.bins[number]
            at = place[own][known].astype(np.intp)
            variance = cone.bearing_stds_rad[known] ** 2 + std_rad**2
            table.bearing[number, at] = cone.bearings_rad[known]
            table.bearing_weight[number, at] = 0.5 / variance


def _starts(arrays: Sequence[NDArray[Any]]) -> NDArray[np.int64]:
    """Where each of some arrays begins if one is put behind the other, and the end."""
    return np.cumsum([0, *map(len, arrays)])


@compiled
def fill_limits(
    table: PingTable, codes: NDArray[np.uint8], starts: NDArray[np.int64], steps_m: FloatArray
) -> None:
    """Set each range bin's limit, whether it was listened to, and the power of the noise.

    Parameters
    ----------
    table : PingTable
        `kind` and `limit` are set, and the noise among `numbers`.
    codes : (steps,) uint8 array
        `detection_limits` of all cones.
    starts : (rows + 1,) integer array
        First step of each, and the end.
    steps_m : (rows,) array
        Width of a step of each.
    """
    counts = np.empty(len(LIMIT_AMPLITUDES), np.int64)
    for row in range(len(table.bins)):
        own, bin_m, total = codes[starts[row] : starts[row + 1]], table.numbers[row, BIN_M], 0
        counts[:] = 0
        for b in range(table.bins[row]):
            code = own[min(int((b + 0.5) * bin_m / steps_m[row]), len(own) - 1)]
            limit = min(LIMIT_AMPLITUDES[code], DEAF_AMPLITUDE)
            table.kind[row, b], table.limit[row, b] = UNJUDGED, limit * limit
            if limit < DEAF_AMPLITUDE:
                table.kind[row, b] = SILENCE
                counts[code] += 1
                total += 1
        median = _median_amplitude(counts, total)
        noise = max(NOISE_BELOW_LIMIT * median * median, LEAST_NOISE)
        table.numbers[row, NOISE] = noise if total else 1.0


@inlined
def _median_amplitude(counts: NDArray[np.int64], total: int) -> float:
    """Median of what some codes stand for: of an even number, between the two in the middle."""
    below, median = 0, 0.0
    for code in range(len(counts)):
        for middle in ((total - 1) // 2, total // 2):
            if below <= middle < below + counts[code]:
                median += 0.5 * LIMIT_AMPLITUDES[code]
        below += counts[code]
    return median


@compiled
def fill_echoes(
    table: PingTable, place: FloatArray, amplitudes: FloatArray, starts: NDArray[np.int64]
) -> None:
    """Put echoes into range bins.

    Parameters
    ----------
    table : PingTable
        `kind`, `power` and `next_echo` are set.
    place : (echoes,) array
        Ranges of all cones' echoes, counted in bins.
    amplitudes : (echoes,) array
        Amplitude of each echo, 1 for an ideal point target at 1 m.
    starts : (rows + 1,) integer array
        First echo of each cone, and the end.
    """
    for row in range(len(table.bins)):
        bins, kind = table.bins[row], table.kind[row]
        for echo in range(starts[row], starts[row + 1]):
            # An echo a hair's breadth away may have fallen into its neighbour.
            for beside in (int(place[echo]) - 1, int(place[echo]) + 1):
                if 0.0 <= place[echo] < bins and 0 <= beside < bins:
                    kind[beside] = UNJUDGED
        for echo in range(starts[row], starts[row + 1]):
            if 0.0 <= place[echo] < bins:
                kind[int(place[echo])] = ECHO
                table.power[row, int(place[echo])] += amplitudes[echo] * amplitudes[echo]
        following = NEVER
        for b in range(bins, -1, -1):
            if b < bins and kind[b] == ECHO:
                following = b
            table.next_echo[row, b] = following
