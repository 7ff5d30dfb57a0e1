"""How this place answers: how likely a surface stays silent, by loudness and angle of incidence.

Learnt from surfaces that are believed, those that were filled in included: from detected ones alone
it would be biased.  How often nothing is heard where a surface stands, over how often nothing is
heard beside it, is P(silent | surface).  Poles and rough walls answer from any side, smooth walls
only when they are struck squarely: silence is trusted accordingly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.field import NOISE, Field
from usmap_ros.mapping.joint.ray_casting import RAYS, STEPS, WHOLE
from usmap_ros.mapping.looks import Looks
from usmap_ros.mapping.ping_bins import ECHO, GAIN_STEPS
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.compiled import compiled, inlined

#: Steps of loudness, 3 dB each from -20 dB of what would have been reported.
LOUDNESSES, FIRST_DB, STEP_DB = 24, -20.0, 3.0
#: Upper ends of the classes of incidence, degrees off the normal; the last goes on to 90.
INCIDENCES_DEG = np.array([2.0, 5.0, 10.0, 20.0, 35.0, 50.0, 70.0])
INCIDENCES = len(INCIDENCES_DEG) + 1
#: Classes of square and of oblique incidence, that diffuseness compares.
SQUARE, OBLIQUE = slice(1, 3), slice(4, 6)
#: A ping looks at a cell, for learning, if so much of its sound gets there.
CLEAR_SHARE = 0.7
#: Before a surface, sound must be left up to so many cells before its middle.
OWN_CELLS = 3.0
#: Beside a surface, where it is looked how often silence is, m.
BESIDE_M = 0.3
#: What each class of a table begins with, and what the one class of lone things does, of which
#: those that are found answer better than those that are not.
PSEUDO_COUNT, LONE_PSEUDO_COUNT = 2.0, 9.0
#: Bounds of P(silent | surface).
LEAST_SILENT, MOST_SILENT = 0.05, 1.0 - 1e-4
#: Diffuseness below which grazing silence says nothing of surfaces, and above which as much as
#: silence at 10 to 20 degrees, to a power.
SMOOTH, ROUGH, GRAZING_POWER = 0.38, 0.5, 0.8
#: An echo is explained by what is expected to return such a share of its power, and then was to
#: be heard, whatever else stands there, with this probability.
EXPLAINED_SHARE, MOST_EXPLAINED = 0.7, 0.8
#: Silence that is hardly less likely with a surface than this says nothing; below, all it says.
MUTE, TELLING = 0.65, 0.4
#: Looks that diffuseness is learnt from at least, and the share of cells on no line at which a
#: place of few looks counts as one that answers from anywhere.
LEAST_LOOKS, LONE_SHARE = 200.0, 0.8
#: In the place of the normal of what has none: compiled functions take no number for not finite.
NO_NORMAL = -9.0


class Listening(NamedTuple):
    """What was heard of each range bin, for silence: (pings, bins) arrays.

    Parameters
    ----------
    heard : uint8 array
        1 if there was an echo within three quarters of a cell.
    chance : float32 array
        Probability that one would be there by what is known to stand at that range.
    limit : float32 array
        Power that would have been reported.
    """

    heard: NDArray[np.uint8]
    chance: NDArray[np.float32]
    limit: NDArray[np.float32]


@dataclass(frozen=True)
class Response:
    """How a place answers.

    Parameters
    ----------
    log_silent : (LOUDNESSES, INCIDENCES) array
        Logarithm of P(silent | surface), as far as silence is trusted.
    diffuseness : float
        How often surfaces answer obliquely, relative to squarely.
    """

    log_silent: FloatArray
    diffuseness: float


@inlined
def loudness_step(ratio: float) -> int:
    """Class of a power over what would have been reported."""
    return min(LOUDNESSES - 1, max(0, int((10.0 * math.log10(ratio) - FIRST_DB) / STEP_DB)))


@inlined
def incidence_class(degrees: float) -> int:
    """Class of an angle of incidence."""
    for index in range(len(INCIDENCES_DEG)):
        if degrees < INCIDENCES_DEG[index]:
            return index
    return len(INCIDENCES_DEG)


@inlined
def sounded(
    looks: Looks, ping: int, field: Field, row: float, column: float
) -> tuple[float, float, float, int, int, float]:
    """How a ping sounds a cell.

    Returns
    -------
    loudness : float
        Power that an object of power 1 would return; 0 if the cell is not in the cone.
    x, y : float
        Where the cell is, from the transducer.
    bin, ray : int
        Range bin, and ray in the tables of `cast_rays`.
    distance : float
        Range, m.
    """
    numbers = looks.numbers[ping]
    x = (field.first_column + column + 0.5) * field.resolution_m - numbers[0]
    y = (field.first_row + row + 0.5) * field.resolution_m - numbers[1]
    squared = x * x + y * y + numbers[5] * numbers[5]
    ahead = numbers[2] * x + numbers[3] * y + numbers[4] * numbers[5]
    cos_half, least, greatest = numbers[8], numbers[9], numbers[10]
    is_inside = least * least < squared < greatest * greatest
    if not is_inside or ahead * abs(ahead) <= squared * cos_half * abs(cos_half):
        return 0.0, x, y, 0, 0, 0.0
    distance = math.sqrt(squared)
    b = int((distance - least) / numbers[13])
    if b >= looks.bins[ping]:
        return 0.0, x, y, 0, 0, 0.0
    entry = int((1.0 - ahead / distance) / (1.0 - cos_half) * GAIN_STEPS)
    gain = looks.power_gain[ping, min(max(entry, 0), GAIN_STEPS)]
    loudness = gain / squared**2 * math.exp(-numbers[11] * distance)
    cosine, sine = math.cos(numbers[6]), math.sin(numbers[6])
    off = math.atan2(cosine * y - sine * x, cosine * x + sine * y)
    ray = min(max(int((off + numbers[7]) * RAYS / (2.0 * numbers[7])), 0), RAYS - 1)
    return loudness, x, y, b, ray, distance


@inlined
def step_before(looks: Looks, ping: int, distance: float) -> int:
    """Place of a range, m, in the tables of `cast_rays`."""
    return min(max(int(distance * STEPS / looks.numbers[ping, 10]), 0), STEPS - 1)


@inlined
def looked_at(
    looks: Looks,
    ping: int,
    field: Field,
    left: NDArray[np.uint8],
    limit: NDArray[np.float32],
    row: float,
    column: float,
) -> tuple[int, float, int]:
    """How a ping looks at a surface, if most of its sound gets there.

    Parameters
    ----------
    looks, ping, field
        The ping, and the cells.
    left : (RAYS, STEPS) uint8 array
        How much of its sound is left.
    limit : (bins,) float32 array
        Power that would have been reported.
    row, column : float
        Where the surface is.

    Returns
    -------
    loud, bin : int
        Class of loudness, -1 if it does not look there; and range bin.
    direction : float
        Of view, rad.
    """
    loudness, x, y, b, ray, distance = sounded(looks, ping, field, row, column)
    if loudness <= 0.0:
        return -1, 0.0, 0
    step = step_before(looks, ping, distance - OWN_CELLS * field.resolution_m)
    if left[ray, step] < CLEAR_SHARE * WHOLE:
        return -1, 0.0, 0
    return loudness_step(loudness / limit[b]), math.atan2(y, x), b


@inlined
def incidence_of(direction_rad: float, normal_rad: float) -> int:
    """Class of the angle between a direction of view and a normal, either way."""
    degrees = (direction_rad - normal_rad) * 180.0 / math.pi
    return incidence_class(abs(degrees - 180.0 * math.floor(degrees / 180.0 + 0.5)))


@compiled
def listen(
    looks: Looks, pings: NDArray[np.int64], expected: NDArray[np.float32], reach: int
) -> Listening:
    """What was heard around each range bin.

    Parameters
    ----------
    looks, pings
        The pings.
    expected : (pings, bins) float32 array
        Power that what is believed returns: an echo that it explains says nothing of other things.
    reach : int
        Bins to either side that belong to one.
    """
    heard = np.zeros(expected.shape, np.uint8)
    chance, limit = np.zeros(expected.shape, np.float32), np.ones(expected.shape, np.float32)
    for index in range(len(pings)):
        ping = pings[index]
        bins, floor = looks.bins[ping], 1e9
        for b in range(bins):
            floor = min(floor, looks.limit[ping, b])
        for b in range(bins):
            first, end = max(0, b - reach), min(bins, b + reach + 1)
            quiet, logs, explained = 1.0, 0.0, 1.0
            for near in range(first, end):
                if looks.kind[ping, near] == ECHO:
                    heard[index, b] = 1
                    returned = expected[index, near] - looks.numbers[ping, NOISE]
                    explained = min(explained, returned / max(looks.power[ping, near], 1e-12))
                quiet *= 1.0 - math.exp(-looks.limit[ping, near] / expected[index, near])
                logs += math.log(looks.limit[ping, near])
            chance[index, b] = 1.0 - quiet
            if heard[index, b]:
                share = min(MOST_EXPLAINED, explained / EXPLAINED_SHARE)
                chance[index, b] = max(1.0 - quiet, share)
            limit[index, b] = floor if heard[index, b] else math.exp(logs / (end - first))
    return Listening(heard, chance, limit)


@compiled
def _tally(
    looks: Looks,
    pings: NDArray[np.int64],
    field: Field,
    left: NDArray[np.uint8],
    listening: Listening,
    surfaces: FloatArray,
    counts: FloatArray,
) -> None:
    """Count silence and echoes of surfaces, and silence beside them.

    Parameters
    ----------
    looks, pings, field, left, listening
        The pings, and what they heard.
    surfaces : (surfaces, 3) array
        Row, column, and direction of the normal, rad; `NO_NORMAL` for what has none.
    counts : (3, LOUDNESSES, INCIDENCES) array
        Of silence, of echoes, and of silence beside; added to.
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
            away, beside, sides = int(BESIDE_M / looks.numbers[ping, 13]), 0.0, 0.0
            for other in (b - away, b + away):
                if 0 <= other < looks.bins[ping]:
                    beside += 1.0 - listening.heard[index, other]
                    sides += 1.0
            beside = beside / sides if sides else 0.0
            heard = listening.heard[index, b]
            if normal < NO_NORMAL + 1.0:
                for incidence in range(INCIDENCES):
                    counts[heard, loud, incidence] += 1.0 / INCIDENCES
                    counts[2, loud, incidence] += beside / INCIDENCES
            else:
                incidence = incidence_of(direction_rad, normal)
                counts[heard, loud, incidence] += 1.0
                counts[2, loud, incidence] += beside


def learn_response(
    looks: Looks,
    pings: NDArray[np.int64],
    field: Field,
    left: NDArray[np.uint8],
    listening: Listening,
    surfaces: FloatArray,
) -> Response:
    """Learn how the surfaces of a place answer.

    Parameters
    ----------
    looks, pings, field, left, listening, surfaces
        As in `_tally`.
    """
    counts = np.zeros((3, LOUDNESSES, INCIDENCES))
    _tally(looks, pings, field, left, listening, surfaces, counts)
    # Steps of loudness lend to their neighbours.
    padded = np.pad(counts, [(0, 0), (1, 1), (0, 0)], mode="edge")
    silent, _, beside = padded[:, :-2] + padded[:, 1:-1] + padded[:, 2:]
    pseudo = PSEUDO_COUNT
    if _are_lone(surfaces):
        # What faces nowhere answers alike at any incidence: all that is heard of it is one class.
        sums = (each.sum(axis=1, keepdims=True) for each in (silent, beside))
        silent, beside = (np.repeat(each, INCIDENCES, axis=1) for each in sums)
        pseudo = LONE_PSEUDO_COUNT
    table = np.minimum(1.0, (silent + pseudo) / (beside + pseudo))
    # What is louder, or struck more squarely, is not more often silent.
    table = np.maximum.accumulate(np.minimum.accumulate(table, axis=0), axis=1)
    table = np.clip(table, LEAST_SILENT, MOST_SILENT)
    diffuseness = _diffuseness(table, counts, surfaces)
    return Response(_trusted(table, diffuseness), diffuseness)


def _diffuseness(table: FloatArray, counts: FloatArray, surfaces: FloatArray) -> float:
    """Answers to oblique sound over those to square sound."""
    looks = counts[2][:, OBLIQUE].sum(axis=1) * (table[:, 1] < 0.7)
    if looks.sum() > LEAST_LOOKS:
        answers = 1.0 - table
        square = (looks * answers[:, SQUARE].mean(axis=1)).sum()
        return float((looks * answers[:, OBLIQUE].mean(axis=1)).sum() / max(square, 1e-9))
    return float(_are_lone(surfaces))


def _are_lone(surfaces: FloatArray) -> bool:
    """Whether most surfaces are on no line."""
    has_no_line = surfaces[:, 2] == NO_NORMAL
    return len(surfaces) > 0 and bool(has_no_line.mean() > LONE_SHARE)


def _trusted(table: FloatArray, diffuseness: float) -> FloatArray:
    """Logarithm of P(silent | surface), grazing silence by diffuseness, faint hints left out."""
    log_silent = np.log(table)
    trust = float(np.clip((diffuseness - SMOOTH) / (ROUGH - SMOOTH), 0.0, 1.0))
    for incidence in range(4, INCIDENCES):
        grazing = np.minimum(log_silent[:, incidence], GRAZING_POWER * log_silent[:, 3])
        log_silent[:, incidence] = (1.0 - trust) * log_silent[:, incidence] + trust * grazing
    telling = np.clip((MUTE - np.exp(log_silent)) / (MUTE - TELLING), 1e-6, 1.0)
    trusted: FloatArray = log_silent * telling
    return trusted
