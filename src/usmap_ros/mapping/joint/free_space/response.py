"""How this place answers: how likely a surface stays silent, by loudness and angle of incidence.

Learnt from surfaces that are believed, those that were filled in included: from detected ones alone
it would be biased.  How often nothing is heard where a surface stands, over how often nothing is
heard beside it, is P(silent | surface).  Poles and rough walls answer from any side, smooth walls
only when they are struck squarely: silence is trusted accordingly.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.free_space.fading import kept_up, over_square
from usmap_ros.mapping.joint.free_space.kinds import FAINTER
from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.mapping.joint.visibility.soundings import (
    INCIDENCES,
    LOUDNESSES,
    incidence_of,
    room_for,
    sound,
)
from usmap_ros.mapping.ping_bins import ECHO
from usmap_ros.mapping.ping_table import BIN_M, NOISE, PingTable, X, Y
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.compiled import compiled
from usmap_ros.processes.threads import for_each

#: Classes of oblique incidence, that diffuseness compares with those of square one.
OBLIQUE = slice(4, 6)
#: Pings that one thread listens to, or of which it looks at surfaces, at a time.
BATCH = 32
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
#: silence at 10 to 20 degrees, to a power: in the last class a smaller one, since what is looked at
#: edge-on shows little of itself.
SMOOTH, ROUGH, GRAZING_POWER, EDGE_ON_POWER = 0.38, 0.5, 0.65, 0.4
#: An echo is explained by what is expected to return such a share of its power, and then was to
#: be heard, whatever else stands there, with this probability.
EXPLAINED_SHARE, MOST_EXPLAINED = 0.7, 0.8
#: Silence that is hardly less likely with a surface than this says nothing; below, all it says.
MUTE, TELLING = 0.65, 0.4
#: Share of the cells on no line at which a place of few looks counts as one that answers from
#: anywhere.
LONE_SHARE = 0.8
#: In the place of the normal of what has none: compiled functions take no number for not finite.
NO_NORMAL = -9.0


class SurfaceViews(NamedTuple):
    """Looks of pings at surfaces, one behind the other."""

    #: (views,) int32 arrays: which surface, and classes of loudness, of the angle of incidence (0
    #: for what faces nowhere), and of the direction of view.
    surface: NDArray[np.int32]
    loud: NDArray[np.int32]
    incidence: NDArray[np.int32]
    sector: NDArray[np.int32]
    #: (views,) uint8 array: whether there was an echo.
    heard: NDArray[np.uint8]
    #: (views,) float32 array: share of silence where `BESIDE_M` before and behind.
    beside: NDArray[np.float32]


class HeardBins(NamedTuple):
    """What was heard of each range bin, for silence: (pings, bins) arrays, but for the last."""

    #: 1 if there was an echo within three quarters of a cell.
    heard: NDArray[np.uint8]
    #: Probability that one would be there by what is known to stand at that range.
    chance: NDArray[np.float32]
    #: The same by whatever is estimated, shown or not, as far as that is trusted; no less.
    likely: NDArray[np.float32]
    #: Power that would have been reported.
    limit: NDArray[np.float32]
    #: (pings,) array: by how many steps of loudness something round is fainter to each ping than
    #: what is flat and struck squarely.
    fainter: NDArray[np.int64]


def listen(
    table: PingTable, pings: NDArray[np.int64], expected: NDArray[np.float32], reach: int
) -> HeardBins:
    """What was heard around each range bin.

    Parameters
    ----------
    table, pings
        The pings.
    expected : (pings, bins) float32 array
        Power that what is believed returns: an echo that it explains says nothing of other things.
    reach : int
        Bins to either side that belong to one.
    """
    heard = np.zeros(expected.shape, np.uint8)
    chance, limit = np.zeros(expected.shape, np.float32), np.ones(expected.shape, np.float32)

    def listen_to(first: int) -> None:
        some = slice(first, first + BATCH)
        _listen(table, pings[some], expected[some], reach, heard[some], chance[some], limit[some])

    for_each(listen_to, range(0, len(pings), BATCH))
    return HeardBins(heard, chance, chance, limit, np.full(len(pings), FAINTER))


@compiled
def _listen(
    table: PingTable,
    pings: NDArray[np.int64],
    expected: NDArray[np.float32],
    reach: int,
    heard: NDArray[np.uint8],
    chance: NDArray[np.float32],
    limit: NDArray[np.float32],
) -> None:
    """Set what was heard around each range bin of some pings."""
    for index in range(len(pings)):
        ping = pings[index]
        bins, floor = table.bins[ping], 1e9
        for b in range(bins):
            floor = min(floor, table.limit[ping, b])
        for b in range(bins):
            first, end = max(0, b - reach), min(bins, b + reach + 1)
            quiet, logs, explained = 1.0, 0.0, 1.0
            for near in range(first, end):
                if table.kind[ping, near] == ECHO:
                    heard[index, b] = 1
                    returned = expected[index, near] - table.numbers[ping, NOISE]
                    explained = min(explained, returned / max(table.power[ping, near], 1e-12))
                quiet *= 1.0 - math.exp(-table.limit[ping, near] / expected[index, near])
                logs += math.log(table.limit[ping, near])
            chance[index, b] = 1.0 - quiet
            if heard[index, b]:
                share = min(MOST_EXPLAINED, explained / EXPLAINED_SHARE)
                chance[index, b] = max(1.0 - quiet, share)
            limit[index, b] = floor if heard[index, b] else math.exp(logs / (end - first))


def look_at(
    table: PingTable,
    pings: NDArray[np.int64],
    field: Field,
    left: NDArray[np.uint8],
    listening: HeardBins,
    surfaces: FloatArray,
) -> SurfaceViews:
    """Looks of pings at surfaces that most of their sound gets to, and what was heard.

    Parameters
    ----------
    table, pings, field
        The pings, and the cells.
    left : (pings, RAYS, STEPS) uint8 array
        How much of their sound is left.
    listening : HeardBins
        What they heard.
    surfaces : (surfaces, 3) array
        Row, column, and direction of the normal, rad; `NO_NORMAL` for what has none.
    """
    batches = [slice(first, first + BATCH) for first in range(0, len(pings), BATCH)]
    parts = for_each(
        lambda some: _look_at(
            table, pings[some], field, left[some], listening.heard[some], listening.limit[some],
            surfaces,
        ),
        batches,
    )  # fmt: skip
    return SurfaceViews(*(np.concatenate(each) for each in zip(*parts, strict=True)))


@compiled
def _look_at(
    table: PingTable,
    pings: NDArray[np.int64],
    field: Field,
    left: NDArray[np.uint8],
    heard: NDArray[np.uint8],
    limit: NDArray[np.float32],
    surfaces: FloatArray,
) -> SurfaceViews:
    """The same of some pings."""
    res, size, filled = field.resolution_m, len(surfaces) * len(pings), 0
    views = SurfaceViews(
        np.empty(size, np.int32), np.empty(size, np.int32), np.empty(size, np.int32),
        np.empty(size, np.int32), np.empty(size, np.uint8), np.empty(size, np.float32),
    )  # fmt: skip
    seen = room_for(len(surfaces))
    for place in range(len(surfaces)):
        seen.right[place] = (surfaces[place, 1] + 0.5) * res
        seen.up[place] = (surfaces[place, 0] + 0.5) * res
    for index in range(len(pings)):
        ping = pings[index]
        x_m = field.first_column * res - table.numbers[ping, X]
        y_m = field.first_row * res - table.numbers[ping, Y]
        away, bins = int(BESIDE_M / table.numbers[ping, BIN_M]), table.bins[ping]
        count = sound(
            table, ping, left[index], limit[index], x_m, y_m, OWN_CELLS * res, len(surfaces), seen
        )
        for place in range(count):
            which, b, normal = seen.which[place], seen.bin[place], surfaces[seen.which[place], 2]
            if seen.sound[place] < CLEAR_SHARE:
                continue
            silent, sides = 0.0, 0.0
            for other in (b - away, b + away):
                if 0 <= other < bins:
                    silent += 1.0 - heard[index, other]
                    sides += 1.0
            direction = math.atan2(y_m + seen.up[which], x_m + seen.right[which])
            incidence = incidence_of(direction, normal)
            views.surface[filled], views.loud[filled] = which, seen.loud[place]
            views.incidence[filled] = incidence if normal > NO_NORMAL + 1.0 else 0
            views.sector[filled], views.heard[filled] = seen.sector[place], heard[index, b]
            views.beside[filled] = silent / sides if sides else 0.0
            filled += 1
    return SurfaceViews(
        views.surface[:filled], views.loud[:filled], views.incidence[:filled],
        views.sector[:filled], views.heard[:filled], views.beside[:filled],
    )  # fmt: skip


def learn_response(views: SurfaceViews, surfaces: FloatArray, one_sided: float = 0.0) -> FloatArray:
    """Learn how the surfaces of a place answer.

    Parameters
    ----------
    views, surfaces
        By and as in `look_at`.
    one_sided : float
        How far the place was looked at from one side only: then what was not looked at aslant is
        not taken to answer as rough walls do.

    Returns
    -------
    log_silent : (LOUDNESSES, INCIDENCES) array
        Logarithm of P(silent | surface), as far as silence is trusted.
    """
    has_normal = (surfaces[:, 2] != NO_NORMAL)[views.surface]
    silent, looks = (
        _tally(views, weights.astype(np.float64), has_normal)
        for weights in (views.heard == 0, views.beside)
    )
    # Steps of loudness lend to their neighbours.
    padded = np.pad([silent, looks], [(0, 0), (1, 1), (0, 0)], mode="edge")
    silent, beside = padded[:, :-2] + padded[:, 1:-1] + padded[:, 2:]
    pseudo = PSEUDO_COUNT
    if _are_lone(surfaces):
        # What faces nowhere answers alike at any incidence: all that is heard of it is one class.
        sums = (each.sum(axis=1, keepdims=True) for each in (silent, beside))
        silent, beside = (np.repeat(each, INCIDENCES, axis=1) for each in sums)
        pseudo = LONE_PSEUDO_COUNT
    as_heard = np.minimum(1.0, (silent + pseudo) / (beside + pseudo))
    # What is louder, or struck more squarely, is not more often silent.
    p_silent = np.maximum.accumulate(np.minimum.accumulate(as_heard, axis=0), axis=1)
    p_silent = np.clip(p_silent, LEAST_SILENT, MOST_SILENT)
    diffuseness = _diffuseness(p_silent, looks, surfaces)
    trust = float(np.clip((diffuseness - SMOOTH) / (ROUGH - SMOOTH), 0.0, 1.0))
    return _trusted(p_silent, trust * kept_up(as_heard, p_silent, looks, one_sided))


def _tally(views: SurfaceViews, weights: FloatArray, has_normal: BoolArray) -> FloatArray:
    """Sums of weights by loudness and incidence; what faces nowhere is of all incidences."""
    size = LOUDNESSES * INCIDENCES
    place = views.loud * INCIDENCES + views.incidence
    facing = np.bincount(place[has_normal], weights[has_normal], size)
    others = np.bincount(views.loud[~has_normal], weights[~has_normal], LOUDNESSES)
    sums: FloatArray = facing.reshape(LOUDNESSES, INCIDENCES) + others[:, np.newaxis] / INCIDENCES
    return sums


def _diffuseness(p_silent: FloatArray, looks: FloatArray, surfaces: FloatArray) -> float:
    """Answers to oblique sound over those to square sound."""
    oblique = (1.0 - p_silent[:, OBLIQUE]).mean(axis=1)
    share = over_square(oblique, looks[:, OBLIQUE].sum(axis=1), p_silent)
    return float(_are_lone(surfaces)) if share is None else share


def _are_lone(surfaces: FloatArray) -> bool:
    """Whether most surfaces are on no line."""
    has_no_line = surfaces[:, 2] == NO_NORMAL
    return len(surfaces) > 0 and bool(has_no_line.mean() > LONE_SHARE)


def _trusted(p_silent: FloatArray, trust: FloatArray) -> FloatArray:
    """Logarithm of P(silent | surface), faint hints left out.

    Grazing silence is that of rough walls as far as each class of incidence is trusted to be so.
    """
    log_silent = np.log(p_silent)
    for incidence in range(4, INCIDENCES):
        power = GRAZING_POWER if incidence < INCIDENCES - 1 else EDGE_ON_POWER
        grazing = np.minimum(log_silent[:, incidence], power * log_silent[:, 3])
        log_silent[:, incidence] += trust[:, incidence] * (grazing - log_silent[:, incidence])
    telling = np.clip((MUTE - np.exp(log_silent)) / (MUTE - TELLING), 1e-6, 1.0)
    trusted: FloatArray = log_silent * telling
    return trusted
