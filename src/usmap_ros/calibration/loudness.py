"""How loud echoes are beside what was expected: gain, and reflectivity of the floor."""

import numpy as np

from usmap_ros.acoustics.propagation import Channel, FloorModel
from usmap_ros.calibration.echo_table import EchoTable
from usmap_ros.calibration.fit import EchoMatches, Model
from usmap_ros.calibration.result import Estimate
from usmap_ros.numerics.arrays import FloatArray, IndexArray
from usmap_ros.parameters import MappingParameters

#: Amplitudes are used if noise and neighbours leave them this sure, and the beam hears them well.
_LARGEST_RELATIVE_STD = 0.25
_LEAST_BEAM_GAIN = 0.25
#: Echoes that tell anything.
_LEAST_ECHOES = 5
#: Spread of ln beam gain where the bearing is not known, and the gain that is then supposed.
_UNKNOWN_BEARING_SPREAD = 0.7
_UNKNOWN_BEARING_GAIN = 0.5
#: Standard deviation of ln gain that is good enough, and how many of them make up for more.
_GOOD_LOG_STD = 0.115
_BEYOND_DOUBT = 2.0
#: Of ln reflectivity from look to look, for an object that stands still.
_FLUCTUATION = 0.05
_LARGEST_REFLECTIVITY_STD = 0.1


def log_reflectivities(
    table: EchoTable, matches: EchoMatches, model: Model, channel: Channel
) -> tuple[FloatArray, IndexArray]:
    """Ln of the reflectivity that direct echoes mean, in units of the samples, and their objects.

    Only echoes that are loud, clear and well inside the beam.
    """
    matches = matches.where(matches.paths == 0)
    echoes, pings = matches.echoes, table.pings[matches.echoes]
    gains, ranges = np.zeros(len(echoes)), np.zeros(len(echoes))
    for ping in np.unique(pings):
        mine = np.flatnonzero(pings == ping)
        range_m, bearing_rad = table.polar(int(ping), model.places_m[matches.objects[mine]])
        gains[mine] = table.transducers[ping].beam.gain(bearing_rad)
        ranges[mine] = np.maximum(range_m - model.radii_m[matches.objects[mine]], 0.01)
    amplitudes = table.amplitudes[echoes]
    clear = (gains > _LEAST_BEAM_GAIN) & (amplitudes > 0.0)
    clear &= table.amplitude_stds[echoes] < _LARGEST_RELATIVE_STD * amplitudes
    unit = gains[clear] * channel.amplitudes(ranges[clear])[:, 0]
    return np.log(amplitudes[clear] / unit), matches.objects[clear]


def gain_from_target(log_seen: FloatArray, reflectivity: float) -> Estimate:
    """Gain from echoes of an object whose reflectivity is known."""
    if len(log_seen) < _LEAST_ECHOES:
        return Estimate(np.nan, np.nan, "the target was not heard clearly enough")
    log_gain = float(np.median(log_seen)) - np.log(reflectivity)
    spread = np.hypot(_spread(log_seen), _FLUCTUATION)
    std = 1.2533 * spread / np.sqrt(len(log_seen))
    why_unknown = "" if std <= _GOOD_LOG_STD else "echoes of the target differ too much"
    return Estimate(float(np.exp(log_gain)), float(std), why_unknown)


def gain_from_population(
    log_seen: FloatArray, objects: IndexArray, mapping: MappingParameters
) -> Estimate:
    """Gain at which objects have the reflectivities that mapping expects.

    It cannot be better known than what objects are like: it serves to notice samples in other
    units, not to measure a gain.
    """
    if len(log_seen) < _LEAST_ECHOES:
        return Estimate(np.nan, np.nan, "too few echoes were heard clearly")
    each = np.array([np.median(log_seen[objects == one]) for one in np.unique(objects)])
    log_gain = float(np.median(each)) - np.log(mapping.reflectivity)
    spread = max(_spread(each), mapping.reflectivity_spread)
    std = float(np.hypot(mapping.reflectivity_spread, 1.2533 * spread / np.sqrt(len(each))))
    why_unknown = ""
    if abs(log_gain) < _BEYOND_DOUBT * std:
        why_unknown = (
            "within what is expected of unknown objects; --target with a reflectivity tells it"
        )
    return Estimate(float(np.exp(log_gain)), std, why_unknown)


def gain_from_echoes(table: EchoTable, channel: Channel, mapping: MappingParameters) -> Estimate:
    """`gain_from_population` where no object could be placed: bearings are not known."""
    clear = (table.amplitudes > 0.0) & (table.ranges_m > 0.0)
    unit = _UNKNOWN_BEARING_GAIN * channel.amplitudes(table.ranges_m[clear])[:, 0]
    wider = np.hypot(mapping.reflectivity_spread, _UNKNOWN_BEARING_SPREAD)
    return gain_from_population(
        np.log(table.amplitudes[clear] / unit),
        np.arange(np.count_nonzero(clear)),
        mapping.model_copy(update={"reflectivity_spread": float(wider)}),
    )


def floor_reflectivity(
    table: EchoTable, matches: EchoMatches, model: Model, channel: Channel
) -> Estimate:
    """Reflectivity of the floor, from echoes over it beside direct ones of the same ping."""
    if model.floor_m is None:
        return Estimate(np.nan, np.nan, "no echo over a floor was heard")
    clear = table.amplitude_stds[matches.echoes] < (
        _LARGEST_RELATIVE_STD * table.amplitudes[matches.echoes]
    )
    matches = matches.where(clear)
    keys = table.pings[matches.echoes] * len(model.places_m) + matches.objects
    direct = {int(key): index for index, key in enumerate(keys) if matches.paths[index] == 0}
    found, objects = [], []
    for index, path in enumerate(matches.paths):
        if path == 0 or int(keys[index]) not in direct:
            continue
        first = matches.echoes[direct[int(keys[index])]]
        place_m = model.places_m[matches.objects[index]]
        leg_m = float(table.polar(int(table.pings[first]), place_m)[0])
        is_corner = model.floor_model is FloorModel.CORNER
        over_m = float(np.hypot(leg_m, (1.0 if is_corner else 2.0) * model.floor_m))
        ratio = table.amplitudes[matches.echoes[index]] / table.amplitudes[first]
        # Of one leg over the floor; two paths share the length of the one-way echo.
        spread = leg_m / over_m * 10.0 ** (-channel.attenuation_db_m * (over_m - leg_m) / 20.0)
        if is_corner:
            found.append(0.5 * ratio / spread**2)
        else:
            found.append(0.5 * ratio / spread if path == 1 else np.sqrt(ratio) / spread)
        objects.append(int(matches.objects[index]))
    if len(found) < _LEAST_ECHOES:
        return Estimate(np.nan, np.nan, "too few echoes over the floor were heard clearly")
    values, owners = np.array(found), np.array(objects)
    each = np.array([np.median(values[owners == one]) for one in np.unique(owners)])
    std = 1.2533 * _spread(values) / np.sqrt(len(values))
    if len(each) > 1:
        std = max(std, 1.2533 * _spread(each) / np.sqrt(len(each)))
    why_unknown = (
        "" if std <= _LARGEST_REFLECTIVITY_STD else "echoes over the floor differ too much"
    )
    return Estimate(float(np.clip(np.median(values), 0.0, 1.0)), float(std), why_unknown)


def _spread(values: FloatArray) -> float:
    """Standard deviation of most of the values."""
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))
