"""``usmap map`` over a folder of recordings: one process, a pool, and Dask clusters.

The recordings are made first: robots among poles, three in each of several places that no ping
reaches from another.  Every map is compared with the one that a single process makes; on the last
cluster, one of its workers is killed on the way.

    python benchmarks/scaling.py --areas 4 --pings 600 --workers 1 2 4

With places so near to each other that they are one area, ``--tile`` divides it:

    python benchmarks/scaling.py --areas 4 --distance 20 --tile 25 --workers 1 2
"""

from __future__ import annotations

import argparse
import json
import math
import os
import signal
import tempfile
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from usmap_ros.grids import GridGeometry, OccupancyMap
from usmap_ros.io.bag_writer import new_bag
from usmap_ros.parameters import PipelineParameters
from usmap_ros.processes.cluster import cluster
from usmap_ros.processes.workers import worker_processes
from usmap_ros.runs.collection import AreaOptions, find_recordings, map_collection
from usmap_ros.runs.collection.cones import STRETCH
from usmap_ros.simulation import Scenario, simulate

SCENARIO = Path(__file__).parents[1] / "config/scenarios/poles.yaml"


def write(folder: Path, areas: int, distance_m: float, pings: int) -> None:
    """Write recordings, one of each robot in each place, so far from one to the next."""
    heard = list(islice(simulate(Scenario.load(SCENARIO)), pings))
    for area in range(areas):
        for robot in sorted({topic for topic, _ in heard}):
            name = f"{area}{robot.replace('/', '_')}"
            with new_bag(folder / f"area{area}" / name) as writer:
                for topic, trace in heard:
                    if topic == robot:
                        place_m = trace.pose.position_m + np.array([area * distance_m, 0.0, 0.0])
                        moved = replace(trace, pose=replace(trace.pose, position_m=place_m))
                        writer.write_trace(f"/area{area}{topic}", moved)


def measure(
    bags: Path, name: str, place: AbstractContextManager[Any], stretch: int, tile_m: float,
    *, kill: bool = False,
) -> tuple[dict[str, Any], OccupancyMap]:  # fmt: skip
    """Map a folder of recordings; figures, and the map."""
    with tempfile.TemporaryDirectory() as output, place as executor:
        recordings = find_recordings([bags], Path(output))
        steps = 0

        def step() -> None:
            nonlocal steps
            steps += 1
            if kill and steps == 1:
                os.kill(min(executor._client.run(os.getpid).values()), signal.SIGKILL)

        started_s = time.perf_counter()
        done = map_collection(
            recordings, Path(output), PipelineParameters(), executor,
            wishes=AreaOptions(tile_m=tile_m), step=step, stretch=stretch,
        )  # fmt: skip
        seconds = time.perf_counter() - started_s
    told = {
        "on": name,
        "recordings": len(recordings),
        "areas": done.areas,
        "tiles": done.tiles,
        "pings": done.run.pings,
        "failed": len(done.failed),
        "pings_per_second": round(done.run.pings / seconds, 1),
    }
    return told, done.occupancy


def difference(one: OccupancyMap, other: OccupancyMap) -> dict[str, Any]:
    """By how much two maps differ, on the rectangle around both."""
    geometry = GridGeometry.around([one.geometry, other.geometry])
    walls, log_odds = np.zeros((2, *geometry.shape), np.bool_), np.zeros((2, *geometry.shape))
    for number, each in enumerate((one, other)):
        here = each.geometry.within(geometry)
        walls[number][here], log_odds[number][here] = each.predicted(), each.log_odds
    return {
        "cells_at_0.65": int(walls[0].sum()),
        "other_cells": int((walls[0] != walls[1]).sum()),
        "greatest_difference": round(float(np.abs(log_odds[0] - log_odds[1]).max()), 4),
    }


def main() -> None:
    """Measure each way in turn; one JSON object a line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--areas", type=int, default=4)
    parser.add_argument("--distance", type=float, default=30.0, help="from one to the next, m")
    parser.add_argument("--tile", type=float, default=math.inf, help="side of a tile, m")
    parser.add_argument("--pings", type=int, default=600, help="in each area")
    parser.add_argument("--stretch", type=int, default=STRETCH, help="pings a worker gets at once")
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2, 4])
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        bags = Path(folder)
        write(bags, arguments.areas, arguments.distance, arguments.pings)
        most = max(arguments.workers)
        ways: list[tuple[str, Callable[[], AbstractContextManager[Any]], bool]] = [
            ("one process, areas as a whole", nullcontext, False),
            ("one process", nullcontext, False),
            ("a pool of 2", lambda: worker_processes(2), False),
            *((f"Dask, {n}", lambda n=n: cluster("local", n), False) for n in arguments.workers),
            (f"Dask, {most}, one killed", lambda: cluster("local", most), True),
        ]
        first: OccupancyMap | None = None
        for number, (name, place, kill) in enumerate(ways):
            tile_m = arguments.tile if number else math.inf
            told, occupancy = measure(bags, name, place(), arguments.stretch, tile_m, kill=kill)
            first = first or occupancy
            print(json.dumps(told | difference(first, occupancy)), flush=True)


if __name__ == "__main__":
    main()
