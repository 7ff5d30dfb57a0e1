"""Echoes of a ping that tell most of where things stand."""

import numpy as np
from numpy.typing import NDArray

from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.pings.cone import EchoCone

#: Of a ping those echoes count that come first, and the loudest ones.
FIRST, LOUDEST = 2, 2


def levels_db(cone: EchoCone) -> FloatArray:
    """Amplitudes in decibels, there and back through air that does not absorb."""
    amplitudes = np.maximum(cone.amplitudes.astype(float), 1e-9)
    lost_db = 2.0 * cone.attenuation_db_m * cone.ranges_m.astype(float)
    return np.asarray(20.0 * np.log10(amplitudes) + lost_db)


def first_and_loudest(cone: EchoCone, own_db: FloatArray) -> NDArray[np.intp]:
    """Rows of the first echoes, and of those that would be loudest from one range.

    Parameters
    ----------
    cone : EchoCone
        What was heard.
    own_db : (echoes,) array
        By `levels_db`.
    """
    count = len(cone.ranges_m)
    if count <= FIRST + LOUDEST:
        return np.arange(count)
    loudness_db = own_db + 40.0 * np.log10(cone.ranges_m.astype(float))
    loudest = np.argsort(-loudness_db, kind="stable")[:LOUDEST]
    return np.union1d(np.arange(FIRST), loudest)
