"""Maps of rooms in which the wave equation is solved: nothing is assumed of how surfaces echo.

``python benchmarks/wave_equation.py FOLDER`` takes five to ten minutes a room.  Walls, columns and
poles are rigid cells of 4 mm, rough walls are bent by some millimetres; what mirrors, scatters,
bends round corners and shadows follows from the equation.  It is solved in the plane by finite
differences in time, on nine points, which slow all directions down alike (Kowalczyk & van
Walstijn, "Room acoustics simulation using 3-D compact explicit FDTD schemes", IEEE Trans. Audio,
Speech, Lang. Process. 19 (2011) 34-46, in two dimensions).  Everything stands upright, so that what
has come a way L is spread upwards by 1/sqrt(L) more.  The transducer is a line of points before
another one, which cancel backwards.  With ``--page`` the table goes into a document.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from matplotlib.path import Path as Outline
from numba import njit
from numpy.typing import NDArray
from pages import put
from scipy.ndimage import gaussian_filter1d
from stranger_recordings import Sensor, Sounding, scored, way, write_bag, write_truth

FloatArray = NDArray[np.float64]
Cells = NDArray[np.float32]
#: Of the air, m/s; side of a cell, m; and a step of time, s, the longest that is stable.
SOUND_SPEED, CELL_M = 343.0, 0.004
COURANT = np.sqrt(0.75)
STEP_S = COURANT * CELL_M / SOUND_SPEED
#: Of the burst and of the baseband, Hz; of the pass band to either side, over the carrier.
CARRIER_HZ, RATE_HZ, BAND = 10e3, 5e3, 0.45
#: Speed of a burst on these cells, m/s, as traces state it: 4 m were heard as 4.08 m.
BURST_SPEED = 336.1
#: From the front to the back line of the transducer, cells, and how long sound takes.
BEHIND = 2
BEHIND_S = BEHIND * CELL_M / SOUND_SPEED
#: Pings of a recording; how long robots stand first, s; nearest range and height told, m.
PINGS, STANDS_S, LEAST_M, ABOVE_M = 330, 3.0, 0.3, 0.2
#: Of each kind: corners (none in the open); boxes (x, y, sides); columns (x, y, radius); what
#: robots go round (two corners); and by how much walls are bent, m.
# fmt: off
BOX = [[0, 0], [5, 0], [5, 4], [0, 4]]
ELL = [[0, 0], [5.4, 0], [5.4, 2.3], [2.5, 2.3], [2.5, 4.6], [0, 4.6]]
TEE = [[0, 2.2], [1.9, 2.2], [1.9, 0], [3.9, 0], [3.9, 2.2], [5.8, 2.2], [5.8, 4.2], [0, 4.2]]
OPEN = [[0, 0], [5, 0], [5, 4.5], [0, 4.5]]
ROUND_THE_BOX = [[1, 1, 4, 3], [2, 0.8, 4.2, 2.2], [0.8, 1.6, 2.8, 3.3]]
ROOMS: dict[str, tuple[Any, list[Any], list[Any], list[list[float]], float]] = {
    "smoothbox": (BOX, [], [], ROUND_THE_BOX, 0.0),
    "roughbox": (BOX, [], [], ROUND_THE_BOX, 0.009),
    "halfrough": (ELL, [], [], [[0.7, 0.7, 4.7, 1.7], [0.6, 0.8, 1.9, 4.0], [0.9, 0.6, 3.6, 1.6]],
                  0.0035),
    "columns": (BOX, [], [[2.2, 2.0, 0.18], [3.6, 1.4, 0.12], [3.4, 3.0, 0.25]],
                [[0.7, 0.7, 4.4, 3.4], [0.8, 0.9, 2.9, 3.3], [1.4, 0.6, 4.4, 2.4]], 0.0),
    "roughcolumns": (BOX, [], [[2.2, 2.0, 0.18], [3.6, 1.4, 0.12], [1.4, 2.9, 0.08]],
                     [[0.7, 0.7, 4.4, 3.4], [0.8, 0.9, 2.9, 3.4], [1.4, 0.6, 4.4, 2.4]], 0.007),
    "furnished": (BOX, [[2.1, 1.6, 0.8, 0.6], [4.1, 3.2, 0.9, 0.8], [0.0, 1.7, 0.4, 0.9]], [],
                  [[0.8, 0.8, 4.2, 2.9], [1, 0.6, 4.4, 1.3], [0.8, 2.7, 3.6, 3.5]], 0.004),
    "tee": (TEE, [], [], [[0.7, 2.8, 5.1, 3.6], [2.4, 0.7, 3.4, 3.5], [0.6, 2.8, 3.3, 3.7]], 0.002),
    "poles": (None, [], [[1.2, 1.1, 0.015], [2.4, 0.6, 0.02], [3.9, 1.2, 0.03], [2.0, 2.1, 0.012],
                         [3.1, 2.4, 0.02], [4.4, 2.9, 0.015], [0.8, 3.0, 0.025], [2.2, 3.6, 0.02],
                         [3.6, 3.7, 0.03]],
              [[0.4, 0.3, 4.6, 4.2], [1.6, 1.3, 2.8, 3.1], [0.5, 1.6, 3.4, 3.0]], 0.0),
}
# fmt: on


class Air:
    """Air in cells of which some are rigid.

    Parameters
    ----------
    is_air : (rows, columns) bool array
        Which are not.
    corner_m : (2,) array
        x and y of the first one's middle.
    absorbed : float
        How much the cells before rigid ones lose in a step.
    sponge_m : float
        Width of what loses all sound at the sides, in the open.
    """

    def __init__(
        self, is_air: NDArray[np.bool_], corner_m: FloatArray, absorbed: float, sponge_m: float = 0
    ) -> None:
        self.corner_m = corner_m
        air = is_air.astype(np.float32)
        weights = np.zeros_like(air)
        for down in (-1, 0, 1):
            for right in (-1, 0, 1):
                if down or right:
                    share = 0.125 if down and right else 0.5
                    weights += share * np.roll(air, (down, right), (0, 1))
        loss = np.where((weights < 2.49) & is_air, np.float32(absorbed), np.float32(0.0))
        if sponge_m > 0.0:
            rows, columns = (np.arange(count) for count in air.shape)
            to_sides = (np.minimum(each, len(each) - 1 - each) for each in (rows, columns))
            nearest = np.minimum(*np.meshgrid(*to_sides, indexing="ij"))
            depth = np.clip(1.0 - nearest / int(sponge_m / CELL_M), 0.0, 1.0)
            loss = (0.06 * depth**2).astype(np.float32)
        self._around = (air / (1.0 + loss)).astype(np.float32)
        self._own = ((2.0 - weights) * self._around).astype(np.float32)
        self._before = (air * (1.0 - loss) / (1.0 + loss)).astype(np.float32)

    def heard(self, place_m: FloatArray, yaw_rad: float, it: SimpleNamespace) -> NDArray[Any]:
        """Complex baseband of a ping, one value a step, from the start of the burst on."""
        across_m, taper = line(it)
        ahead = np.array([np.cos(yaw_rad), np.sin(yaw_rad)])
        front = place_m + across_m[:, np.newaxis] * [-ahead[1], ahead[0]]
        at = (np.concatenate([front, front - BEHIND * CELL_M * ahead]) - self.corner_m) / CELL_M
        time_s = np.arange(int((it.long_s + 2.0 * BEHIND_S) / STEP_S) + 3) * STEP_S
        sent = np.stack([burst(it, time_s), -burst(it, time_s - BEHIND_S)]).astype(np.float32)
        longest_s = 2.04 * it.reach / SOUND_SPEED + it.long_s + 4.0 * BEHIND_S
        received = np.zeros((2, int(longest_s / STEP_S)))
        still = (np.zeros_like(self._own), np.zeros_like(self._own))
        weights = np.tile(taper / taper.sum(), 2)
        _ping(still, (self._own, self._around, self._before), at, weights, sent, received)
        return _baseband(received, it)


@njit(cache=True)
def _ping(
    state: tuple[Cells, Cells],
    coefficients: tuple[Cells, Cells, Cells],
    at: FloatArray,
    weights: FloatArray,
    sent: Cells,
    received: FloatArray,
) -> None:
    """Send what the front and the back line send, and receive what each does."""
    (now, then), steps = state, received.shape[1]
    column, row = int(at[:, 0].mean()), int(at[:, 1].mean())
    for step in range(steps):
        # Where sound can have come, and from where it comes back in time.
        reach = int(min(step, steps - step) * 0.9) + 30
        top, left = max(1, row - reach), max(1, column - reach)
        bottom, right = min(now.shape[0] - 1, row + reach), min(now.shape[1] - 1, column + reach)
        _advance(now, then, coefficients, (top, bottom), (left, right))
        for is_heard in (False, True):
            for point in range(len(at)):
                side, x, y = 2 * point // len(at), int(at[point, 0]), int(at[point, 1])
                for down, share_y in ((0, y + 1.0 - at[point, 1]), (1, at[point, 1] - y)):
                    for along, share_x in ((0, x + 1.0 - at[point, 0]), (1, at[point, 0] - x)):
                        share = weights[point] * share_y * share_x
                        if is_heard:
                            received[side, step] += share * then[y + down, x + along]
                        elif step < sent.shape[1]:
                            then[y + down, x + along] += share * sent[side, step]
        now, then = then, now


@njit(cache=True, fastmath=True, error_model="numpy")
def _advance(
    now: Cells,
    then: Cells,
    coefficients: tuple[Cells, Cells, Cells],
    rows: tuple[int, int],
    columns: tuple[int, int],
) -> None:
    """Put the next pressures of some cells into the place of the last ones."""
    (left, right), (own, around, before) = columns, coefficients
    half, eighth = np.float32(0.5), np.float32(0.125)
    for row in range(*rows):
        above, here, below = now[row - 1], now[row], now[row + 1]
        north, middle, south = above[left:right], here[left:right], below[left:right]
        before_it, behind_it = slice(left - 1, right - 1), slice(left + 1, right + 1)
        north_west, west, south_west = above[before_it], here[before_it], below[before_it]
        north_east, east, south_east = above[behind_it], here[behind_it], below[behind_it]
        of_own, of_around = own[row, left:right], around[row, left:right]
        of_before, pressure = before[row, left:right], then[row, left:right]
        for cell in range(right - left):
            beside = north[cell] + south[cell] + west[cell] + east[cell]
            aslant = north_west[cell] + north_east[cell] + south_west[cell] + south_east[cell]
            pressure[cell] = (
                of_own[cell] * middle[cell]
                + of_around[cell] * (half * beside + eighth * aslant)
                - of_before[cell] * pressure[cell]
            )


def burst(it: SimpleNamespace, time_s: FloatArray) -> FloatArray:
    """What is sent."""
    window = (time_s >= 0) & (time_s <= it.long_s)
    shape = np.sin(np.pi * time_s / it.long_s) ** 2 if it.shape == 2 else 1.0
    sent: FloatArray = window * shape * np.sin(2.0 * np.pi * CARRIER_HZ * time_s)
    return sent


def line(it: SimpleNamespace) -> tuple[FloatArray, FloatArray]:
    """Where points of a line are, m from its middle, and what each has of it."""
    across_m = np.arange(-(it.points - 1) / 2, (it.points + 1) / 2) * CELL_M
    taper = np.cos(0.5 * np.pi * across_m / (across_m[-1] + CELL_M))
    return across_m, taper if it.tapered else np.ones(it.points)


def gain(it: SimpleNamespace, off_rad: FloatArray) -> FloatArray:
    """Amplitude gain of the beam far away, one way."""
    across_m, taper = line(it)
    number = 2.0 * np.pi * CARRIER_HZ / SOUND_SPEED
    phases = np.exp(1j * number * across_m * np.sin(off_rad)[:, np.newaxis])
    behind = 1.0 - np.exp(-1j * number * BEHIND * CELL_M * (1.0 + np.cos(off_rad)))
    most = abs(1.0 - np.exp(-2j * number * BEHIND * CELL_M))
    found: FloatArray = np.abs((taper * phases).sum(axis=1)) / taper.sum() * np.abs(behind) / most
    return found


def _baseband(received: FloatArray, it: SimpleNamespace) -> NDArray[Any]:
    """What both lines receive, the back one later, around the carrier, and spread upwards."""
    steps = received.shape[1]
    count, time_s = 4 * steps, np.arange(steps) * STEP_S
    frequency_hz = np.fft.rfftfreq(count, STEP_S)
    later = np.exp(-2j * np.pi * frequency_hz * BEHIND_S)
    spectrum = np.zeros(count, complex)
    both = np.fft.rfft(received[0], count) - np.fft.rfft(received[1], count) * later
    spectrum[: len(both)] = 2.0 * both
    off = (np.fft.fftfreq(count, STEP_S) - CARRIER_HZ) / (BAND * CARRIER_HZ)
    passed = np.fft.ifft(spectrum * np.exp(-(off**6)))[:steps]
    way_m = SOUND_SPEED * (time_s - 0.5 * it.long_s - 2.0 * BEHIND_S)
    shifted = passed * np.exp(-2j * np.pi * CARRIER_HZ * time_s)
    return np.asarray(shifted / np.sqrt(np.maximum(way_m, 0.05)))


def drawn(kind: str, seed: int) -> SimpleNamespace:
    """What a recording is of; units are SI."""
    rng = np.random.default_rng([seed, *kind.encode()])

    def pick(*values: Any) -> Any:
        return values[rng.integers(len(values))]

    return SimpleNamespace(
        kind=kind, rng=rng, size=rng.uniform(0.92, 1.08), turn_rad=pick(0.0, rng.uniform(0.1, 1.4)),
        points=pick(11, 15, 19), tapered=bool(pick(0, 1)), long_s=pick(8, 12, 16) / CARRIER_HZ,
        shape=pick(1, 2), reach=pick(2.5, 3.0), robots=pick(1, 2, 3), encoding=pick(1, 2),
        rate=pick(2.0, 3.0), speed=rng.uniform(0.15, 0.3), noise=pick(0.0005, 0.002, 0.004),
        poses=pick("exact", "exact", "noisy"),
        mounts_rad=pick((0.0, 1.57, -1.57), (0.8, -0.8), (0.0, 2.1, -2.1)),
        absorbed=rng.uniform(0.0, 0.08), bent_m=ROOMS[kind][4],
    )  # fmt: skip


def placed(points: Any, it: SimpleNamespace) -> FloatArray:
    """Places of a room as it was drawn."""
    cosine, sine = np.cos(it.turn_rad), np.sin(it.turn_rad)
    return it.size * np.asarray(points, float) @ np.array([[cosine, sine], [-sine, cosine]])


def loops(it: SimpleNamespace) -> list[FloatArray]:
    """What stands, each by the points of its outline; the walls first."""
    outline, boxes, columns, _, _ = ROOMS[it.kind]
    found = [] if outline is None else [bent(placed(outline, it), it)]
    for x, y, wide, deep in boxes:
        corners = [[x, y], [x, y + deep], [x + wide, y + deep], [x + wide, y]]
        found.append(bent(placed(corners, it), it))
    angles = np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False)
    circle = np.stack([np.cos(angles), -np.sin(angles)], axis=1)
    return found + [placed([[x, y]], it) + radius * circle for x, y, radius in columns]


def bent(corners: FloatArray, it: SimpleNamespace) -> FloatArray:
    """Sides that are bent at random."""
    pieces = []
    for one, other in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        length_m = float(np.linalg.norm(other - one))
        count = max(int(length_m / CELL_M), 2)
        along = np.linspace(0.0, 1.0, count, endpoint=False)[:, np.newaxis]
        bend = gaussian_filter1d(it.rng.normal(size=count), it.rng.uniform(4, 10))
        bend *= it.bent_m / max(bend.std(), 1e-9)
        normal = np.array([one[1] - other[1], other[0] - one[0]]) / length_m
        pieces.append(one + along * (other - one) + bend[:, np.newaxis] * normal)
    return np.vstack(pieces)


def room_of(it: SimpleNamespace, outlines: list[FloatArray]) -> Air:
    """The air between what stands."""
    is_open = ROOMS[it.kind][0] is None
    points, margin_m = (placed(OPEN, it), 0.5) if is_open else (np.vstack(outlines), 0.05)
    low, high = points.min(axis=0) - margin_m, points.max(axis=0) + margin_m
    columns, rows = np.ceil((high - low) / CELL_M).astype(int)
    x_m, y_m = low[0] + np.arange(columns) * CELL_M, low[1] + np.arange(rows) * CELL_M
    middles = np.stack(np.meshgrid(x_m, y_m), axis=-1).reshape(-1, 2)
    is_air = np.ones(len(middles), bool)
    for number, outline in enumerate(outlines):
        is_within = Outline(outline).contains_points(middles)
        is_air &= is_within if number == 0 and not is_open else ~is_within
    is_air = is_air.reshape(rows, columns)
    is_air[[0, 1, -2, -1]] = is_air[:, [0, 1, -2, -1]] = False
    return Air(is_air, low, it.absorbed, 0.4 if is_open else 0.0)


def unit_of(it: SimpleNamespace) -> float:
    """What samples are to be multiplied by: a mirror at 1 m answers with half an amplitude."""
    is_air = np.ones((int(3.0 / CELL_M),) * 2, bool)
    is_air[[0, 1, -1, -2]] = is_air[:, [0, 1, -1, -2]] = is_air[:, int(1.9 / CELL_M) :] = False
    near = SimpleNamespace(**{**vars(it), "reach": 1.6})
    received = np.abs(Air(is_air, np.zeros(2), 0.0).heard(np.array([0.9, 1.5]), 0.0, near))
    time_s = np.arange(len(received)) * STEP_S
    return 0.5 / float(received[(time_s > 4.5e-3) & (time_s < 8e-3)].max())


def pings(it: SimpleNamespace, air: Air) -> Iterator[Sounding]:
    """What robots hear, robot by robot in turn."""
    unit = unit_of(it)
    ways = [
        way(ROOMS[it.kind][3][robot % 3], lambda points: placed(points, it))
        for robot in range(it.robots)
    ]
    count = int((2.0 * it.reach / BURST_SPEED + it.long_s) * RATE_HZ)
    for number in range(PINGS):
        robot, step = number % it.robots, number // it.robots
        seconds = step / it.rate + 0.01 * robot
        on_m = max(seconds - STANDS_S, 0.0) * it.speed % ways[robot].x[-1]
        (x, y), (dx, dy) = ways[robot](on_m), ways[robot](on_m, 1)
        mount_rad, yaw_rad = it.mounts_rad[step % len(it.mounts_rad)], np.arctan2(dy, dx)
        base = air.heard(np.array([x, y]), yaw_rad + mount_rad, it)
        at = np.arange(count) / RATE_HZ / STEP_S
        steps = np.arange(len(base))
        iq = unit * (np.interp(at, steps, base.real) + 1j * np.interp(at, steps, base.imag))
        iq += it.noise * (it.rng.normal(size=(count, 2)) @ [1.0, 1j]) / np.sqrt(2.0)
        variances = np.array([0.02, 0.02, 0.012]) ** 2 * (it.poses == "noisy")
        told = np.array([x, y, yaw_rad]) + it.rng.normal(size=3) * np.sqrt(variances)
        received = np.abs(iq) if it.encoding == 1 else iq.view(float)
        yield Sounding(seconds, robot, mount_rad, told, variances, received, RATE_HZ)


def record(it: SimpleNamespace, folder: Path) -> None:
    """Write a bag, and the truth as a nav2 map."""
    outlines = loops(it)
    off_rad = np.linspace(0.0, 1.5, 301)
    half_rad = off_rad[np.argmax(gain(it, off_rad) ** 2 < 0.01)]
    angles = np.linspace(0.0, half_rad, 16)
    sensor = Sensor(
        it.shape, CARRIER_HZ, it.long_s, angles, gain(it, angles) ** 2, LEAST_M, it.reach,
        BURST_SPEED, 0.0, it.encoding, it.noise, ABOVE_M,
    )  # fmt: skip
    folder.mkdir(parents=True)
    write_bag(folder, it.robots, sensor, pings(it, room_of(it, outlines)))
    write_truth(folder, outlines)


def main() -> None:
    """Record, map and score."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="where recordings and maps are kept")
    parser.add_argument("--kinds", nargs="+", default=list(ROOMS), choices=list(ROOMS))
    parser.add_argument("--seeds", nargs="+", type=int, default=[1])
    parser.add_argument("--record", action="store_true", help="map nothing")
    parser.add_argument("--page", type=Path, help="a document with a place for the table")
    arguments = parser.parse_args()
    what = "F1 / known / leak / lost / escape, m²"
    columns = ["room", "bent, mm", "poses", "robots", what, "the same, nav2's range model"]
    rows = [f"| {' | '.join(columns)} |", "|" + "---|" * len(columns)]
    for kind in arguments.kinds:
        for seed in arguments.seeds:
            it, folder = drawn(kind, seed), arguments.folder / f"{kind}{seed}"
            if not (folder / "truth.yaml").exists():
                record(it, folder)
            if not arguments.record:
                row = [f"{kind} {seed}", f"{1e3 * it.bent_m:g}", it.poses, str(it.robots)]
                row += [scored(folder, method) for method in ("joint", "range_only")]
                rows.append(f"| {' | '.join(row)} |")
                print(rows[-1], flush=True)
    if arguments.page is not None:
        put(arguments.page, "wave equation", "\n".join(rows) + "\n")


if __name__ == "__main__":
    main()
