"""Which echoes come from the same standing object, and where it stands."""

import numpy as np

from usmap_ros.calibration.echo_table import EchoTable
from usmap_ros.calibration.fit import EchoMatches, Model
from usmap_ros.numerics.arrays import BoolArray, FloatArray, IndexArray

#: Bearings at which an echo's object is first supposed: their step, and the widest.
_BEARING_STEP_RAD = 0.035
_WIDEST_RAD = 1.0
#: Share of the cone, from its axis, in which an object is expected to be heard.
_SURELY_HEARD = 0.8
#: Pings that must have heard an object, and share of those that should have.
_LEAST_HEARD = 6
_LEAST_SHARE = 0.6
#: How far apart (m) two pings must be at least for an object to be placed by them.
_LEAST_BASELINE_M = 0.15
#: How well one place must explain ranges, beside the errors that are known (m).
_PLACE_GATE_M = 0.025
_PLACED_RMS_M = 0.008
#: Echoes that are tried as the first of an object.
_MOST_TRIED = 1500
#: Objects are one if they share more than this part of the echoes of either.
_SHARED = 0.5


def find_objects(table: EchoTable, candidates: IndexArray) -> FloatArray:
    """Places (objects, 2) of objects that several pings on a stretch of path heard.

    Sound speed and offset may be off: over a short stretch, what they are is all but absorbed by
    the place.

    Parameters
    ----------
    table : EchoTable
        All echoes of the recording, with poses and pings.
    candidates : (n,) integer array
        Echoes that are to be explained by objects.
    """
    free = np.zeros(len(table.ranges_m), dtype=bool)
    free[candidates] = True
    tried = candidates
    if len(tried) > _MOST_TRIED:
        tried = tried[np.linspace(0, len(tried) - 1, _MOST_TRIED).astype(np.intp)]
    places = []
    for echo in tried:
        if not free[echo]:
            continue
        found = _object_of(table, int(echo), free)
        if found is not None:
            place_m, echoes = found
            free[echoes] = False
            places.append(place_m)
    return np.array(places).reshape(-1, 2)


def _object_of(
    table: EchoTable, echo: int, free: BoolArray
) -> tuple[FloatArray, IndexArray] | None:
    """Place of the object that an echo came from, and its echoes on this stretch of path."""
    ping = int(table.pings[echo])
    around = table.neighbours(ping)
    if _extent_m(table.positions_m[around]) < _LEAST_BASELINE_M:
        return None
    widest = min(_WIDEST_RAD, table.transducers[ping].beam.half_angle_rad)
    bearings = table.yaws_rad[ping] + np.arange(-widest, widest, _BEARING_STEP_RAD)
    places = table.positions_m[ping] + table.ranges_m[echo] * np.stack(
        [np.cos(bearings), np.sin(bearings)], axis=-1
    )
    heard, expected = np.zeros(len(places)), np.zeros(len(places))
    for other in around:
        apart_m, _, sure = _nearest(table, int(other), places, free)
        gate_m = np.hypot(_PLACE_GATE_M, 2.0 * table.position_stds_m[other])
        heard += np.maximum(0.0, 1.0 - (apart_m / gate_m) ** 2)
        expected += sure
    best = int(np.argmax(heard - 0.5 * expected))
    return _placed(table, places[best], around, free)


def _nearest(
    table: EchoTable, ping: int, places_m: FloatArray, free: BoolArray
) -> tuple[FloatArray, IndexArray, BoolArray]:
    """How far each place is from explaining a free echo of a ping.

    Returns the distance from where its echo would be to the nearest one, that echo, and whether
    the ping is sure to have heard an object there.
    """
    distance_m, bearing_rad = table.polar(ping, places_m)
    transducer = table.transducers[ping]
    half_angle = transducer.beam.half_angle_rad
    within = (distance_m < transducer.max_range_m) & (distance_m > transducer.min_range_m)
    echoes = np.arange(len(free))[table.echoes_of(ping)]
    echoes = echoes[free[echoes]]
    sure = within & (np.abs(bearing_rad) < _SURELY_HEARD * half_angle)
    if len(echoes) == 0:
        return np.full(len(places_m), np.inf), np.zeros(len(places_m), dtype=np.intp), sure
    apart = np.abs(table.ranges_m[echoes] - distance_m[:, np.newaxis])
    nearest = apart.argmin(axis=1)
    apart_m = np.where(
        within & (np.abs(bearing_rad) <= half_angle),
        apart[np.arange(len(places_m)), nearest],
        np.inf,
    )
    return apart_m, echoes[nearest], sure


def _placed(
    table: EchoTable, place_m: FloatArray, around: IndexArray, free: BoolArray
) -> tuple[FloatArray, IndexArray] | None:
    """The place that explains the echoes around `place_m` best, if one does."""
    gates_m = np.hypot(_PLACE_GATE_M, 2.0 * table.position_stds_m[around])
    found, sure = [], 0
    for ping, gate_m in zip(around, gates_m, strict=True):
        apart_m, echo, is_sure = _nearest(table, int(ping), place_m[np.newaxis], free)
        sure += int(is_sure[0])
        if apart_m[0] < gate_m:
            found.append(int(echo[0]))
    echoes = np.array(found, dtype=np.intp)
    if len(echoes) < max(_LEAST_HEARD, _LEAST_SHARE * sure):
        return None
    positions_m = table.positions_m[table.pings[echoes]]
    if _extent_m(positions_m) < _LEAST_BASELINE_M:
        return None
    ranges_m = table.ranges_m[echoes]

    def misfit(place: FloatArray) -> FloatArray:
        errors: FloatArray = ranges_m - np.linalg.norm(positions_m - place, axis=1)
        return errors

    # Here, because it takes a third of a second, and to look at a recording it is not needed.
    from scipy.optimize import least_squares

    solution = least_squares(misfit, place_m, loss="soft_l1", f_scale=_PLACED_RMS_M)
    spread_m = 1.4826 * float(np.median(np.abs(misfit(solution.x))))
    allowed_m = np.hypot(_PLACED_RMS_M, 1.5 * float(np.median(table.position_stds_m[around])))
    if spread_m > allowed_m:
        return None
    return np.asarray(solution.x, dtype=float), echoes


def _extent_m(positions_m: FloatArray) -> float:
    """Length of the diagonal of the box around positions."""
    return float(np.linalg.norm(np.ptp(positions_m, axis=0))) if len(positions_m) else 0.0


def associate(table: EchoTable, model: Model, gate_m: float) -> tuple[Model, EchoMatches]:
    """Match every echo with the object and path that it fits, where only one does.

    Objects that would share most of their echoes are one: only the one with most of them is left.

    Parameters
    ----------
    table : EchoTable
        All echoes of the recording, with poses and pings.
    model : Model
        Where objects stand, and what the sound does.
    gate_m : float
        How far an echo may be from where it is expected, beside the errors that are known.
    """
    possible = _possible(table, model, gate_m)
    model = model.having(_different(possible, model.is_fixed))
    possible = _possible(table, model, gate_m)
    # What two may have caused, or what may have caused two, says nothing for sure.
    echo_count = np.bincount(possible.echoes)[possible.echoes]
    cause = table.pings[possible.echoes] * len(model.places_m) + possible.objects
    _, first, times = np.unique(
        cause * model.path_count + possible.paths, return_inverse=True, return_counts=True
    )
    return model, possible.where((echo_count == 1) & (times[first] == 1))


def _possible(table: EchoTable, model: Model, gate_m: float) -> EchoMatches:
    """All echoes, objects and paths that fit together."""
    found = [np.zeros((3, 0), dtype=np.intp)]
    for ping, transducer in enumerate(table.transducers):
        distance_m, bearing_rad = table.polar(ping, model.places_m)
        distance_m = distance_m - model.radii_m
        audible = np.flatnonzero(
            (np.abs(bearing_rad) < transducer.beam.half_angle_rad)
            & (distance_m > 0.0)
            & (distance_m < transducer.max_range_m)
        )
        expected_m = model.apparent_m(distance_m[audible]).reshape(-1)
        echoes = table.echoes_of(ping)
        apart_m = np.abs(table.ranges_m[echoes, np.newaxis] - expected_m)
        allowed_m = np.hypot(gate_m, 3.0 * table.position_stds_m[ping])
        echo, cause = np.nonzero(apart_m < allowed_m)
        which, path = np.divmod(cause, model.path_count)
        found.append(np.stack([echoes.start + echo, audible[which], path]))
    return EchoMatches(*np.concatenate(found, axis=1))


def _different(possible: EchoMatches, is_fixed: BoolArray) -> IndexArray:
    """Objects that are left when of those that share most of their echoes only one stays."""
    count = len(is_fixed)
    direct = possible.where(possible.paths == 0)
    echo_count = int(direct.echoes.max(initial=-1)) + 1
    ones = np.ones(len(direct.echoes))
    # Here, because it takes long to load.
    from scipy.sparse import csr_array

    heard = csr_array((ones, (direct.objects, direct.echoes)), shape=(count, echo_count))
    shared = (heard @ heard.T).toarray()
    own = np.diagonal(shared)
    kept: list[int] = []
    for one in np.lexsort((-own, ~is_fixed)):
        limit = _SHARED * np.minimum(own[one], own[kept])
        if is_fixed[one] or (own[one] > 0 and np.all(shared[one, kept] <= limit)):
            kept.append(int(one))
    return np.sort(np.array(kept, dtype=np.intp))
