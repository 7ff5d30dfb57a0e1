"""Echoes of many pings as arrays, those that tell most of each."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.range_cones import is_deaf_behind

#: Of a ping those echoes count that come first, and the loudest ones: what follows in the tail of
#: a wall says the same again.
_FIRST, _LOUDEST = 2, 2
#: A bearing that is not known, rad.
_ANY_BEARING = 1e6
#: By how much a perpendicular may miss the beam of a sensor that reports the first thing in it,
#: rad: such a sensor hears surfaces from any side, and of them what is at the beam's edge.
_ASLANT_RAD = 1.0


class TrackEchoes(NamedTuple):
    """Echoes of all pings, one behind the other."""

    #: (n,) int array: whose they are.
    ping: NDArray[np.int64]
    #: (n,) array: how far their objects are.
    range_m: FloatArray
    #: (n,) array: of the beam.
    half_angle_rad: FloatArray
    #: (n,) arrays: off the beam axis, where it is known.
    bearing_rad: FloatArray
    bearing_std_rad: FloatArray
    #: (n,) array: how much each counts.
    weight: FloatArray
    #: (n,) array: by how much the perpendicular to a wall may miss the beam.
    aslant_rad: FloatArray

    @property
    def are_first_only(self) -> bool:
        """Whether most are of sensors that report the first thing only."""
        return bool(np.median(self.aslant_rad) > 0.0)


def tabulate(cones: Sequence[EchoCone], weights: FloatArray) -> TrackEchoes:
    """Echoes of cones.

    Parameters
    ----------
    cones : sequence of EchoCone
        Pings.
    weights : (n,) array
        How much each ping counts.
    """
    columns: list[FloatArray] = [np.zeros((0, 7))]
    for ping, cone in enumerate(cones):
        kept = _telling(cone)
        rows = np.zeros((len(kept), 7))
        rows[:, 0], rows[:, 1] = ping, cone.ranges_m[kept]
        rows[:, 2] = cone.transducer.beam.half_angle_rad
        rows[:, 4], rows[:, 5] = _ANY_BEARING, weights[ping]
        rows[:, 6] = _ASLANT_RAD * is_deaf_behind(cone)
        if cone.bearings_rad is not None and cone.bearing_stds_rad is not None:
            known = np.isfinite(cone.bearings_rad[kept])
            rows[known, 3] = cone.bearings_rad[kept][known]
            rows[known, 4] = cone.bearing_stds_rad[kept][known]
        columns.append(rows)
    table = np.concatenate(columns)
    # In one piece each, as compiled code wants them.
    whose, *others = (np.ascontiguousarray(column) for column in table.T)
    return TrackEchoes(whose.astype(np.int64), *others)


def of_rows(echoes: TrackEchoes, rows: NDArray[np.intp]) -> TrackEchoes:
    """Some of the echoes."""
    whose, *others = (np.asarray(column[rows], float) for column in echoes)
    return TrackEchoes(whose.astype(np.int64), *others)


def first_of_each_ping(echoes: TrackEchoes) -> TrackEchoes:
    """What each ping heard first, where echoes stand in the order of their pings and ranges."""
    return of_rows(echoes, np.flatnonzero(np.diff(echoes.ping, prepend=-1)))


def _telling(cone: EchoCone) -> NDArray[np.intp]:
    """Rows of the echoes that count."""
    ranges_m = cone.ranges_m.astype(float)
    if len(ranges_m) <= _FIRST + _LOUDEST:
        return np.arange(len(ranges_m))
    loss = 10.0 ** (cone.attenuation_db_m * ranges_m / 10.0)
    loudness = cone.amplitudes * ranges_m**2 * loss
    loudest = np.argsort(-loudness, kind="stable")[:_LOUDEST]
    return np.union1d(np.arange(_FIRST), loudest)
