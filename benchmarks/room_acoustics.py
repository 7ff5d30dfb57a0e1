"""Maps of rooms that a public simulator of room acoustics made sound: pyroomacoustics.

``pip install pyroomacoustics`` and ``python benchmarks/room_acoustics.py FOLDER``.  Nothing of this
package makes the recordings: ways of sound up to three reflections are that simulator's image
sources, floor and ceiling included, and what rough walls scatter is its ray tracing (Scheibler,
Bezzam & Dokmanic, "Pyroomacoustics", ICASSP 2018).  A kind of room and a seed choose the rest:
walls, robots, ways, carrier, pulse, beam, encoding, noise, how poses are known.  With ``--page``
the table goes into a document.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyroomacoustics as pra
from numpy.typing import NDArray
from pyroomacoustics.doa import fibonacci_spherical_sampling
from stranger_recordings import (
    Sensor,
    Sounding,
    compare,
    drives,
    off_by_chance,
    placed,
    rotation,
    way,
    write_bag,
    write_truth,
)

FloatArray = NDArray[np.float64]
SOUND_SPEED, PINGS, RAYS, DIRECTIONS, BIN_S = 343.0, 480, 2500, 720, 5e-5
#: Robots stand so long before they drive, s; microphones are so far beside where sound leaves, m.
STANDS_S, BESIDE_M = 4.0, 0.01
SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
#: Of each kind: corners; boxes (x, y, sides, whether soft); what robots go round (two corners), m.
# fmt: off
ROOMS: dict[str, tuple[list[list[float]], list[list[float]], list[list[float]]]] = {
    "box": ([[0, 0], [5, 0], [5, 4], [0, 4]], [],
            [[1, 1, 4, 3], [2, 0.7, 4.2, 2.2], [0.7, 1.6, 2.8, 3.4]]),
    "ell": ([[0, 0], [6, 0], [6, 2.4], [2.6, 2.4], [2.6, 5], [0, 5]], [],
            [[0.7, 0.7, 5.2, 1.8], [0.6, 0.8, 2, 4.3], [1, 0.6, 4, 1.6]]),
    "corridor": ([[0, 0], [9, 0], [9, 1.6], [6, 1.6], [6, 2.6], [4.6, 2.6], [4.6, 1.6], [0, 1.6]],
                 [], [[0.5, 0.5, 5, 1.1], [4, 0.5, 8.5, 1.1], [2, 0.4, 7, 1.2]]),
    "door": ([[0, 0], [3.4, 0], [3.4, 1.4], [3.5, 1.4], [3.5, 0], [7, 0], [7, 4], [3.5, 4],
              [3.5, 2.5], [3.4, 2.5], [3.4, 4], [0, 4]], [],
             [[0.6, 0.7, 2.8, 3.3], [4.1, 0.7, 6.3, 3.2], [2, 1.7, 5.2, 2.2]]),
    "furnished": ([[0, 0], [5.5, 0], [5.5, 4.5], [0, 4.5]],
                  [[2.3, 1.9, 0.9, 0.6, 1], [4.25, 3.55, 1.2, 0.9, 1], [0.05, 2.0, 0.4, 1.0, 0]],
                  [[0.8, 0.8, 4.6, 3.2], [1.0, 0.6, 5.0, 1.5], [0.8, 3.0, 3.8, 4.0]]),
    "askew": ([[0, 0.6], [3.2, 0], [5.6, 1.8], [4.6, 4.6], [0.8, 4.2]], [],
              [[1.2, 1.3, 4.2, 3.4], [1.5, 0.9, 4.0, 2.2], [1.3, 2.2, 3.6, 3.7]]),
    "tee": ([[0, 2.5], [2.2, 2.5], [2.2, 0], [4.4, 0], [4.4, 2.5], [6.6, 2.5], [6.6, 4.7],
             [0, 4.7]], [], [[0.7, 3.1, 5.9, 4.1], [2.8, 0.7, 3.8, 4.0], [0.6, 3.2, 3.6, 4.2]]),
    "pillars": ([[0, 0], [7, 0], [7, 5], [0, 5]],
                [[2.0, 1.6, 0.4, 0.4, 0], [4.6, 3.0, 0.5, 0.5, 0], [4.9, 1.2, 0.3, 0.3, 0]],
                [[0.8, 0.8, 6.2, 4.2], [0.9, 2.4, 4.2, 4.4], [2.8, 0.6, 6.3, 2.4]]),
}
# fmt: on


def drawn(kind: str, seed: int) -> SimpleNamespace:
    """What a recording is of: units are SI, absorption and scattering are shares of the energy."""
    rng = np.random.default_rng([seed, *kind.encode()])

    def pick(*values: Any) -> Any:
        return values[rng.integers(len(values))]

    scattering = pick(0.05, 0.1, 0.2, 0.4, 0.6)
    return SimpleNamespace(
        kind=kind, rng=rng, size=rng.uniform(0.9, 1.15),
        turn_rad=pick(0.0, 0.0, rng.uniform(0.1, 1.4)), scattering=scattering,
        absorption=rng.uniform(0.03, 0.3), soft=rng.uniform(0.5, 0.8),
        height=rng.uniform(2.3, 3.0), floor=pick((0.05, 0.05), (0.3, 0.5), (0.6, 0.7)),
        above=rng.uniform(0.12, 0.4), robots=pick(1, 2, 3, 3, 4),
        carrier=pick(40e3, 40e3, 42e3, 45e3, 50e3), shape=pick(1, 2), cycles=pick(8, 12, 16),
        encoding=pick(0, 1, 2), half_rad=rng.uniform(0.35, 0.8), reach=pick(3.0, 4.0, 5.0),
        rate=pick(2.0, 3.0, 5.0), speed=rng.uniform(0.15, 0.4), air_db_m=rng.uniform(1.0, 1.6),
        noise=pick(0.0005, 0.002, 0.005), poses=pick("exact", "exact", "noisy", "odometry"),
        mounts_rad=pick((0.0, 1.57, -1.57), (0.8, -0.8), (0.0, 2.1, -2.1, 3.14)),
        stands_s=STANDS_S,
    )  # fmt: skip


def loops(it: SimpleNamespace) -> list[tuple[FloatArray, bool]]:
    """Corners of the outline and of boxes, what is open left of them, and whether they are soft."""
    outline, boxes, _ = ROOMS[it.kind]
    found = [(placed(outline, it), False)]
    for x, y, wide, deep, soft in boxes:
        found.append((placed(np.array([x, y]) + SQUARE[::-1] * [wide, deep], it), bool(soft)))
    return found


def surfaces(it: SimpleNamespace) -> list[Any]:
    """Walls, floor and ceiling for pyroomacoustics."""
    found = []
    for corners, soft in loops(it):
        absorbed, scattered = (it.soft, 0.6) if soft else (it.absorption, it.scattering)
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            upright = np.array([[*a, 0], [*b, 0], [*b, it.height], [*a, it.height]]).T
            found.append(pra.wall_factory(upright, [absorbed], [scattered]))
    outline = loops(it)[0][0]
    levels = ((0.0, -1, it.floor), (it.height, 1, (0.3, 0.3)))
    for level, order, (absorbed, scattered) in levels:
        flat = np.column_stack([outline, np.full(len(outline), level)])[::order]
        found.append(pra.wall_factory(flat.T, [absorbed], [scattered]))
    return found


def gain(it: SimpleNamespace, off_rad: FloatArray) -> FloatArray:
    """Amplitude gain of the beam, one way."""
    return np.cos(0.5 * np.pi * np.minimum(off_rad / it.half_rad, 1.0)).clip(0.0)


def heard(sides: list[Any], it: SimpleNamespace, place: FloatArray, yaw_rad: float) -> FloatArray:
    """Delays, s, and complex amplitudes of all that comes back, a row each."""
    ahead = np.array([np.cos(yaw_rad), np.sin(yaw_rad), 0.0])
    beside = BESIDE_M * np.array([-ahead[1], ahead[0], 0.0])

    def weight(ways: FloatArray) -> FloatArray:
        lengths = np.maximum(np.linalg.norm(ways, axis=1), 1e-9)
        return gain(it, np.arccos(np.clip(ways @ ahead / lengths, -1.0, 1.0)))

    # It makes bins of whole samples, rounded down, and others would put scattered sound too late.
    room = pra.Room(sides, fs=round(1.0 / BIN_S), max_order=3, ray_tracing=True)
    room.set_sound_speed(SOUND_SPEED)
    room.set_ray_tracing(
        n_rays=RAYS, receiver_radius=0.05, energy_thres=1e-9, hist_bin_size=BIN_S,
        time_thres=2.0 * it.reach / SOUND_SPEED,
    )  # fmt: skip
    # It counts walls on a way from outside, and misjudges where boxes stand on the floor.
    room.is_inside = lambda *_: True
    room.add_source(place).add_microphone(place + beside)
    room.image_source_model()
    source = room.sources[0]
    is_heard = room.visibility[0][0].astype(bool) & (source.orders > 0)
    ways = source.images[:, is_heard].T - place
    lengths = np.linalg.norm(ways, axis=1)
    mirrored = source.damping[0, is_heard] / lengths * weight(ways)
    mirrored *= weight(source.directions[0][:, is_heard].T)
    rays, from_where = (fibonacci_spherical_sampling(count).T for count in (RAYS, DIRECTIONS))
    leaving = weight(rays)
    rays, leaving = rays[leaving > 0], leaving[leaving > 0]
    microphone = room.room_engine.microphones[0]
    microphone.set_directions(from_where)
    energies = leaving[:, np.newaxis] ** 2 * len(rays) / RAYS
    room.room_engine.ray_tracing(rays, energies, place)
    scattered = np.zeros(2 * round(2.0 * it.reach / SOUND_SPEED / BIN_S))
    for share, histogram in zip(weight(from_where) ** 2, microphone.histograms, strict=True):
        if share > 0.0:
            energy = np.asarray(histogram.get_hist())[0][: len(scattered)]
            scattered[: len(energy)] += share * energy
    bins = np.flatnonzero(scattered)
    speckle = it.rng.normal(size=(len(bins), 2)) @ [1.0, 1j] / np.sqrt(2.0)
    after = (bins + it.rng.uniform(size=len(bins))) * BIN_S
    delays = np.concatenate([lengths / SOUND_SPEED, after])
    amplitudes = np.concatenate([mirrored, np.sqrt(scattered[bins]) * speckle])
    return np.stack([delays, amplitudes * 10.0 ** (-it.air_db_m * delays * SOUND_SPEED / 20.0)])


def samples(it: SimpleNamespace, ways: FloatArray) -> tuple[FloatArray, float]:
    """What the receiver gives, and its sample rate, Hz."""
    delays, long_s, is_raw = ways[0].real, it.cycles / it.carrier, it.encoding == 0
    rate = 5.0 * it.carrier if is_raw else 0.5 * it.carrier
    count = round((2.0 * it.reach / SOUND_SPEED + long_s) * rate)
    index = np.ceil(delays * rate).astype(int)[:, np.newaxis] + np.arange(int(long_s * rate) + 1)
    since = index / rate - delays[:, np.newaxis]
    window = (since >= 0) & (since <= long_s)
    shape = np.sin(np.pi * since / long_s) ** 2 if it.shape == 2 else 1.0
    phase = since if is_raw else -delays[:, np.newaxis]
    wave = window * shape * ways[1][:, np.newaxis] * np.exp(2j * np.pi * it.carrier * phase)
    received = np.zeros(count, complex)
    np.add.at(received, index[index < count], wave[index < count])
    noise = it.rng.normal(size=(count, 2)) * it.noise
    if is_raw:
        return received.imag + noise[:, 0], rate
    received += noise @ [1.0, 1j] / np.sqrt(2.0)
    return np.abs(received) if it.encoding == 1 else received.view(float), rate


def pings(it: SimpleNamespace) -> Iterator[Sounding]:
    """What robots hear, robot by robot in turn."""
    sides = surfaces(it)
    told: dict[int, FloatArray] = {}
    last: dict[int, FloatArray] = {}
    ways = [
        way(ROOMS[it.kind][2][robot % 3], it, 1 if robot < 3 else -1) for robot in range(it.robots)
    ]
    for seconds, robot, mount_rad, true, metres in drives(it, ways, PINGS):
        if it.poses == "odometry":
            before, was = told.get(robot, true), last.get(robot, true)
            step_m = rotation(-was[2]) @ (true - was)[:2] * (1.0 + it.rng.normal() * 0.02)
            spin = it.rng.normal() * np.deg2rad(1.5) * np.sqrt(np.hypot(*(true - was)[:2]))
            pose = np.array([*(before[:2] + rotation(before[2]) @ step_m), 0.0])
            pose[2] = before[2] + true[2] - was[2] + spin
            told[robot], last[robot] = pose, true
            grown = np.array([0.002, 0.002, np.deg2rad(1.5) ** 2])
            variances = np.array([0.02, 0.02, 0.01]) ** 2 + grown * metres
        else:
            pose, variances = off_by_chance(it, true)
        place = np.array([true[0], true[1], it.above])
        received, rate_hz = samples(it, heard(sides, it, place, true[2] + mount_rad))
        yield Sounding(seconds, robot, mount_rad, pose, variances, received, rate_hz)


def record(it: SimpleNamespace, folder: Path) -> None:
    """Write a bag, and the truth as a nav2 map."""
    angles = np.linspace(0.0, it.half_rad, 12)
    sensor = Sensor(
        it.shape, it.carrier, it.cycles / it.carrier, angles, gain(it, angles) ** 2, 0.15, it.reach,
        SOUND_SPEED, it.air_db_m, it.encoding, it.noise, it.above,
    )  # fmt: skip
    folder.mkdir(parents=True)
    write_bag(folder, it.robots, sensor, pings(it))
    write_truth(folder, [loop for loop, _ in loops(it)])


def main() -> None:
    """Record, map and score."""
    compare(
        __doc__, "room acoustics", (list(ROOMS), [1, 2, 3, 4]), (drawn, record),
        ("scattered", lambda it: f"{it.scattering:.2f}"),
    )  # fmt: skip


if __name__ == "__main__":
    main()
