"""Kinds of surfaces that are asked for, and how they answer: tables, compiled."""

import math

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.visibility.soundings import INCIDENCES, incidence_of
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.compiled import inlined

#: Orientations that a surface may have.
ORIENTATIONS = 16
#: Kinds of surfaces that are asked for: of each orientation, mirrors of each, which answer square
#: views alone, and round ones, which answer every view as flat ones answer a square one, but
#: fainter by so many steps of loudness.
ROUND = 2 * ORIENTATIONS
KINDS, FAINTER = ROUND + 1, 4
#: Classes of incidence of views that are square, and how many orientations may be so near to one.
SQUARE_CLASSES, STRUCK = 3, 2
#: Groups of kinds: walls along and across the usual direction, all others, and mirrors in a place
#: where none were found.
GROUPS, ALONG, ACROSS, OTHERS, MIRRORS = 4, 0, 1, 2, 3
#: Steps of the share of sound that gets to a cell.
SHARES = 32


def facing_anyhow(kinds: FloatArray) -> FloatArray:
    """Kinds of which walls that answer from any side are as usual whichever way they face."""
    kinds = kinds.copy()
    kinds[:ORIENTATIONS, 1] = 0.0
    return kinds


def all_usual(kinds: FloatArray) -> FloatArray:
    """Kinds that are all as usual, mirrors as the most usual of them."""
    kinds = facing_anyhow(kinds)
    kinds[ROUND, 1] = 0.0
    mirrored = kinds[ORIENTATIONS:ROUND, 1]
    mirrored[:] = mirrored.max()
    return kinds


@inlined
def incidence_classes(kinds: FloatArray) -> NDArray[np.int32]:
    """Class of incidence of a direction of view in degrees, for each orientation."""
    classes = np.empty((180, ORIENTATIONS), np.int32)
    for degrees in range(180):
        for orientation in range(ORIENTATIONS):
            direction = (degrees + 0.5) * math.pi / 180.0
            classes[degrees, orientation] = incidence_of(direction, kinds[orientation, 0])
    return classes


@inlined
def struck_squarely(classes: NDArray[np.int32]) -> NDArray[np.int32]:
    """Orientations that a direction of view in degrees strikes squarely; -1: none, or no other."""
    struck = np.full((180, STRUCK), -1, np.int32)
    for degrees in range(180):
        count = 0
        for orientation in range(ORIENTATIONS):
            if classes[degrees, orientation] < SQUARE_CLASSES and count < STRUCK:
                struck[degrees, count] = orientation
                count += 1
    return struck


@inlined
def silence_by_share(log_silent: FloatArray) -> NDArray[np.float32]:
    """P(silent | surface), and its logarithm, by the share of the sound that gets there."""
    loudnesses = log_silent.shape[0]
    silence = np.empty((SHARES + 1, loudnesses, 2, INCIDENCES), np.float32)
    for share in range(SHARES + 1):
        for loud in range(loudnesses):
            for incidence in range(INCIDENCES):
                answers = 1.0 - math.exp(log_silent[loud, incidence])
                silence[share, loud, 0, incidence] = 1.0 - answers * share / SHARES
                silence[share, loud, 1, incidence] = math.log(1.0 - answers * share / SHARES)
    return silence


@inlined
def distinct_ways(log_silent: FloatArray) -> int:
    """How many orientations differ: what answers alike at any incidence has only one."""
    for loud in range(log_silent.shape[0]):
        for incidence in range(1, INCIDENCES):
            if log_silent[loud, incidence] != log_silent[loud, 0]:
                return ORIENTATIONS
    return 1
