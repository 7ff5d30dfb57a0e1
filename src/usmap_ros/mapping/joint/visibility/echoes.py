"""Echoes of all pings, one behind the other."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.numerics.arrays import FloatArray


class Echoes(NamedTuple):
    """Echoes of all pings."""

    #: (pings + 1,) int64 array: first of each ping, and the end.
    start: NDArray[np.int64]
    #: (echoes,) float64 arrays: of each.
    range_m: FloatArray
    amplitude: FloatArray


def count_between(
    echoes: Echoes, pings: NDArray[np.int64], near_m: FloatArray, far_m: FloatArray
) -> NDArray[np.int64]:
    """Echoes of some pings, each from a stretch of ranges."""
    first, count = echoes.start[pings], np.diff(echoes.start)[pings]
    of = np.repeat(np.arange(len(pings)), count)
    place = np.arange(len(of)) + np.repeat(first - np.cumsum(count) + count, count)
    ranges_m = echoes.range_m[place]
    inside = (ranges_m > near_m[of]) & (ranges_m < far_m[of])
    return np.bincount(of[inside], minlength=len(pings))


def mirror_levels(echoes: Echoes, absorption: FloatArray) -> FloatArray:
    """Amplitude reflectivities of mirrors that would return echoes if they were on the beam's axis.

    Parameters
    ----------
    echoes : Echoes
        Of all pings.
    absorption : (echoes,) array
        Of each echo's ping, see `usmap_ros.mapping.ping_table.ABSORPTION`.
    """
    level = 2.0 * echoes.amplitude * echoes.range_m
    return np.asarray(level * np.exp(0.5 * absorption * echoes.range_m))
