"""Echoes of all pings, one behind the other."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.numerics.arrays import FloatArray, spans
from usmap_ros.numerics.compiled import compiled


class Echoes(NamedTuple):
    """Echoes of all pings."""

    #: (pings + 1,) int64 array: first of each ping, and the end.
    start: NDArray[np.int64]
    #: (echoes,) float64 arrays: of each.
    range_m: FloatArray
    amplitude: FloatArray

    def of_pings(self, pings: NDArray[np.int64]) -> Echoes:
        """Those of some pings alone, one ping behind the other."""
        count = np.diff(self.start)[pings]
        own = spans(self.start[pings], count)
        start = np.concatenate([[0], np.cumsum(count)])
        return Echoes(start, self.range_m[own], self.amplitude[own])


@compiled
def count_between(
    echoes: Echoes, pings: NDArray[np.int64], near_m: FloatArray, far_m: FloatArray
) -> NDArray[np.int64]:
    """Echoes of some pings, each from a stretch of ranges."""
    counts = np.zeros(len(pings), np.int64)
    for place in range(len(pings)):
        ping = pings[place]
        for echo in range(echoes.start[ping], echoes.start[ping + 1]):
            counts[place] += near_m[place] < echoes.range_m[echo] < far_m[place]
    return counts


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
