"""How far looks from one side repeat each other: a Gamma-Poisson model of silence.

Some surfaces answer one side less than others do, or not at all: they are smooth, or thin, or
hidden by something that nobody knows of.  Then they are silent again and again, and a hundred
silent looks from there do not say a hundred times what one says.  If the rate at which a surface
answers one side is that of all surfaces times a factor with a Gamma distribution of mean 1 and of
some shape k, all looks from there are silent with probability (1 + s / k)^-k, where s is what each
of them says by itself, added up.  The shape is learnt from surfaces that are believed.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.field import Field
from usmap_ros.mapping.joint.response import NO_NORMAL, Listening, incidence_of, looked_at
from usmap_ros.mapping.looks import Looks
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.compiled import compiled, inlined

#: Sectors of directions of view, each of which is one side.
SECTORS = 12
#: Shapes that are compared, and the one that is expected where little has been heard: how many
#: times more or less it may be, as a standard deviation of its logarithm.
SHAPES = np.geomspace(0.7, 6.0, 25)
USUAL_SHAPE, USUAL_FACTOR = 2.5, 2.0
#: Surfaces on which less sound fell than would say so much say nothing of the shape.
LEAST_SAID = 0.5


@inlined
def sector_of(direction_rad: float) -> int:
    """Sector of a direction of view."""
    turns = direction_rad / (2.0 * math.pi)
    turns -= math.floor(turns)
    return min(int(turns * SECTORS), SECTORS - 1)


@compiled
def _tally_sides(  # noqa: PLR0913, PLR0917 - a kernel takes arrays
    looks: Looks,
    pings: NDArray[np.int64],
    field: Field,
    left: NDArray[np.uint8],
    listening: Listening,
    surfaces: FloatArray,
    log_silent: FloatArray,
    said: FloatArray,
    heard: BoolArray,
) -> None:
    """Add up what silence would say of each side of surfaces, and note which were heard.

    Parameters
    ----------
    looks, pings, field, left, listening, surfaces, log_silent
        As in `learn_shape`.
    said, heard : (surfaces, SECTORS) arrays
        Sum of -ln P(silent | surface) over looks, and whether one of them was answered; set.
    """
    for place in range(len(surfaces)):
        row, column, normal = surfaces[place]
        for index in range(len(pings)):
            ping = pings[index]
            loud, direction_rad, b = looked_at(
                looks, ping, field, left[index], listening.limit[index], row, column
            )
            if loud < 0:
                continue
            incidence = incidence_of(direction_rad, normal) if normal > NO_NORMAL + 1.0 else 0
            sector = sector_of(direction_rad)
            said[place, sector] -= log_silent[loud, incidence]
            heard[place, sector] |= listening.heard[index, b] > 0


def learn_shape(
    looks: Looks,
    pings: NDArray[np.int64],
    field: Field,
    left: NDArray[np.uint8],
    listening: Listening,
    surfaces: FloatArray,
    log_silent: FloatArray,
) -> float:
    """Shape of the distribution of how readily surfaces answer one side, by maximum a posteriori.

    Parameters
    ----------
    looks, pings, field, left, listening
        The pings, and what they heard.
    surfaces : (surfaces, 3) array
        Row, column, and direction of the normal, rad; `NO_NORMAL` for what has none.
    log_silent : (LOUDNESSES, INCIDENCES) array
        Logarithm of P(silent | surface).
    """
    said = np.zeros((len(surfaces), SECTORS))
    heard = np.zeros((len(surfaces), SECTORS), bool)
    _tally_sides(looks, pings, field, left, listening, surfaces, log_silent, said, heard)
    counts = said > LEAST_SAID
    return most_likely_shape(said[counts], heard[counts])


def most_likely_shape(said: FloatArray, heard: BoolArray) -> float:
    """Shape at which surfaces are silent as often as they were, by what looks said of each."""
    logs = -SHAPES * np.log1p(said[:, np.newaxis] / SHAPES)
    likelihood = np.where(heard[:, np.newaxis], np.log(-np.expm1(logs)), logs).sum(axis=0)
    unusual = np.log(SHAPES / USUAL_SHAPE) / math.log(USUAL_FACTOR)
    return float(SHAPES[np.argmax(likelihood - 0.5 * unusual**2)])
