"""What recordings of simulators that are not ours have in common: ways, messages, truth, scores.

Nothing of this package makes them: messages are written by rosbags after their definitions.
``usmap map`` with its defaults and ``usmap evaluate`` do the rest.
"""

from __future__ import annotations

import argparse
import json
import subprocess
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pages import put
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.interpolate import CubicSpline

FloatArray = NDArray[np.float64]
SCHEMAS = Path(__file__).parents[1] / "msg_schemas" / "msg"
CELL_M = 0.05


class Sensor(NamedTuple):
    """What all traces of a recording state; SI units."""

    shape: int
    carrier_hz: float
    duration_s: float
    angles: FloatArray
    gains: FloatArray
    least_m: float
    reach_m: float
    sound_speed: float
    air_db_m: float
    encoding: int
    noise: float
    above_m: float


class Sounding(NamedTuple):
    """A ping: when, whose, where it was told to be, and what came back."""

    seconds: float
    robot: int
    mount_rad: float
    #: x, y, yaw, and their variances.
    told: FloatArray
    variances: FloatArray
    samples: FloatArray
    rate_hz: float


class Drive(NamedTuple):
    """When which robot pings: by which transducer, from which x, y, yaw, and after what way."""

    seconds: float
    robot: int
    mount_rad: float
    pose: FloatArray
    metres: float


def rotation(yaw_rad: float) -> FloatArray:
    """Matrix that turns vectors."""
    cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array([[cosine, -sine], [sine, cosine]])


def placed(points: Any, it: SimpleNamespace) -> FloatArray:
    """Places of a room as it was drawn."""
    return it.size * np.asarray(points, float) @ rotation(it.turn_rad).T


def way(rectangle: list[float], it: SimpleNamespace, direction: float = 1.0) -> CubicSpline:
    """Where a robot is by the metres of its way, round the corners of a rectangle."""
    left, low, right, high = rectangle
    angles = np.linspace(0.0, 2.0 * np.pi, 49) * direction
    loop = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    loop = np.sign(loop) * np.abs(loop) ** 0.6 * [0.5 * (right - left), 0.5 * (high - low)]
    middle = 0.5 * (left + right), 0.5 * (low + high)
    knots = placed(loop + np.array(middle), it)
    knots[-1] = knots[0]
    steps = np.linalg.norm(np.diff(knots, axis=0), axis=1)
    return CubicSpline(np.concatenate([[0.0], np.cumsum(steps)]), knots, bc_type="periodic")


def drives(it: SimpleNamespace, ways: list[CubicSpline], pings: int) -> Iterator[Drive]:
    """Where robots ping, in turn: they stand first, and then go round."""
    for number in range(pings):
        robot, step = number % it.robots, number // it.robots
        seconds = step / it.rate + 0.01 * robot
        metres = max(seconds - it.stands_s, 0.0) * it.speed
        on_m = metres % ways[robot].x[-1]
        (x, y), (dx, dy) = ways[robot](on_m), ways[robot](on_m, 1)
        pose = np.array([x, y, np.arctan2(dy, dx)])
        yield Drive(seconds, robot, it.mounts_rad[step % len(it.mounts_rad)], pose, metres)


def off_by_chance(it: SimpleNamespace, pose: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A pose as it is told where each is off for itself, or exact; and its variances."""
    variances = np.array([0.02, 0.02, 0.012]) ** 2 * (it.poses == "noisy")
    return pose + it.rng.normal(size=3) * np.sqrt(variances), variances


def write_bag(folder: Path, robots: int, sensor: Sensor, pings: Iterable[Sounding]) -> None:
    """Write what robots heard, in the order of `pings`."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for name in ("Transducer", "EchoTrace"):
        text = (SCHEMAS / f"{name}.msg").read_text()
        store.register(get_types_from_msg(text, f"usmap_msgs/msg/{name}"))

    def make(name: str, *fields: Any) -> Any:
        package, kind = name.split("/")
        return store.types[f"{package}/msg/{kind}"](*fields)

    transducer = make("usmap_msgs/Transducer", *sensor[:7])
    with Writer(folder / "bag", version=9) as bag:
        topics = [
            bag.add_connection(f"/robot{robot}/echo", "usmap_msgs/msg/EchoTrace", typestore=store)
            for robot in range(robots)
        ]
        for ping in pings:
            stamp_ns = round((100.0 + ping.seconds) * 1e9)
            half_rad = 0.5 * (ping.told[2] + ping.mount_rad)
            covariance = np.zeros(36)
            covariance[[0, 7, 35]] = ping.variances
            point = make("geometry_msgs/Point", ping.told[0], ping.told[1], sensor.above_m)
            facing = make("geometry_msgs/Quaternion", 0.0, 0.0, np.sin(half_rad), np.cos(half_rad))
            pose = make("geometry_msgs/Pose", point, facing)
            stamp = make("builtin_interfaces/Time", *divmod(stamp_ns, 10**9))
            message = make(
                "usmap_msgs/EchoTrace", make("std_msgs/Header", stamp, "map"),
                f"robot{ping.robot}/sonar{ping.mount_rad:.0f}",
                make("geometry_msgs/PoseWithCovariance", pose, covariance), transducer,
                sensor.sound_speed, sensor.air_db_m, 0.0, 0.0, sensor.encoding, ping.rate_hz, 0.0,
                sensor.noise, ping.samples.astype(np.float32),
            )  # fmt: skip
            bag.write(
                topics[ping.robot], stamp_ns, store.serialize_cdr(message, message.__msgtype__)
            )


def write_truth(folder: Path, loops: list[FloatArray]) -> None:
    """Write a nav2 map of surfaces that go round, each by its corners, (corners, 2), m."""
    steps = np.linspace(0.0, 1.0, 3000)[:, np.newaxis]
    sides = [(a, b) for loop in loops for a, b in zip(loop, np.roll(loop, -1, 0), strict=True)]
    on_sides = ((a + steps[:: max(1, len(sides) // 30)] * (b - a)) for a, b in sides)
    cells = np.unique(
        np.vstack([np.floor(points / CELL_M + 1e-9).astype(int) for points in on_sides]), axis=0
    )
    low, high = cells.min(axis=0) - 20, cells.max(axis=0) + 21
    grid = np.full((high - low)[::-1], 254, np.uint8)
    grid[tuple((cells - low).T[::-1])] = 0
    header = f"P5\n{grid.shape[1]} {grid.shape[0]}\n255\n".encode()
    (folder / "truth.pgm").write_bytes(header + grid[::-1].tobytes())
    origin = [float(value) for value in low * CELL_M] + [0.0]
    (folder / "truth.yaml").write_text(
        f"image: truth.pgm\nmode: trinary\nresolution: {CELL_M}\norigin: {origin}\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )


def scored(folder: Path, method: str) -> str:
    """Map a recording, and write its scores as one cell of a table."""
    out = folder / method
    if not out.exists():
        command = ["usmap", "map", folder / "bag", "-o", out, "--method", method]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    command = ["usmap", "evaluate", out, "--truth", folder / "truth.yaml", "--json"]
    done = subprocess.run(command, check=True, capture_output=True)
    of = json.loads(done.stdout)
    shares = f"{of['f1']:.2f} / {of['known']:.2f} / {of['leak']:.3f} / {of['lost']:.3f}"
    return f"{shares} / {of['escape_m2']:.2f}"


def compare(
    description: str | None,
    place: str,
    rooms: tuple[list[str], list[int]],
    simulator: tuple[
        Callable[[str, int], SimpleNamespace], Callable[[SimpleNamespace, Path], None]
    ],
    told: tuple[str, Callable[[SimpleNamespace], str]],
) -> None:
    """Record, map and score rooms, as the command line says.

    Parameters
    ----------
    description : str
        Of the command.
    place : str
        Of the table, in a document.
    rooms : list of str, list of int
        Kinds, and the seeds that are taken where none is named.
    simulator : callable, callable
        What a recording is of, by kind and seed; and what writes it.
    told : str, callable
        Head of a column of the table, beside poses, robots and scores, and what stands there.
    """
    (kinds, seeds), (drawn, record) = rooms, simulator
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("folder", type=Path, help="where recordings and maps are kept")
    parser.add_argument("--kinds", nargs="+", default=kinds, choices=kinds)
    parser.add_argument("--seeds", nargs="+", type=int, default=seeds)
    parser.add_argument("--record", action="store_true", help="map nothing")
    parser.add_argument("--page", type=Path, help="a document with a place for the table")
    arguments = parser.parse_args()
    what = "F1 / known / leak / lost / escape, m²"
    columns = ["room", told[0], "poses", "robots", what, "the same, nav2's range model"]
    rows = [f"| {' | '.join(columns)} |", "|" + "---|" * len(columns)]
    for kind in arguments.kinds:
        for seed in arguments.seeds:
            it, folder = drawn(kind, seed), arguments.folder / f"{kind}{seed}"
            if not (folder / "truth.yaml").exists():
                record(it, folder)
            if not arguments.record:
                row = [f"{kind} {seed}", told[1](it), it.poses, str(it.robots)]
                row += [scored(folder, method) for method in ("joint", "range_only")]
                rows.append(f"| {' | '.join(row)} |")
                print(rows[-1], flush=True)
    if arguments.page is not None:
        put(arguments.page, place, "\n".join(rows) + "\n")
