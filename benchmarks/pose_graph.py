"""Pose graphs of submaps, by how many there are: time, memory, and how far poses are off.

A robot wanders from place to place of a building while its heading drifts.  Each submap lies over
the last two that were made in the same place, and one edge in a hundred is wrong.

    python benchmarks/pose_graph.py --submaps 100 1000 10000
"""

from __future__ import annotations

import argparse
import json
import time
import tracemalloc
from typing import Any

import numpy as np

from usmap_ros.localisation.planar import between, compose
from usmap_ros.localisation.submap_graph import Edge, in_line
from usmap_ros.localisation.tracks import Track

#: Places along either side of the building, and from one to the next, m.
PLACES, APART_M = 12, 3.0
#: What each step is off: drift and chance, m and rad.
DRIFT_RAD, CHANCE = 0.001, np.array([0.02, 0.02, 0.01])
#: What edges are off by chance, m and rad; the share of wrong ones, and what these are off.
OFF, WRONG, WRONG_BY = np.array([0.03, 0.03, 0.01]), 0.01, np.array([2.0, 2.0, 1.0])


def graph(submaps: int, seed: int) -> tuple[np.ndarray, Track, list[Edge]]:
    """True poses, the way as odometry has it, and edges."""
    rng = np.random.default_rng(seed)
    ways = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])
    place, heading, true, places = np.zeros(2, np.intp), 0, np.zeros((submaps, 3)), []
    for number in range(submaps):
        true[number] = *(APART_M * place), 0.5 * np.pi * heading
        places.append(tuple(place))
        heading = next(
            turn
            for turn in rng.permutation(4)
            if np.all((there := place + ways[turn]) >= 0) and np.all(there < PLACES)
        )
        place = place + ways[heading]
    steps = between(true[:-1], true[1:]) + rng.normal(size=(submaps - 1, 3)) * CHANCE
    steps[:, 2] += DRIFT_RAD
    told = [true[0]]
    for step in steps:
        told.append(compose(told[-1], step))
    known = np.arange(1, submaps + 1)[:, np.newaxis, np.newaxis] * np.diag(CHANCE**2)
    way = Track(np.arange(submaps), np.array(told), known, np.zeros(submaps, np.int64), 1)
    edges, last = [], dict[tuple[int, ...], list[int]]()
    for number, where in enumerate(places):
        for before in last.setdefault(where, [])[-2:]:
            off = rng.normal(size=3) * (WRONG_BY if rng.random() < WRONG else OFF)
            seen = compose(between(true[before], true[number]), off)
            edges.append(Edge((0, before), (0, number), seen))
        last[where].append(number)
    return true, way, edges


def measure(submaps: int, seed: int) -> dict[str, Any]:
    """Solve one."""
    true, way, edges = graph(submaps, seed)
    started_s = time.process_time()
    (poses,) = in_line([way], edges)
    seconds = time.process_time() - started_s
    tracemalloc.start()
    in_line([way], edges)
    peak_mb = tracemalloc.get_traced_memory()[1] / 1e6
    tracemalloc.stop()
    told_m, found_m = (
        float(np.sqrt(np.mean(np.sum((each[:, :2] - true[:, :2]) ** 2, axis=1))))
        for each in (way.told, poses)
    )
    return {
        "submaps": submaps, "edges": len(edges), "seconds": round(seconds, 2),
        "peak_mb": round(peak_mb, 1), "told_off_m": round(told_m, 3), "off_m": round(found_m, 3),
    }  # fmt: skip


def main() -> None:
    """Print one JSON object a line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--submaps", type=int, nargs="+", default=[100, 1000, 10000])
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    for submaps in arguments.submaps:
        print(json.dumps(measure(submaps, arguments.seed)), flush=True)


if __name__ == "__main__":
    main()
