"""From the traces of a recording to a calibration."""

from collections.abc import Iterable
from itertools import chain, islice

import numpy as np

from usmap_ros.calibration.echo_table import EchoTable, listen
from usmap_ros.calibration.explanation import (
    LEAST_ECHOES,
    OFFSET_STD_M,
    SPEED_STD_M_S,
    Explained,
    Start,
    best_explained,
    guess_from,
    speed_std_m_s,
)
from usmap_ros.calibration.fit import HEIGHT, OFFSET
from usmap_ros.calibration.loudness import (
    floor_reflectivity,
    gain_from_echoes,
    gain_from_population,
    gain_from_target,
    log_reflectivities,
)
from usmap_ros.calibration.pulse import measure_pulse
from usmap_ros.calibration.result import Calibration, Estimate
from usmap_ros.calibration.ringing import Ringing, ringing_of
from usmap_ros.calibration.target import Target
from usmap_ros.errors import UsmapError
from usmap_ros.parameters import PipelineParameters, ReconstructionParameters
from usmap_ros.pings.trace import EchoTrace

#: How well a floor height must be known to be used.
_HEIGHT_STD_M = 0.01
#: Standard deviation of c₀ / c where the stated speed is held to.
_AS_STATED = 1e-6
#: Residuals, in standard deviations, of what is no point: its ranges tell no offset.
_POINT_LIKE = 2.0
#: c₀ / c that a target is looked for at.
_TARGET_SLOWNESSES = np.linspace(0.94, 1.06, 25)
#: Objects and echoes without one over a floor from which on there is none.
_OBJECTS_WITHOUT_FLOOR, _ECHOES_WITHOUT_FLOOR = 2, 30
#: Pings on which the pulse is measured, and ringing is looked for.
_PULSE_PINGS, _RINGING_PINGS = 400, 150
_TOO_FEW_PLACES = "objects were not heard from enough places"
_NO_FLOOR = "no echo over a floor was heard"
_NOTHING = Estimate(np.nan, np.nan, "no standing object was heard from enough places")


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
        if pulse is not None and pulse.is_known:
            found = {"pulse": pulse.parameters, "model_error": pulse.model_error}
            reconstruction = reconstruction.model_copy(update=found)
    table = listen(chain(first, remaining), reconstruction)
    if table is None or len(table.ranges_m) == 0:
        raise UsmapError("no echo was heard: nothing can be calibrated")
    ringing = _ringing(first, reconstruction, 0.0, target)
    if ringing is not None:
        table = table.without(ringing.accounts_for(table))
    guess, remarks = (1.0, 0.0), tuple[str, ...]()
    if target is not None:
        try:
            guess = guess_from(table, target, _TARGET_SLOWNESSES)
        except UsmapError as error:
            if pulse is None or not pulse.is_known:
                raise
            # The pulse is worth having by itself.
            target, remarks = None, (str(error),)
    explained = best_explained(table, Start(target, *guess))
    speed = _sound_speed(explained)
    if target is not None and not speed.is_known:
        explained = _at_stated_speed(table, target) or explained
    return Calibration(
        sound_speed_m_s=speed,
        range_offset_m=_range_offset(explained, target),
        floor_height_m=_floor_height(explained),
        floor_reflectivity=_floor_reflectivity(explained),
        gain=_gain(explained, parameters, target),
        pings=table.ping_count,
        echoes=len(explained.matches.echoes),
        objects=len(explained.fit.model.places_m),
        floor_model=explained.fit.model.floor_model,
        pulse=pulse,
        ringing=_ringing(first, reconstruction, explained.fit.model.offset_m, target),
        stated_speed_m_s=table.stated.sound_speed_m_s,
        remarks=remarks,
    )


def _ringing(
    traces: list[EchoTrace],
    parameters: ReconstructionParameters,
    offset_m: float,
    target: Target | None,
) -> Ringing | None:
    """What the transducer hears of itself; None if there are several, or no target to tell it from.

    Where ranges come out too short by an offset below 0, the transducer's least range does too.
    """
    if target is None:
        return None
    nearer_m = max(0.0, -offset_m)
    return ringing_of(traces, parameters, target, pings=_RINGING_PINGS, nearer_m=nearer_m)


def _at_stated_speed(table: EchoTable, target: Target) -> Explained | None:
    """What a target tells where the sound speed stays as stated, for want of ranges to tell it.

    An offset found together with another speed would be wrong with this one. None if too few
    echoes come from the target then.
    """
    try:
        guess = guess_from(table, target, np.ones(1))
    except UsmapError:
        return None
    return best_explained(table, Start(target, *guess, slowness_std=_AS_STATED))


def _sound_speed(explained: Explained) -> Estimate:
    found = explained.fit
    value = explained.table.stated.sound_speed_m_s / found.model.slowness
    std = speed_std_m_s(explained.table, found)
    if not len(found.model.places_m):
        return _NOTHING
    why_unknown = "" if std <= SPEED_STD_M_S else _TOO_FEW_PLACES
    return Estimate(value, std, why_unknown)


def _range_offset(explained: Explained, target: Target | None) -> Estimate:
    found = explained.fit
    if not len(found.model.places_m):
        return _NOTHING
    std = float(found.stds[OFFSET])
    spread = 1.4826 * float(np.median(np.abs(found.deviations)))
    if std > OFFSET_STD_M:
        why_unknown = _TOO_FEW_PLACES
    elif target is None and spread > _POINT_LIKE:
        why_unknown = "what was heard is wider than a point: name a target"
    else:
        why_unknown = ""
    return Estimate(found.model.offset_m, std, why_unknown)


def _floor_height(explained: Explained) -> Estimate:
    found, matches = explained.fit, explained.matches
    if found.model.floor_m is None:
        enough = len(found.model.places_m) >= _OBJECTS_WITHOUT_FLOOR
        if (
            explained.table.stated.has_floor
            and enough
            and len(matches.echoes) >= _ECHOES_WITHOUT_FLOOR
        ):
            return Estimate(0.0, 0.0)
        return Estimate(np.nan, np.nan, _NO_FLOOR)
    over_floor = np.count_nonzero(matches.paths > 0)
    std = float(found.stds[HEIGHT])
    why_unknown = ""
    if over_floor < LEAST_ECHOES or std > _HEIGHT_STD_M:
        why_unknown = "too few echoes over the floor were heard clearly"
    return Estimate(found.model.floor_m, std, why_unknown)


def _floor_reflectivity(explained: Explained) -> Estimate:
    table, found = explained.table, explained.fit
    return floor_reflectivity(table, explained.matches, found.model, table.stated)


def _gain(explained: Explained, parameters: PipelineParameters, target: Target | None) -> Estimate:
    table, model = explained.table, explained.fit.model
    log_seen, objects = log_reflectivities(table, explained.matches, model, table.stated)
    if target is not None and target.reflectivity is not None:
        return gain_from_target(log_seen[objects == 0], target.reflectivity)
    if len(model.places_m):
        return gain_from_population(log_seen, objects, parameters.mapping)
    return gain_from_echoes(table, table.stated, parameters.mapping)
