"""Objects, a floor, a sound speed and an offset that explain the echoes of a recording.

The first guess of the floor is from pairs of echoes of one ping.

An object's echo over the floor trails its direct one.  With r the direct leg and u that over the
floor, u² − r² = (2 h)²: every pair of echoes votes for a height, and true pairs agree whatever
the object's range.  The corner between the floor and an upright object is √(r² + h²) away, where
u² − r² = h².
"""

from dataclasses import dataclass, replace

import numpy as np

from usmap_ros.acoustics.propagation import FloorModel
from usmap_ros.calibration.echo_table import EchoTable
from usmap_ros.calibration.fit import (
    OFFSET,
    SLOWNESS,
    UNKNOWN_SLOWNESS,
    EchoMatches,
    FittedModel,
    Model,
    fit,
)
from usmap_ros.calibration.objects import associate, find_objects
from usmap_ros.calibration.target import WIDEST_OFFSET_M, Target
from usmap_ros.errors import UsmapError
from usmap_ros.numerics.arrays import BoolArray, FloatArray, IndexArray

#: Heights (m) that votes may be for, and half the width of the window in which they agree.
_HEIGHTS_M = (0.05, 3.0)
_VOTE_HALF_WIDTH_M = 0.008
#: Votes that make a floor, per ping with echoes, and how far they rise above those of chance.
_LEAST_VOTES = 0.25
_LEAST_CONTRAST = 2.5
#: How far an echo may be from where another's path over the floor is expected.
_GATE_M = 0.012
#: How far echoes may be from where they are expected, from one fit to the next: after the
#: first search for objects, and after the second.
_FIRST_GATES_M = (0.05, 0.04, 0.03)
_GATES_M = (0.03, 0.02, 0.02, 0.02)
#: Echoes that an object must have.
LEAST_ECHOES = 6
#: How well sound speed and offset must be known to be used.
SPEED_STD_M_S = 0.5
OFFSET_STD_M = 0.004
#: Range offsets of most sensors: standard deviation around 0.
_USUAL_OFFSET_M = 0.02
#: Window that a target's echoes share, and the share of the pings towards it that must be in it.
_TARGET_WINDOW_M = 0.02
_TARGET_SHARE = 0.3
#: Deviations beyond which an echo is not accounted for.
_ACCOUNTED = 3.0


def guess_floor_m(table: EchoTable, floor_model: FloorModel) -> float | None:
    """Height of the transducers above the floor; None where no floor is heard.

    Parameters
    ----------
    table : EchoTable
        All echoes of the recording, with poses and pings.
    floor_model : FloorModel
        How it would return sound.
    """
    heights_m = np.concatenate([np.zeros(0), *_votes(table, floor_model)])
    heights_m = np.sort(heights_m[(heights_m > _HEIGHTS_M[0]) & (heights_m < _HEIGHTS_M[1])])
    if len(heights_m) == 0:
        return None
    width_m = 2.0 * _VOTE_HALF_WIDTH_M
    count = np.searchsorted(heights_m, heights_m + width_m, side="right")
    count -= np.arange(len(heights_m))
    first = int(np.argmax(count))
    most = int(count[first])
    # What chance would bring together there: the mean over a window ten times as wide.
    wide = np.abs(heights_m - heights_m[first] - _VOTE_HALF_WIDTH_M) <= 10.0 * _VOTE_HALF_WIDTH_M
    by_chance = (np.count_nonzero(wide) - most) / 9.0
    pings_with_echoes = np.count_nonzero(np.diff(table.first_echo))
    if most < max(_LEAST_VOTES * pings_with_echoes, _LEAST_CONTRAST * by_chance, 4.0):
        return None
    return float(np.median(heights_m[first : first + most]))


def _votes(table: EchoTable, floor_model: FloorModel) -> list[FloatArray]:
    """Heights that the pairs of echoes of each ping would mean."""
    votes = []
    for ping in range(table.ping_count):
        echoes = table.echoes_of(ping)
        range_m = table.ranges_m[echoes]
        amplitude = table.amplitudes[echoes]
        direct, later = np.triu_indices(len(range_m), 1)
        leg_m = np.maximum(range_m[direct], 0.0)
        # One way over the floor an echo is (r + u) / 2 away, both ways u; the floor adds two of
        # the former to each object, and neither is louder than the object by itself.
        quieter = amplitude[later] < 2.0 * amplitude[direct]
        if floor_model is FloorModel.CORNER:
            squared = np.maximum(range_m[later] ** 2 - leg_m**2, 0.0)
            votes.append(np.sqrt(squared[quieter]))
            continue
        for over_m in (2.0 * range_m[later] - leg_m, range_m[later]):
            squared = np.maximum(over_m**2 - leg_m**2, 0.0)
            votes.append(0.5 * np.sqrt(squared[quieter]))
    return votes


def direct_echoes(table: EchoTable, floor_m: float | None, floor_model: FloorModel) -> BoolArray:
    """Which echoes no earlier one of the same ping explains by way of the floor, (echoes,)."""
    direct = np.ones(len(table.ranges_m), dtype=bool)
    if floor_m is None:
        return direct
    for ping in range(table.ping_count):
        echoes = table.echoes_of(ping)
        explained = np.zeros(0)
        for index, range_m in enumerate(table.ranges_m[echoes], echoes.start):
            if len(explained) and np.abs(explained - range_m).min() < _GATE_M:
                direct[index] = False
                continue
            if floor_model is FloorModel.CORNER:
                explained = np.append(explained, np.hypot(range_m, floor_m))
                continue
            over_m = np.hypot(range_m, 2.0 * floor_m)
            explained = np.append(explained, [0.5 * (range_m + over_m), over_m])
    return direct


@dataclass(frozen=True)
class Start:
    """What the search for explanations starts with."""

    target: Target | None
    slowness: float
    offset_m: float
    slowness_std: float = UNKNOWN_SLOWNESS


@dataclass(frozen=True)
class Explained:
    """Echoes, where they came from, and the model that says so."""

    table: EchoTable
    matches: EchoMatches
    fit: FittedModel


def guess_from(table: EchoTable, target: Target, slownesses: FloatArray) -> tuple[float, float]:
    """Slowness, of those given, and offset (m) at which most echoes come from the target.

    Raises
    ------
    UsmapError
        If too few pings have an echo there whatever they are.
    """
    place_m = np.array([target.x_m, target.y_m])
    distances_m, ranges_m, towards = [np.zeros(0)], [np.zeros(0)], 0
    for ping, transducer in enumerate(table.transducers):
        distance_m, bearing_rad = table.polar(ping, place_m)
        distance_m = distance_m - target.radius_m
        in_cone = np.abs(bearing_rad) < transducer.beam.half_angle_rad
        if in_cone and transducer.min_range_m < distance_m < transducer.max_range_m:
            towards += 1
            heard_m = table.ranges_m[table.echoes_of(ping)]
            ranges_m.append(heard_m)
            distances_m.append(np.full(len(heard_m), distance_m))
    distance_m, range_m = np.concatenate(distances_m), np.concatenate(ranges_m)
    best, guess = 0, (1.0, 0.0)
    for slowness in slownesses:
        offsets = np.sort(range_m / slowness - distance_m)
        offsets = offsets[np.abs(offsets) < WIDEST_OFFSET_M]
        count = np.searchsorted(offsets, offsets + _TARGET_WINDOW_M, side="right")
        count -= np.arange(len(offsets))
        if count.max(initial=0) > best:
            first = int(np.argmax(count))
            best = int(count[first])
            guess = (float(slowness), float(np.median(offsets[first : first + best])))
    if best < max(LEAST_ECHOES, _TARGET_SHARE * towards):
        raise UsmapError(
            f"target: no object was heard at x {target.x_m:g} m, y {target.y_m:g} m"
            f" ({towards} of {table.ping_count} pings are towards it), nor within"
            f" {WIDEST_OFFSET_M:g} m before or behind it: is its place right, and"
            " start_delay_s?"
        )
    return guess


def best_explained(table: EchoTable, start: Start) -> Explained:
    """The better of two explanations: a floor that mirrors objects, or has corners with them."""
    believed = table.read_as(start.slowness, start.offset_m)

    def explained(floor_m: float | None, floor_model: FloorModel) -> Explained:
        return _explained(table, start, floor_m, floor_model)

    image = explained(guess_floor_m(believed, FloorModel.IMAGE), FloorModel.IMAGE)
    corner_m = guess_floor_m(believed, FloorModel.CORNER)
    if corner_m is None:
        return image
    corner = explained(corner_m, FloorModel.CORNER)
    return corner if _worth(corner) > _worth(image) else image


def _worth(explained: Explained) -> float:
    """How many echoes an explanation accounts for, less those that should have been heard too.

    In a mirror sound that goes over the floor one way is louder than what does both ways: where
    only the fainter one is heard, it is neither.
    """
    matches = explained.matches
    accounted = np.maximum(0.0, 1.0 - (explained.fit.deviations / _ACCOUNTED) ** 2).sum()
    causes = explained.table.pings[matches.echoes] * len(explained.fit.model.places_m)
    causes = causes + matches.objects
    missing = np.setdiff1d(causes[matches.paths == 2], causes[matches.paths == 1])
    return float(accounted) - len(missing)


def _explained(
    table: EchoTable, start: Start, floor_m: float | None, floor_model: FloorModel
) -> Explained:
    """Objects that explain the echoes, and the model of all their ranges."""
    believed = table.read_as(start.slowness, start.offset_m)
    model = Model(
        start.slowness,
        start.offset_m,
        floor_m,
        places_m=np.zeros((0, 2)),
        radii_m=np.zeros(0),
        is_fixed=np.zeros(0, dtype=np.bool_),
        floor_model=floor_model,
        slowness_std=start.slowness_std,
    )
    target = start.target
    if target is not None:
        place_m = np.array([[target.x_m, target.y_m]])
        model = model.with_objects(place_m, np.array([target.radius_m]), is_fixed=True)
    candidates = np.flatnonzero(direct_echoes(believed, floor_m, floor_model))
    model, _, matches = _searched(table, model, candidates, _FIRST_GATES_M)
    # Of what is left, more objects may be found by what is now known of sound speed and offset.
    believed = table.read_as(model.slowness, model.offset_m)
    candidates = np.flatnonzero(direct_echoes(believed, model.floor_m, floor_model))
    candidates = np.setdiff1d(candidates, matches.echoes)
    model, found, matches = _searched(table, model, candidates, _GATES_M)
    told = found.stds[OFFSET] <= OFFSET_STD_M
    if not told and speed_std_m_s(table, found) > SPEED_STD_M_S:
        # Sound speed and offset share the blame for a range.  What is left to be told of the one
        # if the other is what it is like?
        usual = fit(table, matches, model, offset_std_m=_USUAL_OFFSET_M)
        found = usual.with_offset_of(found)
    return Explained(table, matches, found)


def _searched(
    table: EchoTable, model: Model, candidates: IndexArray, gates_m: tuple[float, ...]
) -> tuple[Model, FittedModel, EchoMatches]:
    """Look for more objects among the echoes that are `candidates`, and fit all of them."""
    places_m = find_objects(table.read_as(model.slowness, model.offset_m), candidates)
    model = model.with_objects(places_m, np.zeros(len(places_m)), is_fixed=False)
    matches, model = _matched(table, model, gates_m[0])
    found = fit(table, matches, model)
    for gate_m in gates_m[1:]:
        matches, model = _matched(table, found.model, gate_m)
        found = fit(table, matches, model)
    return found.model, found, matches


def _matched(table: EchoTable, model: Model, gate_m: float) -> tuple[EchoMatches, Model]:
    """Match echoes anew, and drop objects that too few are left of."""
    model, matches = associate(table, model, gate_m)
    counts = np.bincount(matches.objects, minlength=len(model.places_m))
    kept = (counts >= LEAST_ECHOES) | model.is_fixed
    renumbered = np.cumsum(kept) - 1
    matches = matches.where(kept[matches.objects])
    matches = replace(matches, objects=renumbered[matches.objects])
    return matches, model.having(np.flatnonzero(kept))


def speed_std_m_s(table: EchoTable, found: FittedModel) -> float:
    """Standard deviation of the sound speed, m/s."""
    return float(table.stated.sound_speed_m_s * found.stds[SLOWNESS])
