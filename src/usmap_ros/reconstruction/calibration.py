"""Sound speed and floor from the echoes themselves.

The closed loop that Sanchez & Andersson (DSCC 2018-9140) leave for later: what the sensing
matrix takes for given is learnt from the recording that it is to explain.

An object's echo over the floor trails its direct one.  With t = τ₀ / 2 the time of the direct
leg and u that of the leg over the floor, u² − t² = (2 h / c)²: every pair of echoes votes for a
floor, and true pairs agree whatever the object's range.  The ratio of their amplitudes gives the
floor's reflectivity.  Delays alone cannot tell a fast medium from a small world; a robot that
knows how far it went can: the ranges of standing objects change by as much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from usmap_ros.acoustics.propagation import Channel
from usmap_ros.arrays import BoolArray, FloatArray
from usmap_ros.errors import UsmapError
from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.reconstruction.reconstructor import reconstruct
from usmap_ros.trace import EchoTrace

#: Heights (s of travel) that votes may be for, and their resolution.
_HEIGHTS_S = (2e-4, 1e-2)
_VOTE_WIDTH_S = 1.5e-5
#: Votes that make a floor, per trace.
_LEAST_VOTES = 0.3
#: Shortest track that counts, in pings, and how far an echo may be from where it is expected.
_LEAST_PINGS = 6
_GATE_S = 6e-5
#: Misfit of the ranges of a track above which no standing object explains it.
_PLACED_RMS_M = 0.02
#: Error of a range, and the relative error of the sound speed up to which it counts as told.
_RANGE_ERROR_M = 0.003
_LARGEST_SPEED_ERROR = 0.02
_TOO_FEW_PLACES = "no object was heard from enough places to tell the sound speed"
#: Bearings at which the position of a tracked object is first supposed.
_BEARINGS_RAD = (-0.4, -0.1, 0.1, 0.4)


@dataclass(frozen=True)
class _Ping:
    """Echoes of one ping without regard to a floor."""

    position_m: FloatArray
    yaw_rad: float
    delays_s: FloatArray
    amplitudes: FloatArray


def calibrate(
    traces: Sequence[EchoTrace], parameters: ReconstructionParameters | None = None
) -> Channel:
    """Estimate what the sound travelled through from traces of one robot.

    Parameters
    ----------
    traces : sequence of EchoTrace
        Of one transducer that moves among standing objects, in the order of their stamps.
    parameters : ReconstructionParameters, optional
        Of the reconstruction without a floor.

    Returns
    -------
    Channel
        With the attenuation that the traces state, and no floor if no echo speaks for one.

    Raises
    ------
    UsmapError
        If no object was heard from enough places to tell the sound speed.
    """
    parameters = parameters or ReconstructionParameters()
    stated = traces[0].channel
    pings = [_listen(trace, parameters) for trace in traces]
    floor = _floor(pings, stated)
    sound_speed = _sound_speed(pings, floor, stated.sound_speed_m_s)
    if floor is None:
        return Channel(sound_speed, stated.attenuation_db_m)
    height_s, reflectivity = floor
    return Channel(sound_speed, stated.attenuation_db_m, sound_speed * height_s, reflectivity)


def _listen(trace: EchoTrace, parameters: ReconstructionParameters) -> _Ping:
    """All echoes, those over the floor among them, as if each came from an object."""
    channel = replace(trace.channel, floor_height_m=0.0)
    # Paths over the floor arrive from beyond the largest range at which objects are looked for.
    transducer = replace(trace.transducer, max_range_m=1.5 * trace.transducer.max_range_m)
    cone = reconstruct(replace(trace, channel=channel, transducer=transducer), parameters).cone
    return _Ping(
        trace.pose.position_m[:2],
        trace.pose.yaw_rad,
        2.0 * cone.ranges_m.astype(float) / channel.sound_speed_m_s,
        cone.amplitudes.astype(float),
    )


def _floor(pings: list[_Ping], stated: Channel) -> tuple[float, float] | None:
    """Height over sound speed, and reflectivity; None where no floor is heard."""
    heights, reflectivities = [np.zeros(0)], [np.zeros(0)]
    for ping in pings:
        direct, later = np.triu_indices(len(ping.delays_s), 1)
        leg_s = 0.5 * ping.delays_s[direct]
        ratio = ping.amplitudes[later] / ping.amplitudes[direct]
        for ways in (1, 2):
            # One way over the floor, the delay is t + u; both ways, it is 2 u.
            over_s = ping.delays_s[later] - leg_s if ways == 1 else 0.5 * ping.delays_s[later]
            loss_db = 0.5 * ways * stated.attenuation_db_m * stated.sound_speed_m_s
            spread = (leg_s / over_s) ** ways * 10.0 ** (-loss_db * (over_s - leg_s) / 10.0)
            relative = ratio / spread
            heights.append(0.5 * np.sqrt(over_s**2 - leg_s**2))
            # Two paths share the length of the one-way echo.
            reflectivities.append(0.5 * relative if ways == 1 else np.sqrt(relative))
    height, reflectivity = np.concatenate(heights), np.concatenate(reflectivities)
    possible = (height > _HEIGHTS_S[0]) & (height < _HEIGHTS_S[1]) & (reflectivity <= 1.2)
    height, reflectivity = height[possible], reflectivity[possible]
    agreeing = _densest(height)
    if np.count_nonzero(agreeing) < _LEAST_VOTES * len(pings):
        return None
    return float(np.median(height[agreeing])), float(min(1.0, np.median(reflectivity[agreeing])))


def _densest(values: FloatArray) -> BoolArray:
    """Which values lie in the window that holds most of them."""
    ordered = np.sort(values)
    if len(ordered) == 0:
        return np.zeros(0, dtype=bool)
    count = np.searchsorted(ordered, ordered + 2.0 * _VOTE_WIDTH_S, side="right")
    first = int(np.argmax(count - np.arange(len(ordered))))
    inside: BoolArray = np.abs(values - ordered[first] - _VOTE_WIDTH_S) <= _VOTE_WIDTH_S
    return inside


def _sound_speed(pings: list[_Ping], floor: tuple[float, float] | None, stated_m_s: float) -> float:
    """Sound speed at which the ranges of standing objects change as the robot moves."""
    tracks = [track for track in _tracks(pings, floor, stated_m_s) if len(track) >= _LEAST_PINGS]
    placed = [_placed(pings, track, stated_m_s) for track in tracks]
    good = [(track, place) for track, place in zip(tracks, placed, strict=True) if place[2]]
    if not good:
        raise UsmapError(_TOO_FEW_PLACES)

    def misfit(unknown: FloatArray) -> FloatArray:
        speed, places = unknown[0] * stated_m_s, unknown[1:].reshape(-1, 2)
        return np.concatenate(
            [
                _range_errors(pings, track, place, speed)
                for (track, _), place in zip(good, places, strict=True)
            ]
        )

    start = np.concatenate([[1.0], *([place[:2] for _, place in good])])
    solution = least_squares(misfit, start, loss="soft_l1", f_scale=_RANGE_ERROR_M)
    slopes: FloatArray = np.asarray(solution.jac, dtype=float)
    information = slopes.T @ slopes / _RANGE_ERROR_M**2
    # A ridge of a kilometre keeps what nothing is known of from being singular.
    variance = np.linalg.inv(information + 1e-6 * np.eye(len(start)))[0, 0]
    if variance > _LARGEST_SPEED_ERROR**2:
        raise UsmapError(_TOO_FEW_PLACES)
    return float(solution.x[0] * stated_m_s)


def _tracks(
    pings: list[_Ping], floor: tuple[float, float] | None, speed_m_s: float
) -> list[list[tuple[int, float]]]:
    """Direct echoes of the same object from ping to ping, as (ping, delay)."""
    tracks: list[list[tuple[int, float]]] = []
    for number, ping in enumerate(pings):
        for delay_s in _direct(ping, floor):
            best, apart = None, np.inf
            for track in tracks:
                last, last_s = track[-1]
                moved_m = float(np.linalg.norm(ping.position_m - pings[last].position_m))
                if last == number or number - last > 3:
                    continue
                excess = abs(delay_s - last_s) - 2.0 * moved_m / speed_m_s
                if excess < _GATE_S and abs(delay_s - last_s) < apart:
                    best, apart = track, abs(delay_s - last_s)
            if best is None:
                tracks.append([(number, float(delay_s))])
            else:
                best.append((number, float(delay_s)))
    return tracks


def _direct(ping: _Ping, floor: tuple[float, float] | None) -> FloatArray:
    """Delays that no earlier echo explains by way of the floor."""
    delays_s: list[float] = []
    explained = np.zeros(0)
    for delay_s in np.sort(ping.delays_s):
        if len(explained) and np.abs(explained - delay_s).min() < 2.0 * _VOTE_WIDTH_S:
            continue
        delays_s.append(float(delay_s))
        if floor is not None:
            leg_s = 0.5 * delay_s
            over_s = np.hypot(leg_s, 2.0 * floor[0])
            explained = np.append(explained, [leg_s + over_s, 2.0 * over_s])
    return np.array(delays_s)


def _placed(
    pings: list[_Ping], track: list[tuple[int, float]], speed_m_s: float
) -> tuple[float, float, bool]:
    """Where the object of a track stands, and whether one place explains all its ranges."""
    number, delay_s = track[len(track) // 2]
    ping, range_m = pings[number], 0.5 * speed_m_s * delay_s

    def misfit(place_m: FloatArray) -> FloatArray:
        return _range_errors(pings, track, place_m, speed_m_s)

    angles = ping.yaw_rad + np.array(_BEARINGS_RAD)
    starts = ping.position_m + range_m * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    best = min((least_squares(misfit, start) for start in starts), key=lambda fit: float(fit.cost))
    rms_m = np.sqrt(2.0 * best.cost / len(track))
    return float(best.x[0]), float(best.x[1]), bool(rms_m < _PLACED_RMS_M)


def _range_errors(
    pings: list[_Ping], track: list[tuple[int, float]], place_m: FloatArray, speed_m_s: float
) -> FloatArray:
    positions_m = np.array([pings[number].position_m for number, _ in track])
    delays_s = np.array([delay_s for _, delay_s in track])
    errors: FloatArray = 0.5 * speed_m_s * delays_s - np.linalg.norm(positions_m - place_m, axis=1)
    return errors
