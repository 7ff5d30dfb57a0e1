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
#: Logarithm of how much likelier an echo is of something that stands, such as the foot of a wall, a
#: pole or an edge, than of a wall's tail or a bounce: for each decibel that it is below the loudest
#: of its ping, and for each that it is above those up to so far before it, m, of which so many dB
#: count at the most; and where it is 0 dB above all.  By logistic regression of echoes from flats,
#: seeds 11 to 14 of `benchmarks/poses.py`, but for the last, which is higher than that: among poles
#: one is often as loud as another just before it.
_BELOW_LOUDEST, _ABOVE_BEFORE, _BEFORE_M, _MOST_ABOVE_DB, _LEVEL = 0.105, 0.18, 0.3, 20.0, -1.0
#: How much likelier at the most: whatever stands alone may be a bounce.
_MOST_ONSET = 2.0
#: What echoes of no loudness are taken for.
_SILENCE = 1e-12
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
    #: (n,) array: how much likelier each is of a landmark than usual, by the trace that it is in.
    onset: FloatArray

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
    columns: list[FloatArray] = [np.zeros((0, 8))]
    for ping, cone in enumerate(cones):
        ranges_m = cone.ranges_m.astype(float)
        loudness_db = _loudness_db(cone, ranges_m)
        kept, is_first_only = _telling(loudness_db), is_deaf_behind(cone)
        rows = np.zeros((len(kept), 8))
        rows[:, 0], rows[:, 1] = ping, ranges_m[kept]
        rows[:, 2] = cone.transducer.beam.half_angle_rad
        rows[:, 4], rows[:, 5] = _ANY_BEARING, weights[ping]
        rows[:, 6] = _ASLANT_RAD * is_first_only
        rows[:, 7] = 1.0 if is_first_only else _onsets(ranges_m, loudness_db)[kept]
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


def _loudness_db(cone: EchoCone, ranges_m: FloatArray) -> FloatArray:
    """How well each thing reflects, as far as echoes tell: spreading and absorption made good."""
    spread = cone.amplitudes.astype(float) * ranges_m**2
    loss_db = cone.attenuation_db_m * 2.0 * ranges_m
    return np.asarray(20.0 * np.log10(np.maximum(spread, _SILENCE)) + loss_db)


def _telling(loudness_db: FloatArray) -> NDArray[np.intp]:
    """Rows of the echoes that count."""
    if len(loudness_db) <= _FIRST + _LOUDEST:
        return np.arange(len(loudness_db))
    loudest = np.argsort(-loudness_db, kind="stable")[:_LOUDEST]
    return np.union1d(np.arange(_FIRST), loudest)


def _onsets(ranges_m: FloatArray, loudness_db: FloatArray) -> FloatArray:
    """How much likelier each echo is of something that stands than of what comes after that.

    Sound that walls scatter, and that goes to and fro between them, comes back after what came the
    straight way, and is no louder: a landmark's echo sets in.
    """
    after_m = ranges_m[:, np.newaxis] - ranges_m
    before = np.where((after_m > 0.0) & (after_m < _BEFORE_M), loudness_db, -np.inf)
    above_db = loudness_db - before.max(axis=1, initial=-np.inf)
    below_db = loudness_db - loudness_db.max(initial=-np.inf)
    told = _BELOW_LOUDEST * below_db + _ABOVE_BEFORE * np.minimum(above_db, _MOST_ABOVE_DB)
    return np.asarray(np.minimum(np.exp(told + _LEVEL), _MOST_ONSET))
