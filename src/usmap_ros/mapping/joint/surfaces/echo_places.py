"""Where echoes are, and which of them are of mirrors and columns that are known."""

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.surfaces.mirrors import MirrorWall
from usmap_ros.mapping.joint.surfaces.round_column import RoundColumn
from usmap_ros.mapping.joint.visibility.echoes import Echoes
from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.mapping.joint.visibility.open_ways import trace_open
from usmap_ros.mapping.ping_table import (
    BIN_M,
    HALF_ANGLE,
    HEADING,
    LEAST_RANGE,
    RANGE_STD,
    PingTable,
    X,
    Y,
)
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.geometry import wrapped

#: An echo is that of a smooth thing that is known if it is so near to where it should be, beyond
#: what its range is uncertain by, m.
RECOGNISED_M = 0.03
#: Range bins around a smooth thing's echo that say nothing of cells.
AROUND_BINS = 2
#: Pings that one counts for as a proof that its way is open: its loudness is that of the thing.
PROOFS = 2.0
#: The way to a smooth thing is proven to be open up to so many cells before it.
PROVEN_CELLS = 1.5
#: How far beside the way nothing stands, either, that would let no sound through, m: the first
#: Fresnel zone of an echo of 40 kHz is so wide from 0.25 m on.
BESIDE_M = (-0.04, 0.0, 0.04)


class EchoPlaces:
    """Which ping each echo is of, and where in it.

    Parameters
    ----------
    table : PingTable
        Pings.
    pings : (pings,) integer array
        Rows of those that count.
    echoes : Echoes
        Theirs.

    Attributes
    ----------
    ping, bin : (echoes,) integer arrays
        Ping and range bin of each echo.
    inside : (echoes,) bool array
        Whether it is within its ping's bins.
    numbers : (echoes, columns) array
        Of each echo's ping, as in a `PingTable`.
    """

    def __init__(self, table: PingTable, pings: NDArray[np.int64], echoes: Echoes) -> None:
        self.ping = np.repeat(np.arange(len(pings)), np.diff(echoes.start))
        self.numbers, self._range_m = table.numbers[pings[self.ping]], echoes.range_m
        place = np.floor((echoes.range_m - self.numbers[:, LEAST_RANGE]) / self.numbers[:, BIN_M])
        self.inside: BoolArray = (place >= 0) & (place < table.bins[pings[self.ping]])
        self.bin = np.where(self.inside, place, 0).astype(np.int64)

    def around(self, echoes: list[NDArray[np.int64]]) -> Iterator[tuple[int, slice, int]]:
        """Ping, range bins around, and the middle one, of some echoes."""
        for echo in np.concatenate(echoes).tolist():
            if self.inside[echo]:
                middle = int(self.bin[echo])
                around = slice(max(0, middle - AROUND_BINS), middle + AROUND_BINS + 1)
                yield int(self.ping[echo]), around, middle

    def trace_open(
        self,
        things: Iterable[MirrorWall | RoundColumn],
        field: Field,
        proven: NDArray[np.float32],
        weights: NDArray[np.float32],
    ) -> None:
        """Count pings whose sound came back through each cell from smooth things.

        Parameters
        ----------
        things : iterable of MirrorWall and RoundColumn
            With their echoes.
        field : Field
            The cells.
        proven : (rows, columns) float32 array
            Added to.
        weights : (pings,) float32 array
            How much each ping counts.
        """
        last = np.full(field.shape, -1, np.int32)
        for thing in things:
            for ping, echo in zip(thing.pings.tolist(), thing.echoes.tolist(), strict=True):
                x_m, y_m = self.numbers[echo, [X, Y]]
                way_m = self._range_m[echo] - PROVEN_CELLS * field.resolution_m
                bearing_rad = thing.bearing_from(x_m, y_m)
                for beside_m in BESIDE_M:
                    left_m = -beside_m * np.sin(bearing_rad), beside_m * np.cos(bearing_rad)
                    trace_open(
                        x_m + left_m[0], y_m + left_m[1], bearing_rad, way_m, field, ping,
                        last, proven, PROOFS * weights[ping],
                    )  # fmt: skip

    def are_of_mirror(self, wall: MirrorWall) -> BoolArray:
        """Whether each echo is where a mirror's would be, as far as that goes."""
        x_m, y_m = self.numbers[:, X], self.numbers[:, Y]
        cosine, sine = np.cos(wall.normal_rad), np.sin(wall.normal_rad)
        along_m = cosine * y_m - sine * x_m
        is_along = (along_m >= wall.begin_m) & (along_m <= wall.end_m)
        expected_m = wall.distance_m - cosine * x_m - sine * y_m
        bearing_rad = np.full(len(expected_m), wall.normal_rad)
        return np.asarray(is_along & self._are_from(expected_m, bearing_rad), bool)

    def are_of_column(self, column: RoundColumn) -> BoolArray:
        """Whether each echo is where a column's would be."""
        x_m, y_m = self.numbers[:, X], self.numbers[:, Y]
        right_m, up_m = column.x_m - x_m, column.y_m - y_m
        expected_m = np.hypot(right_m, up_m) - column.radius_m
        is_at = self._are_from(expected_m, np.arctan2(up_m, right_m))
        return np.asarray(is_at & (expected_m > 0.0), bool)

    def _are_from(self, expected_m: FloatArray, bearing_rad: FloatArray) -> BoolArray:
        """Whether each echo is at a range, of what lies in a direction within the beam."""
        off_rad = wrapped(bearing_rad - self.numbers[:, HEADING])
        is_ahead = np.abs(off_rad) < self.numbers[:, HALF_ANGLE]
        near_m = RECOGNISED_M + self.numbers[:, RANGE_STD]
        there: BoolArray = is_ahead & (np.abs(self._range_m - expected_m) < near_m)
        return there
