"""Maps of rooms in which the wave equation is solved: nothing is assumed of how surfaces echo.

``python benchmarks/wave_equation.py FOLDER`` takes five to ten minutes a room.  Walls, columns and
poles are rigid cells of 4 mm, rough walls are bent by some millimetres; what mirrors, scatters,
bends round corners and shadows follows from the equation (`waves`).  With ``--page`` the table goes
into a document.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from matplotlib.path import Path as Outline
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from stranger_recordings import (
    Sensor,
    Sounding,
    compare,
    drives,
    off_by_chance,
    placed,
    way,
    write_bag,
    write_truth,
)
from waves import CARRIER_HZ, CELL_M, STEP_S, Air, gain

FloatArray = NDArray[np.float64]
#: Of the baseband, Hz.
RATE_HZ = 5e3
#: Speed of a burst on the cells, m/s, as traces state it: 4 m were heard as 4.08 m.
BURST_SPEED = 336.1
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
        absorbed=rng.uniform(0.0, 0.08), bent_m=ROOMS[kind][4], stands_s=STANDS_S,
    )  # fmt: skip


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
    ways = [way(ROOMS[it.kind][3][robot % 3], it) for robot in range(it.robots)]
    count = int((2.0 * it.reach / BURST_SPEED + it.long_s) * RATE_HZ)
    at = np.arange(count) / RATE_HZ / STEP_S
    for seconds, robot, mount_rad, pose, _ in drives(it, ways, PINGS):
        base = air.heard(pose[:2], pose[2] + mount_rad, it)
        steps = np.arange(len(base))
        iq = unit * (np.interp(at, steps, base.real) + 1j * np.interp(at, steps, base.imag))
        iq += it.noise * (it.rng.normal(size=(count, 2)) @ [1.0, 1j]) / np.sqrt(2.0)
        told, variances = off_by_chance(it, pose)
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
    compare(
        __doc__, "wave equation", (list(ROOMS), [1]), (drawn, record),
        ("bent, mm", lambda it: f"{1e3 * it.bent_m:g}"),
    )  # fmt: skip


if __name__ == "__main__":
    main()
