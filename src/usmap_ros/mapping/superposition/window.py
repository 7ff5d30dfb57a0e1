"""The pings that are weighed again as the map changes, where compiled functions find them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import NamedTuple, get_type_hints, overload

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.superposition.ping_bins import GAIN_STEPS, NEVER, BinnedEchoes, Look
from usmap_ros.numerics.compiled import inlined

#: Fields of a look that are numbers of their own, and those that hold one for each range bin.
NUMBERS = tuple(name for name, kind in get_type_hints(Look).items() if kind is float)
BY_BIN = tuple(name for name in BinnedEchoes._fields if name != "next_echo")
#: Rows that a window begins with.
FIRST_ROWS = 64


class Looks(NamedTuple):
    """Several looks, one a row: to hand over one at a time would take longer than to use it.

    Parameters
    ----------
    numbers : (rows, NUMBERS) float64 array
        What is a number of its own.
    bins : (rows,) int64 array
        How many range bins each has; what its rows below hold after those is of no meaning.
    power_gain, kind, power, next_echo, limit, bearing, bearing_weight : (rows, …) arrays
        See `usmap_ros.mapping.superposition.ping_bins.Look`.
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

    def at(self, row: int) -> Look:
        """One of them."""
        return _look_in(self, row)


def look_in_row(looks: Looks, row: int) -> Look:
    """One of several looks."""
    numbers, bins = looks.numbers[row], looks.bins[row]
    return Look(
        x_m=numbers[0],
        y_m=numbers[1],
        axis_x=numbers[2],
        axis_y=numbers[3],
        axis_z=numbers[4],
        rise_m=numbers[5],
        heading_rad=numbers[6],
        half_angle_rad=numbers[7],
        cos_half_angle=numbers[8],
        least_range_m=numbers[9],
        greatest_range_m=numbers[10],
        absorption_per_m=numbers[11],
        range_std_m=numbers[12],
        bin_m=numbers[13],
        noise=numbers[14],
        power_gain=looks.power_gain[row],
        kind=looks.kind[row, :bins],
        power=looks.power[row, :bins],
        next_echo=looks.next_echo[row, : bins + 1],
        limit=looks.limit[row, :bins],
        bearing=looks.bearing[row, :bins],
        bearing_weight=looks.bearing_weight[row, :bins],
    )


#: The same for compiled functions.
look_in = inlined(look_in_row)


class Window(Sequence[Look]):
    """Looks in the order in which they came, of which the oldest goes first."""

    def __init__(self) -> None:
        #: All looks; of the window are those in the rows that `row` tells.
        self.looks = _looks(0, 0)
        # Who heard each.
        self.sources: deque[str] = deque()
        self._first = 0

    def __len__(self) -> int:
        return len(self.sources)

    @overload
    def __getitem__(self, index: int) -> Look: ...
    @overload
    def __getitem__(self, index: slice) -> list[Look]: ...
    def __getitem__(self, index: int | slice) -> Look | list[Look]:
        if isinstance(index, slice):
            return [self[each] for each in range(*index.indices(len(self)))]
        if not 0 <= index < len(self):
            raise IndexError(index)
        return look_in_row(self.looks, self.row(index))

    def row(self, index: int) -> int:
        """Where a look of the window is in `looks`; those after it follow, beginning anew."""
        return (self._first + index) % len(self.looks.bins)

    def append(self, look: Look, source: str) -> None:
        """Take up the newest look, which `source` heard."""
        rows, bins = self.looks.kind.shape
        if len(self) == rows or len(look.kind) > bins:
            self._make_room(max(FIRST_ROWS, 2 * rows), max(bins, len(look.kind)))
        self.sources.append(source)
        looks, row, bins = self.looks, self.row(len(self) - 1), len(look.kind)
        looks.numbers[row] = [getattr(look, name) for name in NUMBERS]
        looks.bins[row] = bins
        looks.next_echo[row, : bins + 1] = look.next_echo
        looks.power_gain[row] = look.power_gain
        for name in BY_BIN:
            getattr(looks, name)[row, :bins] = getattr(look, name)

    def pop_oldest(self) -> None:
        """Let the oldest look go."""
        self._first = self.row(1)
        self.sources.popleft()

    def pop_newest(self) -> None:
        """Let the newest look go."""
        self.sources.pop()

    def without(self, is_left_out: Callable[[str], bool]) -> Window:
        """The looks that others heard."""
        rest = Window()
        for look, source in zip(self, self.sources, strict=True):
            if not is_left_out(source):
                rest.append(look, source)
        return rest

    def _make_room(self, rows: int, bins: int) -> None:
        """Move all looks to where there are so many rows, and bins in each."""
        old, places = self.looks, [self.row(index) for index in range(len(self))]
        self.looks, self._first = _looks(rows, bins), 0
        for name in Looks._fields:
            kept: NDArray[np.float64] = getattr(old, name)[places]
            getattr(self.looks, name)[tuple(map(slice, kept.shape))] = kept


def _looks(rows: int, bins: int) -> Looks:
    power, limit, bearing, weight = (np.zeros((rows, bins), np.float32) for _ in range(4))
    return Looks(
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
