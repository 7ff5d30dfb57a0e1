"""The wave equation in the plane, by finite differences in time, and a transducer in it.

On nine points, which slow all directions down alike (Kowalczyk & van Walstijn, "Room acoustics
simulation using 3-D compact explicit FDTD schemes", IEEE Trans. Audio, Speech, Lang. Process. 19
(2011) 34-46, in two dimensions).  Everything stands upright, so that what has come a way L is
spread upwards by 1/sqrt(L) more.  The transducer is a line of points before another one, which
cancel backwards.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Cells = NDArray[np.float32]
#: Of the air, m/s; side of a cell, m; and a step of time, s, the longest that is stable.
SOUND_SPEED, CELL_M = 343.0, 0.004
COURANT = np.sqrt(0.75)
STEP_S = COURANT * CELL_M / SOUND_SPEED
#: Of the burst, Hz, and of the pass band to either side, over that.
CARRIER_HZ, BAND = 10e3, 0.45
#: From the front to the back line of the transducer, cells, and how long sound takes.
BEHIND = 2
BEHIND_S = BEHIND * CELL_M / SOUND_SPEED


class Air:
    """Air in cells of which some are rigid.

    Parameters
    ----------
    is_air : (rows, columns) bool array
        Which are not.
    corner_m : (2,) array
        x and y of the first one's middle.
    absorbed : float
        How much the cells before rigid ones lose in a step.
    sponge_m : float
        Width of what loses all sound at the sides, in the open.
    """

    def __init__(
        self, is_air: NDArray[np.bool_], corner_m: FloatArray, absorbed: float, sponge_m: float = 0
    ) -> None:
        self.corner_m = corner_m
        air = is_air.astype(np.float32)
        weights = np.zeros_like(air)
        for down in (-1, 0, 1):
            for right in (-1, 0, 1):
                if down or right:
                    share = 0.125 if down and right else 0.5
                    weights += share * np.roll(air, (down, right), (0, 1))
        loss = np.where((weights < 2.49) & is_air, np.float32(absorbed), np.float32(0.0))
        if sponge_m > 0.0:
            rows, columns = (np.arange(count) for count in air.shape)
            to_sides = (np.minimum(each, len(each) - 1 - each) for each in (rows, columns))
            nearest = np.minimum(*np.meshgrid(*to_sides, indexing="ij"))
            depth = np.clip(1.0 - nearest / int(sponge_m / CELL_M), 0.0, 1.0)
            loss = (0.06 * depth**2).astype(np.float32)
        self._around = (air / (1.0 + loss)).astype(np.float32)
        self._own = ((2.0 - weights) * self._around).astype(np.float32)
        self._before = (air * (1.0 - loss) / (1.0 + loss)).astype(np.float32)

    def heard(self, place_m: FloatArray, yaw_rad: float, it: SimpleNamespace) -> NDArray[Any]:
        """Complex baseband of a ping, one value a step, from the start of the burst on."""
        across_m, taper = line(it)
        ahead = np.array([np.cos(yaw_rad), np.sin(yaw_rad)])
        front = place_m + across_m[:, np.newaxis] * [-ahead[1], ahead[0]]
        at = (np.concatenate([front, front - BEHIND * CELL_M * ahead]) - self.corner_m) / CELL_M
        time_s = np.arange(int((it.long_s + 2.0 * BEHIND_S) / STEP_S) + 3) * STEP_S
        sent = np.stack([burst(it, time_s), -burst(it, time_s - BEHIND_S)]).astype(np.float32)
        longest_s = 2.04 * it.reach / SOUND_SPEED + it.long_s + 4.0 * BEHIND_S
        received = np.zeros((2, int(longest_s / STEP_S)))
        still = (np.zeros_like(self._own), np.zeros_like(self._own))
        weights = np.tile(taper / taper.sum(), 2)
        _ping(still, (self._own, self._around, self._before), at, weights, sent, received)
        return _baseband(received, it)


@njit(cache=True)
def _ping(
    state: tuple[Cells, Cells],
    coefficients: tuple[Cells, Cells, Cells],
    at: FloatArray,
    weights: FloatArray,
    sent: Cells,
    received: FloatArray,
) -> None:
    """Send what the front and the back line send, and receive what each does."""
    (now, then), steps = state, received.shape[1]
    column, row = int(at[:, 0].mean()), int(at[:, 1].mean())
    for step in range(steps):
        # Where sound can have come, and from where it comes back in time.
        reach = int(min(step, steps - step) * 0.9) + 30
        top, left = max(1, row - reach), max(1, column - reach)
        bottom, right = min(now.shape[0] - 1, row + reach), min(now.shape[1] - 1, column + reach)
        _advance(now, then, coefficients, (top, bottom), (left, right))
        for is_heard in (False, True):
            for point in range(len(at)):
                side, x, y = 2 * point // len(at), int(at[point, 0]), int(at[point, 1])
                for down, share_y in ((0, y + 1.0 - at[point, 1]), (1, at[point, 1] - y)):
                    for along, share_x in ((0, x + 1.0 - at[point, 0]), (1, at[point, 0] - x)):
                        share = weights[point] * share_y * share_x
                        if is_heard:
                            received[side, step] += share * then[y + down, x + along]
                        elif step < sent.shape[1]:
                            then[y + down, x + along] += share * sent[side, step]
        now, then = then, now


@njit(cache=True, fastmath=True, error_model="numpy")
def _advance(
    now: Cells,
    then: Cells,
    coefficients: tuple[Cells, Cells, Cells],
    rows: tuple[int, int],
    columns: tuple[int, int],
) -> None:
    """Put the next pressures of some cells into the place of the last ones."""
    (left, right), (own, around, before) = columns, coefficients
    half, eighth = np.float32(0.5), np.float32(0.125)
    for row in range(*rows):
        above, here, below = now[row - 1], now[row], now[row + 1]
        north, middle, south = above[left:right], here[left:right], below[left:right]
        before_it, behind_it = slice(left - 1, right - 1), slice(left + 1, right + 1)
        north_west, west, south_west = above[before_it], here[before_it], below[before_it]
        north_east, east, south_east = above[behind_it], here[behind_it], below[behind_it]
        of_own, of_around = own[row, left:right], around[row, left:right]
        of_before, pressure = before[row, left:right], then[row, left:right]
        for cell in range(right - left):
            beside = north[cell] + south[cell] + west[cell] + east[cell]
            aslant = north_west[cell] + north_east[cell] + south_west[cell] + south_east[cell]
            pressure[cell] = (
                of_own[cell] * middle[cell]
                + of_around[cell] * (half * beside + eighth * aslant)
                - of_before[cell] * pressure[cell]
            )


def burst(it: SimpleNamespace, time_s: FloatArray) -> FloatArray:
    """What is sent."""
    window = (time_s >= 0) & (time_s <= it.long_s)
    shape = np.sin(np.pi * time_s / it.long_s) ** 2 if it.shape == 2 else 1.0
    sent: FloatArray = window * shape * np.sin(2.0 * np.pi * CARRIER_HZ * time_s)
    return sent


def line(it: SimpleNamespace) -> tuple[FloatArray, FloatArray]:
    """Where points of a line are, m from its middle, and what each has of it."""
    across_m = np.arange(-(it.points - 1) / 2, (it.points + 1) / 2) * CELL_M
    taper = np.cos(0.5 * np.pi * across_m / (across_m[-1] + CELL_M))
    return across_m, taper if it.tapered else np.ones(it.points)


def gain(it: SimpleNamespace, off_rad: FloatArray) -> FloatArray:
    """Amplitude gain of the beam far away, one way."""
    across_m, taper = line(it)
    number = 2.0 * np.pi * CARRIER_HZ / SOUND_SPEED
    phases = np.exp(1j * number * across_m * np.sin(off_rad)[:, np.newaxis])
    behind = 1.0 - np.exp(-1j * number * BEHIND * CELL_M * (1.0 + np.cos(off_rad)))
    most = abs(1.0 - np.exp(-2j * number * BEHIND * CELL_M))
    found: FloatArray = np.abs((taper * phases).sum(axis=1)) / taper.sum() * np.abs(behind) / most
    return found


def _baseband(received: FloatArray, it: SimpleNamespace) -> NDArray[Any]:
    """What both lines receive, the back one later, around the carrier, and spread upwards."""
    steps = received.shape[1]
    count, time_s = 4 * steps, np.arange(steps) * STEP_S
    frequency_hz = np.fft.rfftfreq(count, STEP_S)
    later = np.exp(-2j * np.pi * frequency_hz * BEHIND_S)
    spectrum = np.zeros(count, complex)
    both = np.fft.rfft(received[0], count) - np.fft.rfft(received[1], count) * later
    spectrum[: len(both)] = 2.0 * both
    off = (np.fft.fftfreq(count, STEP_S) - CARRIER_HZ) / (BAND * CARRIER_HZ)
    passed = np.fft.ifft(spectrum * np.exp(-(off**6)))[:steps]
    way_m = SOUND_SPEED * (time_s - 0.5 * it.long_s - 2.0 * BEHIND_S)
    shifted = passed * np.exp(-2j * np.pi * CARRIER_HZ * time_s)
    return np.asarray(shifted / np.sqrt(np.maximum(way_m, 0.05)))
