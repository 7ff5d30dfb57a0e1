"""A first guess of the floor, from pairs of echoes of one ping.

An object's echo over the floor trails its direct one.  With r the direct leg and u that over the
floor, u² − r² = (2 h)²: every pair of echoes votes for a height, and true pairs agree whatever
the object's range.  The corner between the floor and an upright object is √(r² + h²) away, where
u² − r² = h².
"""

from __future__ import annotations

import numpy as np

from usmap_ros.acoustics.propagation import FloorModel
from usmap_ros.calibration.echo_table import EchoTable
from usmap_ros.numerics.arrays import BoolArray, FloatArray

#: Heights (m) that votes may be for, and half the width of the window in which they agree.
_HEIGHTS_M = (0.05, 3.0)
_VOTE_HALF_WIDTH_M = 0.008
#: Votes that make a floor, per ping with echoes, and how far they rise above those of chance.
_LEAST_VOTES = 0.25
_LEAST_CONTRAST = 2.5
#: How far an echo may be from where another's path over the floor is expected.
_GATE_M = 0.012


def guess_floor_m(table: EchoTable, floor_model: FloorModel) -> float | None:
    """Height of the transducers above the floor; None where no floor is heard.

    Parameters
    ----------
    table : EchoTable
        All echoes of the recording, with poses and pings.
    floor_model : FloorModel
        How it would return sound.
    """
    heights_m = np.concatenate([np.zeros(0), *_votes(table, floor_model)])
    heights_m = np.sort(heights_m[(heights_m > _HEIGHTS_M[0]) & (heights_m < _HEIGHTS_M[1])])
    if len(heights_m) == 0:
        return None
    width_m = 2.0 * _VOTE_HALF_WIDTH_M
    count = np.searchsorted(heights_m, heights_m + width_m, side="right")
    count -= np.arange(len(heights_m))
    first = int(np.argmax(count))
    most = int(count[first])
    # What chance would bring together there: the mean over a window ten times as wide.
    wide = np.abs(heights_m - heights_m[first] - _VOTE_HALF_WIDTH_M) <= 10.0 * _VOTE_HALF_WIDTH_M
    by_chance = (np.count_nonzero(wide) - most) / 9.0
    pings_with_echoes = np.count_nonzero(np.diff(table.first_echo))
    if most < max(_LEAST_VOTES * pings_with_echoes, _LEAST_CONTRAST * by_chance, 4.0):
        return None
    return float(np.median(heights_m[first : first + most]))


def _votes(table: EchoTable, floor_model: FloorModel) -> list[FloatArray]:
    """Heights that the pairs of echoes of each ping would mean."""
    votes = []
    for ping in range(table.ping_count):
        echoes = table.echoes_of(ping)
        range_m = table.ranges_m[echoes]
        amplitude = table.amplitudes[echoes]
        direct, later = np.triu_indices(len(range_m), 1)
        leg_m = np.maximum(range_m[direct], 0.0)
        # One way over the floor an echo is (r + u) / 2 away, both ways u; the floor adds two of
        # the former to each object, and neither is louder than the object by itself.
        quieter = amplitude[later] < 2.0 * amplitude[direct]
        if floor_model is FloorModel.CORNER:
            squared = np.maximum(range_m[later] ** 2 - leg_m**2, 0.0)
            votes.append(np.sqrt(squared[quieter]))
            continue
        for over_m in (2.0 * range_m[later] - leg_m, range_m[later]):
            squared = np.maximum(over_m**2 - leg_m**2, 0.0)
            votes.append(0.5 * np.sqrt(squared[quieter]))
    return votes


def direct_echoes(table: EchoTable, floor_m: float | None, floor_model: FloorModel) -> BoolArray:
    """Which echoes no earlier one of the same ping explains by way of the floor, (echoes,)."""
    direct = np.ones(len(table.ranges_m), dtype=bool)
    if floor_m is None:
        return direct
    for ping in range(table.ping_count):
        echoes = table.echoes_of(ping)
        explained = np.zeros(0)
        for index, range_m in enumerate(table.ranges_m[echoes], echoes.start):
            if len(explained) and np.abs(explained - range_m).min() < _GATE_M:
                direct[index] = False
                continue
            if floor_model is FloorModel.CORNER:
                explained = np.append(explained, np.hypot(range_m, floor_m))
                continue
            over_m = np.hypot(range_m, 2.0 * floor_m)
            explained = np.append(explained, [0.5 * (range_m + over_m), over_m])
    return direct
