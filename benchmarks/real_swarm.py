"""Maps and poses of real drones that measure ranges only: seven recordings of others.

``git clone https://github.com/ETH-PBL/Nano_Swarm_Mapping`` and ``python benchmarks/real_swarm.py
Nano_Swarm_Mapping``.  Those are scans of one to four nano-drones in mazes of card board, by Friess,
Niculescu, Polonelli, Magno and Benini (2023): four time-of-flight sensors of 45° on each, poses by
motion capture and by odometry, and the walls in a notebook.  Each sensor's eight columns count as
one reading of the nearest thing, as ``sensor_msgs/Range`` has it.  With ``--page`` the table goes
into a document.
"""

from __future__ import annotations

import argparse
import json
import math
import re
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pages import put

from usmap_ros.evaluation.scoring import score
from usmap_ros.grids import GridGeometry, TruthMap
from usmap_ros.localisation import refine_poses
from usmap_ros.localisation.planar import between, compose
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import PipelineParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.fields_of_view import PingViews
from usmap_ros.pings.range_cones import RangeReading
from usmap_ros.runs.pipeline import Pipeline

FloatArray = NDArray[np.float64]
Ping = tuple[str, EchoCone]
#: Folders of the recordings, and what the notebook calls the mazes that they are of.
MAZES = {
    "exp1/two-drones": "env1a",
    "exp1/four-drones": "env1b",
    "exp2/two-drones": "env2",
    "exp2/four-drones": "env2",
    "exp3/two-drones": "env3",
    "exp4/0_2": "env4",
    "exp4/0_8": "env4",
}
#: Sensors of a drone: where each looks, and how far before its centre it is, m.
YAWS_RAD, OFFSETS_M = (0.0, math.pi, 0.5 * math.pi, -0.5 * math.pi), (0.02, 0.02, 0.025, 0.025)
#: Of a sensor: full angle of the beam, columns, least and greatest range, m.
FIELD_RAD, COLUMNS, RANGES_M = 0.25 * math.pi, 8, (0.05, 3.0)
#: Frames of a scan, each of so many bytes of ranges and pose, behind a header.
FRAMES, FRAME_BYTES, RANGE_BYTES, HEADER_BYTES = 15, 76, 64, 4
#: What odometry is taken to be off for the root of each metre, m and rad; time between frames, s.
SLIP_M, TURN_RAD, FRAME_S = 0.03, np.deg2rad(2.0), 0.1
RESOLUTION_M, HEIGHT_M = 0.05, 0.5


class Frame(NamedTuple):
    """What the sensors of a drone measured at once.

    Parameters
    ----------
    robot : str
        Which drone.
    stamp_ns : int
        When, counted in frames.
    true, told : (3,) arrays
        x, y (m) and yaw (rad) by motion capture and by odometry.
    ranges_m : (4,) array
        Of the nearest thing before each sensor; infinite where nothing was measured.
    """

    robot: str
    stamp_ns: int
    true: FloatArray
    told: FloatArray
    ranges_m: FloatArray


def lines(path: Path) -> Iterator[list[str]]:
    """Fields of each line of a file of comma-separated values."""
    for line in path.read_text().splitlines():
        yield line.split(",")


def captured(folder: Path) -> dict[str, FloatArray]:
    """Poses of scans by motion capture."""
    poses = {}
    for name, *fields in lines(folder / "vicon_poses.csv"):
        x_m, y_m, _, qw, qx, qy, qz = map(float, fields)
        yaw = math.atan2(2.0 * (qx * qy + qz * qw), 1.0 - 2.0 * (qy * qy + qz * qz))
        poses[name] = np.array([x_m, y_m, yaw])
    return poses


def odometry(folder: Path) -> dict[str, FloatArray]:
    """Poses of scans as drones had them before their own optimisation, the first of each."""
    poses: dict[str, FloatArray] = {}
    for name, *fields in lines(folder / "poses.csv"):
        poses.setdefault(name, np.array(fields, float))
    return poses


def frames(folder: Path) -> Iterator[Frame]:
    """All frames of a recording, each drone's odometry beginning where the drone was."""
    true, told = captured(folder), odometry(folder)
    scans = {name: bytes.fromhex(content) for name, content in lines(folder / "scans.csv")}
    counts: dict[str, int] = {}
    angles = FIELD_RAD * (0.5 - (np.arange(COLUMNS) + 0.5) / COLUMNS)
    for name in sorted(scans, key=lambda name: [int(part) for part in name.split("/")][::-1]):
        robot = name.split("/")[0]
        start = f"{robot}/0"
        at_start = compose(true[start], between(told[start], told[name]))
        for number in range(FRAMES):
            begin = HEADER_BYTES + number * FRAME_BYTES
            content = scans[name][begin : begin + FRAME_BYTES]
            depths_m = np.array(struct.unpack("<32h", content[:RANGE_BYTES])).reshape(4, COLUMNS)
            moved = np.array(struct.unpack("<fff", content[RANGE_BYTES:]))
            # In the axes of odometry, which are turned against those of motion capture.
            turn = at_start[2] - told[name][2]
            moved_there = compose(np.array([0.0, 0.0, turn]), moved) - [0.0, 0.0, turn]
            away_m = np.where(depths_m > 0, 1e-3 * depths_m / np.cos(angles), np.inf)
            count = counts[robot] = counts.get(robot, -1) + 1
            yield Frame(
                f"drone{robot}", round((1000.0 + FRAME_S * count) * 1e9),
                true[name] + moved, at_start + moved_there, away_m.min(axis=1),
            )  # fmt: skip


def pings(recording: list[Frame], *, drifting: bool) -> tuple[list[Ping], list[FloatArray]]:
    """Readings of all sensors with poses as told, or as they were, and where each sensor was."""
    found: list[tuple[Ping, FloatArray]] = []
    ways_m: dict[str, float] = {}
    last: dict[str, FloatArray] = {}
    for frame in recording:
        before = last.get(frame.robot, frame.told)
        ways_m[frame.robot] = ways_m.get(frame.robot, 0.0) + math.dist(before[:2], frame.told[:2])
        last[frame.robot] = frame.told
        known = drifted(ways_m[frame.robot]) if drifting else None
        for number, (yaw_rad, offset_m) in enumerate(zip(YAWS_RAD, OFFSETS_M, strict=True)):
            mount = np.array([offset_m * math.cos(yaw_rad), offset_m * math.sin(yaw_rad), yaw_rad])
            if not RANGES_M[0] <= frame.ranges_m[number] < np.inf:
                continue
            x_m, y_m, yaw = compose(frame.told if drifting else frame.true, mount)
            reading = RangeReading(
                frame.stamp_ns + number, f"{frame.robot}/sensor{number}", FIELD_RAD, *RANGES_M,
                min(frame.ranges_m[number], RANGES_M[1]),
            )  # fmt: skip
            cone = reading.cone(Pose.planar(x_m, y_m, yaw, HEIGHT_M, known), "map")
            found.append(((f"/{frame.robot}/cone", cone), compose(frame.true, mount)))
    found.sort(key=lambda entry: entry[0][1].stamp_ns)
    return [ping for ping, _ in found], [true for _, true in found]


def drifted(way_m: float) -> FloatArray:
    """Covariance of odometry after a way."""
    turned = TURN_RAD**2 * way_m
    place = SLIP_M**2 * way_m + turned * way_m**2 / 3.0
    return np.diag([place, place, turned]) + 1e-6 * np.eye(3)


def walls(notebook: Path) -> dict[str, FloatArray]:
    """Walls of each maze, rows of x, y, x, y (m)."""
    text = "".join(
        line for cell in json.loads(notebook.read_text())["cells"] for line in cell["source"]
    )
    return {
        name: np.array([one.split(",") for one in re.findall(r"Line\(([^)]*)\)", body)], float)
        for name, body in re.findall(r"(env\w+) = Environment\(\[(.*?)\]\)", text, re.DOTALL)
    }


def truth(ends_m: FloatArray) -> TruthMap:
    """Cells that walls pass through."""
    share = np.linspace(0.0, 1.0, 1000)[:, np.newaxis, np.newaxis]
    places_m = (ends_m[:, :2] + share * (ends_m[:, 2:] - ends_m[:, :2])).reshape(-1, 2)
    cells = np.floor(places_m / RESOLUTION_M + 1e-9).astype(np.int64)
    low, high = cells.min(axis=0) - 20, cells.max(axis=0) + 21
    occupied = np.zeros((high - low)[::-1], bool)
    occupied[tuple((cells - low).T[::-1])] = True
    corner_m = (float(low[0] * RESOLUTION_M), float(low[1] * RESOLUTION_M))
    return TruthMap(GridGeometry(RESOLUTION_M, corner_m, occupied.shape), occupied)


def scored(
    heard: list[Ping],
    views: PingViews,
    stands: TruthMap,
    method: str = "joint",
) -> str:
    """F1, known, leak, lost and escape of the map of some pings, by what was in sight."""
    mapping = {"method": method, "resolution_m": stands.geometry.resolution_m}
    pipeline = Pipeline(PipelineParameters.model_validate({"mapping": mapping}))
    for topic, cone in heard:
        pipeline.fuse(cone, topic)
    found = score(pipeline.occupancy_map(), stands, views)
    return (
        f"{found.f1:.2f} / {found.known:.2f} / {found.leak:.3f} / {found.lost:.3f}"
        f" / {found.escape_m2:.2f}"
    )


def ate_m(found: list[Ping], true: list[FloatArray]) -> float:
    """Root mean square error of places, m."""
    off_m = [cone.pose.position_m[:2] - at[:2] for (_, cone), at in zip(found, true, strict=True)]
    return float(np.sqrt(np.mean(np.sum(np.square(off_m), axis=1))))


def compared(
    exact: list[Ping], told: list[Ping], true: list[FloatArray], stands: TruthMap
) -> list[str]:
    """Maps with true poses by both methods, errors of poses told and refined, and their maps."""
    refined, views = refine_poses(told).pings, PingViews.of(cone for _, cone in exact)
    return [
        scored(exact, views, stands),
        scored(exact, views, stands, "range_only"),
        f"{ate_m(told, true):.3f}",
        f"{ate_m(refined, true):.3f}",
        scored(refined, views, stands),
        scored(told, views, stands),
    ]


def table(folder: Path) -> str:
    """A row for each recording."""
    mazes = walls(folder / "swarm-slam-evaluation.ipynb")
    what = "F1 / known / leak / lost / escape, m²"
    columns = ["recording", "readings", f"true poses: {what}", "the same, nav2's range model"]
    columns += ["ATE of odometry, m", "refined, m", f"refined: {what}", "odometry as told"]
    rows = [f"| {' | '.join(columns)} |", "|" + "---|" * len(columns)]
    for name, maze in MAZES.items():
        recording, stands = list(frames(folder / "data" / name)), truth(mazes[maze])
        exact, true = pings(recording, drifting=False)
        told, _ = pings(recording, drifting=True)
        row = [name, f"{len(exact):,}", *compared(exact, told, true, stands)]
        rows.append(f"| {' | '.join(row)} |")
        print(rows[-1], flush=True)
    return "\n".join(rows) + "\n"


def tell(description: str | None, place: str, tabled: Callable[[Path], str]) -> None:
    """Print the table of a clone that the command line names, or put it into a page."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("clone", type=Path, help="the repository with the recordings")
    parser.add_argument("--page", type=Path, help="a document with a place for the table")
    arguments = parser.parse_args()
    text = tabled(arguments.clone)
    if arguments.page is not None:
        put(arguments.page, place, text)


if __name__ == "__main__":
    tell(__doc__, "real swarm", lambda clone: table(clone / "evaluation"))
