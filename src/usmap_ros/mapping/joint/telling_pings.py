"""Which new pings tell anything of an area, where more come than can be explained in time.

Most say again what is known: they look where enough others looked from the same side, and heard
what was to be expected.  Who visits those alone that do not keeps up; all of them count when all
pings are explained together.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.area_state import AreaState
from usmap_ros.mapping.joint.forward_model.log_odds import optical_depth
from usmap_ros.mapping.joint.forward_model.powers import Powers
from usmap_ros.mapping.joint.kept_pings import Pings
from usmap_ros.mapping.joint.surfaces.smooth_surfaces import SmoothSurfaces
from usmap_ros.mapping.joint.visibility.field import field_around
from usmap_ros.mapping.ping_bins import ECHO, SILENCE
from usmap_ros.mapping.ping_table import PingTable
from usmap_ros.numerics.arrays import BoolArray
from usmap_ros.numerics.compiled import compiled
from usmap_ros.parameters import MappingParameters

#: An echo is a surprise if its power is so many times what is expected, which one of 400 is that is
#: exponentially distributed, and silence if the limit is such a share of it; within so many bins.
LOUDER, SILENT_SHARE, NEAR_BINS = 6.0, 0.02, 2


def telling(
    pings: Pings, known: AreaState, parameters: MappingParameters
) -> tuple[Pings, AreaState]:
    """Those of some pings that tell something, and what is known with their looks counted.

    Parameters
    ----------
    pings : Pings
        The new ones; those that smooth things explain are changed.
    known : AreaState
        Before them.
    parameters : MappingParameters
        Of the map.
    """
    numbers = pings.table.numbers[pings.rows]
    looks = known.looks.reaching(numbers)
    tells, looks = looks.of_lacking(numbers, pings.weights, np.arange(len(numbers)))
    # One range says too little for looks of others to stand in for its own.
    tells |= pings.first_only
    again = np.flatnonzero(~tells)
    if len(again):
        tells[again] = are_surprises(pings.among(again), known, parameters)
    return pings.among(np.flatnonzero(tells)), replace(known, looks=looks)


def are_surprises(pings: Pings, known: AreaState, parameters: MappingParameters) -> BoolArray:
    """Whether each of some pings heard something else than what is known makes likely."""
    field = field_around(pings.table, pings.rows, parameters.resolution_m)
    before = known.reaching(field).part(field)
    smooth = SmoothSurfaces(pings.table, pings.rows, pings.echoes, field)
    smooth.recognise(known.smooth)
    powers = Powers(pings.table, pings.rows, pings.weights, field, known.limits)
    powers.go_on(before.settled)
    powers.renew_shadows(optical_depth(before.hiding, parameters.shadow_opacity))
    expected = powers.expected_of(np.ones(field.rows * field.columns, bool))
    return _surprise(pings.table, pings.rows, expected)


@compiled
def _surprise(
    table: PingTable, pings: NDArray[np.int64], expected: NDArray[np.float32]
) -> BoolArray:
    """Whether any range bin of each ping is a surprise.

    Parameters
    ----------
    table, pings
        The pings.
    expected : (pings, bins) float32 array
        λ.
    """
    surprise = np.zeros(len(pings), np.bool_)
    for index in range(len(pings)):
        ping, own = pings[index], expected[index]
        bins = table.bins[ping]
        for b in range(bins):
            if table.kind[ping, b] == SILENCE:
                surprise[index] |= table.limit[ping, b] < SILENT_SHARE * own[b]
            elif table.kind[ping, b] == ECHO:
                near = own[max(0, b - NEAR_BINS) : min(bins, b + NEAR_BINS + 1)].max()
                surprise[index] |= table.power[ping, b] > LOUDER * near
    return surprise
