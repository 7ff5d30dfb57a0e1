"""Maps of real buildings by readings of the nearest thing, drawn from a laser that others recorded.

``git clone https://github.com/tipaldi/flirtlib`` and ``python benchmarks/real_rooms.py flirtlib``.
Its folder ``data`` has logs of robots in furnished offices of Freiburg and of the Intel research
lab: scans of a laser over 180°, how each follows from the one before by matching the two, and poses
for which all loops are closed.  No log of sonars in such rooms with a laser beside them was found,
so the laser stands in: the nearest of its readings in a beam of 30° is what such a sensor reports
that hears everything.  So rooms, furniture, ways and drift are real, and echoes are not.  The poses
are the truth, the laser's map from them is what stands, and the matched scans on their own are
odometry that drifts.  With ``--page`` the table goes into a document.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from real_swarm import compared, drifted, tell

from usmap_ros.grids import GridGeometry, TruthMap
from usmap_ros.localisation.planar import compose
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.range_cones import RangeReading

FloatArray = NDArray[np.float64]
Ping = tuple[str, EchoCone]
#: Logs, and how many of their scans are mapped.
LOGS = {"fr079": 300, "intel-lab": 500}
#: Where each sensor looks, its full beam, and between which ranges it measures, rad and m.
YAWS_RAD = np.deg2rad(np.arange(-75.0, 76.0, 15.0))
FIELD_RAD, RANGES_M = np.deg2rad(30.0), (0.1, 5.0)
#: What the laser says of what is farther is left out, m.
FAR_M = 12.0
RESOLUTION_M, HEIGHT_M = 0.1, 0.3
#: A cell stands if the laser ends in it in such a share of the scans that reach it.
STANDS = 0.25


class Log(NamedTuple):
    """Scans of a robot, and where they were taken.

    Parameters
    ----------
    true, told : (scans, 3) array
        x, y (m) and yaw (rad) with loops closed, and from one scan to the next alone.
    angles_rad : (readings,) array
        Where the laser looks.
    ranges_m : (scans, readings) array
        What it measured.
    seconds : (scans,) array
        When, since the first.
    """

    true: FloatArray
    told: FloatArray
    angles_rad: FloatArray
    ranges_m: FloatArray
    seconds: FloatArray


def read(path: Path, scans: int) -> Log:
    """Read the first scans of a log."""
    true, steps, ranges, seconds = [], {}, [], []
    begin_rad = step_rad = 0.0
    for line in path.read_text().splitlines():
        name, *fields = line.split() or [""]
        if name == "VERTEX2":
            true.append([float(field) for field in fields[1:4]])
        elif name == "EDGE2" and int(fields[1]) == int(fields[0]) + 1:
            steps[int(fields[0])] = np.array(fields[2:5], float)
        elif name == "ROBOTLASER1":
            begin_rad, step_rad = float(fields[1]), float(fields[3])
            ranges.append(np.array(fields[8 : 8 + int(fields[7])], float))
            seconds.append(float(fields[-1]))
    told = [np.array(true[0])]
    for number in range(scans - 1):
        told.append(compose(told[-1], steps[number]))
    angles_rad = begin_rad + step_rad * np.arange(len(ranges[0]))
    since = np.maximum.accumulate(np.array(seconds[:scans]) - seconds[0])
    return Log(np.array(true)[:scans], np.array(told), angles_rad, np.array(ranges)[:scans], since)


def pings(log: Log, *, drifting: bool) -> list[Ping]:
    """Readings of all sensors, with poses as told or as they were."""
    found, way_m = [], 0.0
    poses = log.told if drifting else log.true
    beams = [np.abs(log.angles_rad - yaw) <= 0.5 * FIELD_RAD + 1e-9 for yaw in YAWS_RAD]
    for number, (pose, ranges_m) in enumerate(zip(poses, log.ranges_m, strict=True)):
        way_m += math.dist(pose[:2], poses[max(number - 1, 0)][:2])
        known = drifted(way_m) if drifting else None
        stamp_ns = round((1000.0 + log.seconds[number] + 1e-3 * number) * 1e9)
        for sensor, (beam, yaw_rad) in enumerate(zip(beams, YAWS_RAD, strict=True)):
            within_m = ranges_m[beam & (ranges_m >= RANGES_M[0])]
            nearest_m = min(within_m, default=math.inf)
            reading = RangeReading(
                stamp_ns + sensor, f"robot/sensor{sensor}", FIELD_RAD, *RANGES_M,
                nearest_m if nearest_m < RANGES_M[1] else math.inf,
            )  # fmt: skip
            place = Pose.planar(pose[0], pose[1], pose[2] + yaw_rad, HEIGHT_M, known)
            found.append(("/robot/cone", reading.cone(place, "map")))
    return found


def truth(log: Log) -> TruthMap:
    """Cells in which the laser ends rather than passing on."""
    low = np.floor((log.true[:, :2].min(axis=0) - FAR_M) / RESOLUTION_M).astype(np.int64)
    high = np.ceil((log.true[:, :2].max(axis=0) + FAR_M) / RESOLUTION_M).astype(np.int64)
    ends, passes = np.zeros((2, *(high - low + 1)[::-1]))
    for pose, ranges_m in zip(log.true, log.ranges_m, strict=True):
        along = np.stack([np.cos(log.angles_rad + pose[2]), np.sin(log.angles_rad + pose[2])], 1)
        is_near = ranges_m < FAR_M
        _count(ends, pose[:2] + ranges_m[is_near, np.newaxis] * along[is_near], low)
        way_m = np.arange(0.0, FAR_M, 0.5 * RESOLUTION_M)
        is_before = way_m < np.minimum(ranges_m, FAR_M)[:, np.newaxis] - 1.5 * RESOLUTION_M
        _count(passes, (pose[:2] + way_m[:, np.newaxis] * along[:, np.newaxis])[is_before], low)
    stands = (ends > 0) & (ends >= STANDS * (ends + passes))
    corner_m = (float(low[0] * RESOLUTION_M), float(low[1] * RESOLUTION_M))
    return TruthMap(GridGeometry(RESOLUTION_M, corner_m, stands.shape), stands)


def _count(grid: FloatArray, places_m: FloatArray, low: NDArray[np.int64]) -> None:
    """Count one scan's places, each cell once."""
    cells = np.floor(places_m / RESOLUTION_M + 1e-9).astype(np.int64) - low
    grid.ravel()[np.unique(cells[:, 1] * grid.shape[1] + cells[:, 0])] += 1.0


def table(folder: Path) -> str:
    """A row for each log."""
    what = "F1 / known / leak / lost / escape, m²"
    columns = ["log", "way, m", "readings", f"true poses: {what}", "the same, nav2's range model"]
    columns += ["ATE as told, m", "refined, m", f"refined: {what}", "as told"]
    rows = [f"| {' | '.join(columns)} |", "|" + "---|" * len(columns)]
    for name, scans in LOGS.items():
        log = read(folder / f"{name}.log", scans)
        exact, told, stands = pings(log, drifting=False), pings(log, drifting=True), truth(log)
        true = list(np.repeat(log.true, len(YAWS_RAD), axis=0))
        way_m = float(np.hypot(*np.diff(log.true[:, :2], axis=0).T).sum())
        row = [name, f"{way_m:.0f}", f"{len(exact):,}", *compared(exact, told, true, stands)]
        rows.append(f"| {' | '.join(row)} |")
        print(rows[-1], flush=True)
    return "\n".join(rows) + "\n"


if __name__ == "__main__":
    tell(__doc__, "real rooms", lambda clone: table(clone / "data"))
