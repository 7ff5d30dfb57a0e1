"""How long fusion takes, how much memory a map takes, and how fast recordings become maps."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from usmap_ros.io.bag_reader import BagReader
from usmap_ros.io.bags import write_bag
from usmap_ros.parameters import PipelineParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.robot_paths import RobotPaths
from usmap_ros.reconstruction.reconstructor import reconstruct
from usmap_ros.runs.offline import map_bag
from usmap_ros.runs.pipeline import FUSIONS, Pipeline
from usmap_ros.simulation import Scenario, simulate

SCENARIO = Path(__file__).parents[1] / "config/scenarios/poles.yaml"
#: Runs the command line.
USMAP = [sys.executable, "-m", "usmap_ros"]


def run() -> dict[str, Any]:
    """Measure; times are those of one core's processor time."""
    scenario = Scenario.load(SCENARIO)
    pings = list(simulate(scenario))
    parameters = PipelineParameters()
    cones = [reconstruct(trace, parameters.reconstruction).cone for _, trace in pings]
    results: dict[str, Any] = {"pings": len(pings)}
    for method in FUSIONS:
        results |= fusion(cones, method)
    results |= whole_map(cones)
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / "bag"
        write_bag(bag, pings)
        results |= end_to_end(bag)
        results["process_memory_mb"] = process_memory_mb(bag, Path(folder) / "map")
    return results


def fusion(cones: list[EchoCone], method: str) -> dict[str, Any]:
    """Milliseconds a ping and, of the default method, memory by observed area."""
    parameters = PipelineParameters()
    mapping = parameters.mapping.model_copy(update={"method": method})
    pipeline = Pipeline(parameters.model_copy(update={"mapping": mapping}))
    times = []
    for cone in cones:
        started = time.process_time()
        pipeline.fuse(cone)
        times.append(1e3 * (time.process_time() - started))
    results: dict[str, Any] = {
        f"{method}_ms_a_ping": float(np.median(times)),
        f"{method}_90_percent_ms": float(np.quantile(times, 0.9)),
    }
    if method == parameters.mapping.method:
        observed = np.count_nonzero(pipeline.occupancy_map().observed)
        area_m2 = observed * mapping.resolution_m**2
        results["observed_m2"] = area_m2
        results["map_kb_a_m2"] = pipeline.fusion.memory_bytes / 1e3 / area_m2
    return results


def whole_map(cones: list[EchoCone]) -> dict[str, Any]:
    """How long the default method's map of all pings takes, on one core and on all there are.

    The map is worked out when it is asked for.  Threads are timed by the clock, which others'
    load disturbs.
    """
    allowed = os.sched_getaffinity(0)
    clock_s, busy_s = [], []
    for cores in (allowed, {min(allowed)}, allowed):
        os.sched_setaffinity(0, cores)
        pipeline = Pipeline()
        for cone in cones:
            pipeline.fuse(cone)
        started = time.perf_counter(), time.process_time()
        pipeline.occupancy_map()
        clock_s.append(time.perf_counter() - started[0])
        busy_s.append(time.process_time() - started[1])
    # The first one has all compiled.
    return {
        "map_ms_a_ping": 1e3 * busy_s[1] / len(cones),
        "cores": len(allowed),
        "map_faster_by_all_cores": clock_s[1] / clock_s[2],
    }


def end_to_end(bag: Path) -> dict[str, Any]:
    """Pings a second from an open recording to a finished map."""
    started = time.process_time()
    pipeline = Pipeline()
    with BagReader([bag]) as reader:
        done = map_bag(reader, pipeline, RobotPaths())
    pipeline.occupancy_map()
    return {"offline_pings_a_second": done.pings / (time.process_time() - started)}


def process_memory_mb(bag: Path, folder: Path) -> float:
    """Largest memory of a process that runs ``usmap map``."""
    subprocess.run(
        [*USMAP, "map", str(bag), "-o", str(folder)], stdout=subprocess.DEVNULL, check=True
    )
    return float(json.loads((folder / "summary.json").read_text())["peak_memory_mb"])


if __name__ == "__main__":
    print(json.dumps(run(), indent=2))
