"""From the traces of a recording to a calibration."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import chain, islice

import numpy as np

from usmap_ros.acoustics.propagation import FloorModel
from usmap_ros.arrays import FloatArray, IndexArray
from usmap_ros.calibration.fit import (
    HEIGHT,
    OFFSET,
    SLOWNESS,
    UNKNOWN_SLOWNESS,
    FittedModel,
    Matches,
    Model,
    fit,
)
from usmap_ros.calibration.floor import direct_echoes, guess_floor_m
from usmap_ros.calibration.hearing import Hearing, listen
from usmap_ros.calibration.loudness import (
    floor_reflectivity,
    gain_from_echoes,
    gain_from_population,
    gain_from_target,
    log_reflectivities,
)
from usmap_ros.calibration.objects import associate, find_objects
from usmap_ros.calibration.pulse import measure_pulse
from usmap_ros.calibration.result import Calibration, Estimate, Target
from usmap_ros.errors import UsmapError
from usmap_ros.parameters import PipelineParameters
from usmap_ros.trace import EchoTrace

#: How far echoes may be from where they are expected, from one fit to the next: after the
#: first search for objects, and after the second.
_FIRST_GATES_M = (0.05, 0.04, 0.03)
_GATES_M = (0.03, 0.02, 0.02, 0.02)
#: Echoes that an object must have.
_LEAST_ECHOES = 6
#: How well a quantity must be known to be used.
_SPEED_STD_M_S = 0.5
#: Standard deviation of c₀ / c where the stated speed is held to.
_AS_STATED = 1e-6
_OFFSET_STD_M = 0.004
_HEIGHT_STD_M = 0.01
#: Range offsets of most sensors: standard deviation around 0.
_USUAL_OFFSET_M = 0.02
#: Residuals, in standard deviations, of what is no point: its ranges tell no offset.
_POINT_LIKE = 2.0
#: c₀ / c and widest offset that a target is looked for at, the window that its echoes share, and
#: the share of the pings towards it that must be in it.
_TARGET_SLOWNESSES = np.linspace(0.94, 1.06, 25)
_WIDEST_OFFSET_M = 0.3
_TARGET_WINDOW_M = 0.02
_TARGET_SHARE = 0.3
#: Objects and echoes without one over a floor from which on there is none.
_OBJECTS_WITHOUT_FLOOR, _ECHOES_WITHOUT_FLOOR = 2, 30
#: Deviations beyond which an echo is not accounted for.
_ACCOUNTED = 3.0
#: Pings on which the pulse is measured.
_PULSE_PINGS = 400
_TOO_FEW_PLACES = "objects were not heard from enough places"
_NO_FLOOR = "no echo over a floor was heard"
_NOTHING = Estimate(np.nan, np.nan, "no standing object was heard from enough places")


@dataclass(frozen=True)
class _Start:
    """What the search for explanations starts with."""

    target: Target | None
    slowness: float
    offset_m: float
    slowness_std: float = UNKNOWN_SLOWNESS


@dataclass(frozen=True)
class _Explained:
    """Echoes, where they came from, and the model that says so."""

    hearing: Hearing
    matches: Matches
    fit: FittedModel


def calibrate(
    traces: Iterable[EchoTrace],
    parameters: PipelineParameters | None = None,
    target: Target | None = None,
) -> Calibration:
    """Estimate what a recording tells of sound speed, range offset, floor and gain.

    Parameters
    ----------
    traces : iterable of EchoTrace
        Of transducers of one kind that move among standing objects, in the order of their stamps.
    parameters : PipelineParameters, optional
        How echoes are found, and which reflectivities are expected.
    target : Target, optional
        An object that is known.

    Raises
    ------
    UsmapError
        If there is no echo, or none of the target.
    """
    parameters = parameters or PipelineParameters()
    remaining = iter(traces)
    first = list(islice(remaining, _PULSE_PINGS))
    pulse, reconstruction = None, parameters.reconstruction
    if reconstruction.pulse.kind == "stated":
        pulse = measure_pulse(first, reconstruction)
        if pulse is not None and pulse.is_told:
            found = {"pulse": pulse.parameters, "model_error": pulse.model_error}
            reconstruction = reconstruction.model_copy(update=found)
    hearing = listen(chain(first, remaining), reconstruction)
    if hearing is None or len(hearing.ranges_m) == 0:
        raise UsmapError("no echo was heard: nothing can be calibrated")
    guess = (1.0, 0.0) if target is None else _guess_from(hearing, target, _TARGET_SLOWNESSES)
    explained = _best_explained(hearing, _Start(target, *guess))
    speed = _sound_speed(explained)
    if target is not None and not speed.is_told:
        explained = _at_stated_speed(hearing, target) or explained
    return Calibration(
        sound_speed_m_s=speed,
        range_offset_m=_range_offset(explained, target),
        floor_height_m=_floor_height(explained),
        floor_reflectivity=_floor_reflectivity(explained),
        gain=_gain(explained, parameters, target),
        pings=hearing.ping_count,
        echoes=len(explained.matches.echoes),
        objects=len(explained.fit.model.places_m),
        floor_model=explained.fit.model.floor_model,
        pulse=pulse,
    )


def _at_stated_speed(hearing: Hearing, target: Target) -> _Explained | None:
    """What a target tells where the sound speed stays as stated, for want of ranges to tell it.

    An offset found together with another speed would be wrong with this one. None if too few
    echoes come from the target then.
    """
    try:
        guess = _guess_from(hearing, target, np.ones(1))
    except UsmapError:
        return None
    return _best_explained(hearing, _Start(target, *guess, slowness_std=_AS_STATED))


def _guess_from(hearing: Hearing, target: Target, slownesses: FloatArray) -> tuple[float, float]:
    """Slowness, of those given, and offset (m) at which most echoes come from the target.

    Raises
    ------
    UsmapError
        If too few pings have an echo there whatever they are.
    """
    place_m = np.array([target.x_m, target.y_m])
    distances_m, ranges_m, towards = [np.zeros(0)], [np.zeros(0)], 0
    for ping, transducer in enumerate(hearing.transducers):
        distance_m, bearing_rad = hearing.polar(ping, place_m)
        distance_m = distance_m - target.radius_m
        in_cone = np.abs(bearing_rad) < transducer.beam.half_angle_rad
        if in_cone and transducer.min_range_m < distance_m < transducer.max_range_m:
            towards += 1
            heard_m = hearing.ranges_m[hearing.echoes_of(ping)]
            ranges_m.append(heard_m)
            distances_m.append(np.full(len(heard_m), distance_m))
    distance_m, range_m = np.concatenate(distances_m), np.concatenate(ranges_m)
    best, guess = 0, (1.0, 0.0)
    for slowness in slownesses:
        offsets = np.sort(range_m / slowness - distance_m)
        offsets = offsets[np.abs(offsets) < _WIDEST_OFFSET_M]
        count = np.searchsorted(offsets, offsets + _TARGET_WINDOW_M, side="right")
        count -= np.arange(len(offsets))
        if count.max(initial=0) > best:
            first = int(np.argmax(count))
            best = int(count[first])
            guess = (float(slowness), float(np.median(offsets[first : first + best])))
    if best < max(_LEAST_ECHOES, _TARGET_SHARE * towards):
        raise UsmapError(
            f"target: no object was heard at x {target.x_m:g} m, y {target.y_m:g} m"
            f" ({towards} of {hearing.ping_count} pings are towards it)"
        )
    return guess


def _best_explained(hearing: Hearing, start: _Start) -> _Explained:
    """The better of two explanations: a floor that mirrors objects, or has corners with them."""
    believed = hearing.read_as(start.slowness, start.offset_m)

    def explained(floor_m: float | None, floor_model: FloorModel) -> _Explained:
        return _explained(hearing, start, floor_m, floor_model)

    image = explained(guess_floor_m(believed, FloorModel.IMAGE), FloorModel.IMAGE)
    corner_m = guess_floor_m(believed, FloorModel.CORNER)
    if corner_m is None:
        return image
    corner = explained(corner_m, FloorModel.CORNER)
    return corner if _worth(corner) > _worth(image) else image


def _worth(explained: _Explained) -> float:
    """How many echoes an explanation accounts for, less those that should have been heard too.

    In a mirror sound that goes over the floor one way is louder than what does both ways: where
    only the fainter one is heard, it is neither.
    """
    matches = explained.matches
    accounted = np.maximum(0.0, 1.0 - (explained.fit.deviations / _ACCOUNTED) ** 2).sum()
    causes = explained.hearing.pings[matches.echoes] * len(explained.fit.model.places_m)
    causes = causes + matches.objects
    missing = np.setdiff1d(causes[matches.paths == 2], causes[matches.paths == 1])
    return float(accounted) - len(missing)


def _explained(
    hearing: Hearing, start: _Start, floor_m: float | None, floor_model: FloorModel
) -> _Explained:
    """Objects that explain the echoes, and the model of all their ranges."""
    believed = hearing.read_as(start.slowness, start.offset_m)
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
    model, _, matches = _searched(hearing, model, candidates, _FIRST_GATES_M)
    # Of what is left, more objects may be found by what is now known of sound speed and offset.
    believed = hearing.read_as(model.slowness, model.offset_m)
    candidates = np.flatnonzero(direct_echoes(believed, model.floor_m, floor_model))
    candidates = np.setdiff1d(candidates, matches.echoes)
    model, found, matches = _searched(hearing, model, candidates, _GATES_M)
    told = found.stds[OFFSET] <= _OFFSET_STD_M
    if not told and _speed_std_m_s(hearing, found) > _SPEED_STD_M_S:
        # Sound speed and offset share the blame for a range.  What is left to be told of the one
        # if the other is what it is like?
        usual = fit(hearing, matches, model, offset_std_m=_USUAL_OFFSET_M)
        found = usual.with_offset_of(found)
    return _Explained(hearing, matches, found)


def _searched(
    hearing: Hearing, model: Model, candidates: IndexArray, gates_m: tuple[float, ...]
) -> tuple[Model, FittedModel, Matches]:
    """Look for more objects among the echoes that are `candidates`, and fit all of them."""
    places_m = find_objects(hearing.read_as(model.slowness, model.offset_m), candidates)
    model = model.with_objects(places_m, np.zeros(len(places_m)), is_fixed=False)
    matches, model = _matched(hearing, model, gates_m[0])
    found = fit(hearing, matches, model)
    for gate_m in gates_m[1:]:
        matches, model = _matched(hearing, found.model, gate_m)
        found = fit(hearing, matches, model)
    return found.model, found, matches


def _matched(hearing: Hearing, model: Model, gate_m: float) -> tuple[Matches, Model]:
    """Match echoes anew, and drop objects that too few are left of."""
    model, matches = associate(hearing, model, gate_m)
    counts = np.bincount(matches.objects, minlength=len(model.places_m))
    kept = (counts >= _LEAST_ECHOES) | model.is_fixed
    renumbered = np.cumsum(kept) - 1
    matches = matches.where(kept[matches.objects])
    matches = replace(matches, objects=renumbered[matches.objects])
    return matches, model.having(np.flatnonzero(kept))


def _speed_std_m_s(hearing: Hearing, found: FittedModel) -> float:
    return float(hearing.stated.sound_speed_m_s * found.stds[SLOWNESS])


def _sound_speed(explained: _Explained) -> Estimate:
    found = explained.fit
    value = explained.hearing.stated.sound_speed_m_s / found.model.slowness
    std = _speed_std_m_s(explained.hearing, found)
    if not len(found.model.places_m):
        return _NOTHING
    untold = "" if std <= _SPEED_STD_M_S else _TOO_FEW_PLACES
    return Estimate(value, std, untold)


def _range_offset(explained: _Explained, target: Target | None) -> Estimate:
    found = explained.fit
    if not len(found.model.places_m):
        return _NOTHING
    std = float(found.stds[OFFSET])
    spread = 1.4826 * float(np.median(np.abs(found.deviations)))
    if std > _OFFSET_STD_M:
        untold = _TOO_FEW_PLACES
    elif target is None and spread > _POINT_LIKE:
        untold = "what was heard is wider than a point: name a target"
    else:
        untold = ""
    return Estimate(found.model.offset_m, std, untold)


def _floor_height(explained: _Explained) -> Estimate:
    found, matches = explained.fit, explained.matches
    if found.model.floor_m is None:
        enough = len(found.model.places_m) >= _OBJECTS_WITHOUT_FLOOR
        if (
            explained.hearing.stated.has_floor
            and enough
            and len(matches.echoes) >= _ECHOES_WITHOUT_FLOOR
        ):
            return Estimate(0.0, 0.0)
        return Estimate(np.nan, np.nan, _NO_FLOOR)
    over_floor = np.count_nonzero(matches.paths > 0)
    std = float(found.stds[HEIGHT])
    untold = ""
    if over_floor < _LEAST_ECHOES or std > _HEIGHT_STD_M:
        untold = "too few echoes over the floor were heard clearly"
    return Estimate(found.model.floor_m, std, untold)


def _floor_reflectivity(explained: _Explained) -> Estimate:
    hearing, found = explained.hearing, explained.fit
    return floor_reflectivity(hearing, explained.matches, found.model, hearing.stated)


def _gain(explained: _Explained, parameters: PipelineParameters, target: Target | None) -> Estimate:
    hearing, model = explained.hearing, explained.fit.model
    log_seen, objects = log_reflectivities(hearing, explained.matches, model, hearing.stated)
    if target is not None and target.reflectivity is not None:
        return gain_from_target(log_seen[objects == 0], target.reflectivity)
    if len(model.places_m):
        return gain_from_population(log_seen, objects, parameters.mapping)
    return gain_from_echoes(hearing, hearing.stated, parameters.mapping)
