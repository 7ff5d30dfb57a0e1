"""Echoes as loud as those of mirrors: whatever they are of lets hardly any sound through.

Who strikes a wall squarely from a single place hears it at one range, from which it may be anywhere
in the beam: no wall is found, and nothing stands where its sides are.  Where little is heard, and a
wall is found, it is known as far as somebody struck it, and goes on beside that: sound that went
past its known end in the same beam met more of it.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.surfaces.echo_places import EchoPlaces
from usmap_ros.mapping.joint.surfaces.mirrors import MirrorWall, turns_to, usual_direction_of
from usmap_ros.mapping.joint.surfaces.parts import PartOfPlace, any_holds
from usmap_ros.mapping.joint.visibility.beams import LOOKING_SHARE, amplitude_gains
from usmap_ros.mapping.joint.visibility.echoes import Echoes, mirror_levels
from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.mapping.ping_table import (
    ABSORPTION,
    GREATEST_RANGE,
    HALF_ANGLE,
    HEADING,
    PingTable,
    X,
    Y,
)
from usmap_ros.numerics.arrays import BoolArray, FloatArray

#: An echo as loud as this, as a share of what the place's mirrors return on the beam's axis, is of
#: a mirror that is struck squarely within the beam, or of something as near as it is large.
MIRROR_SHARE = 0.5
#: The same of what they return where the one that faces as most do would be struck squarely, and
#: least gain of the beam there.
USUAL_SHARE, LEAST_GAIN = 0.35, 0.1
#: Echoes a ping below which walls are heard so seldom that some are not found: 0.5 to 1.6 in eleven
#: rooms of strangers of which space outside was called free, 1.7 and more where hardly any was.
FEW_ECHOES = 1.65
#: Share of pings' nearest loud echoes that are of something that was found, from which on single
#: ones of the others may be of anything; and how many in line are a wall: so near to it, m, and to
#: each other.
MOST_FOUND, A_WALL, IN_LINE_M, TOGETHER_M = 0.87, 3, 0.06, 2.0
#: A mirror is so wide to either side of where it was struck, m; steps in which cells behind it are
#: looked for, cells.
HALF_WIDTH_M, STEP_CELLS = 2.0, 0.8


class LoudEchoes:
    """Echoes as loud as those of a place's mirrors.

    Parameters
    ----------
    mirrors : sequence of MirrorWall
        Some of the place; at least one.
    mirrored : list of PartOfPlace
        Parts that they are in, if not in all of it: rough walls of others are as loud.
    table : PingTable
        Pings.
    pings : (pings,) integer array
        Their rows.
    echoes : Echoes
        Theirs.
    places : EchoPlaces
        Where these are.

    Attributes
    ----------
    are_loud : (echoes,) bool array
        Whether each echo is one.
    """

    def __init__(
        self,
        mirrors: Sequence[MirrorWall],
        mirrored: list[PartOfPlace],
        table: PingTable,
        pings: NDArray[np.int64],
        echoes: Echoes,
        places: EchoPlaces,
    ) -> None:
        self._places, self._range_m, self._count = places, echoes.range_m, len(pings)
        hits = np.array([len(wall.echoes) for wall in mirrors], float)
        usual = float(np.exp(np.average([wall.log_mirror for wall in mirrors], weights=hits)))
        numbers = places.numbers
        self._turn_rad = turns_to(usual_direction_of(mirrors), numbers[:, HEADING])
        off_rad = np.abs(self._turn_rad)
        gain = amplitude_gains(table, pings[places.ping], off_rad)
        self._looks = (off_rad < LOOKING_SHARE * numbers[:, HALF_ANGLE]) & (gain > LEAST_GAIN)
        level = mirror_levels(echoes, numbers[:, ABSORPTION])
        least = np.where(self._looks, USUAL_SHARE * gain, MIRROR_SHARE)
        self.are_loud: BoolArray = level > usual * least
        if mirrored:
            self.are_loud &= any_holds(mirrored, numbers[:, [X, Y]])

    def ended_m(self, known: BoolArray) -> FloatArray:
        """How far the sound of each ping can have gone.

        Parameters
        ----------
        known : (echoes,) bool array
            Which are of things that are known to end, so that sound goes on beside them.

        Returns
        -------
        ended_m : (pings,) array
            Range of its nearest loud echo; infinite where there is none.
        """
        ended_m = np.full(self._count, np.inf)
        ends = self.are_loud & ~known
        np.minimum.at(ended_m, self._places.ping[ends], self._range_m[ends])
        return ended_m

    def behind(self, explained: BoolArray, field: Field) -> BoolArray:
        """Cells behind walls that face as most do, and that pings struck, but nobody found.

        Parameters
        ----------
        explained : (echoes,) bool array
            Which are of something that was found.
        field : Field
            The cells.
        """
        numbers, ping = self._places.numbers, self._places.ping
        loud = np.flatnonzero(self.are_loud)
        # Echoes of a ping come by range.
        nearest = loud[np.unique(ping[loud], return_index=True)[1]]
        struck = nearest[~explained[nearest] & self._looks[nearest]]
        bearing_rad = numbers[struck, HEADING] + self._turn_rad[struck]
        if explained[nearest].sum() >= MOST_FOUND * len(nearest):
            several = self._in_line(struck, bearing_rad) >= A_WALL
            struck, bearing_rad = struck[several], bearing_rad[several]
        step_m, behind = STEP_CELLS * field.resolution_m, np.zeros(field.shape, bool)
        beside_m = np.arange(-HALF_WIDTH_M, HALF_WIDTH_M, step_m)
        for echo, bearing in zip(struck.tolist(), bearing_rad.tolist(), strict=True):
            x_m, y_m, reach_m = numbers[echo, [X, Y, GREATEST_RANGE]]
            away_m = np.arange(self._range_m[echo] - step_m, reach_m, step_m)[:, np.newaxis]
            cosine, sine = np.cos(bearing), np.sin(bearing)
            behind |= field.cells_at(
                (x_m + away_m * cosine - beside_m * sine).ravel(),
                (y_m + away_m * sine + beside_m * cosine).ravel(),
            )
        return behind

    def _in_line(self, struck: NDArray[np.int64], bearing_rad: FloatArray) -> NDArray[np.int64]:
        """With how many others, and itself, each echo is of one wall that faces so, (echoes,)."""
        cosine, sine = np.cos(bearing_rad), np.sin(bearing_rad)
        x_m, y_m = self._places.numbers[struck][:, [X, Y]].T
        distance_m = x_m * cosine + y_m * sine + self._range_m[struck]
        along_m = y_m * cosine - x_m * sine
        alike = np.cos(bearing_rad[:, np.newaxis] - bearing_rad) > 0.0
        alike &= np.abs(distance_m[:, np.newaxis] - distance_m) < IN_LINE_M
        alike &= np.abs(along_m[:, np.newaxis] - along_m) < TOGETHER_M
        return np.asarray(alike.sum(axis=1), np.int64)
