"""How long fusing a cone takes by cell size, range, and area of the map.

The world is that of a scenario of poles, larger where pings reach farther.  "areas" is how many
worlds like it, side by side, robots have gone through before the cones that are timed: fusion
should not care.  Times are medians in milliseconds of one core, of the last cones; F1 and known
are those of the map.
"""

from __future__ import annotations

import json
import time
from dataclasses import replace
from itertools import islice
from typing import Any

import numpy as np
from reconstruction import of_range

from usmap_ros.evaluation.scoring import score
from usmap_ros.parameters import MappingParameters, PipelineParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.fields_of_view import PingViews
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.simulation import Scenario, simulate

#: Pings, and how many of them, the last ones, are timed.
PINGS, TIMED = 150, 60
RESOLUTION_M, RANGE_M = 0.05, 5.0
#: From one area to the next: more than twice a range.
DISTANCE_M = 25.0


def run() -> dict[str, Any]:
    """Measure; every figure differs in one thing from the defaults."""
    scenario = of_range(RANGE_M)
    cones = heard(scenario)
    figures: dict[str, Any] = {"pings": PINGS}
    for resolution_m in (RESOLUTION_M, 0.1, 0.025, 0.01):
        figures |= fused(f"cell_{1e3 * resolution_m:g}_mm", scenario, cones, resolution_m)
    for range_m in (10.0, 20.0):
        far = of_range(range_m)
        figures |= fused(f"range_{range_m:g}_m", far, heard(far), RESOLUTION_M)
    for areas in (4, 16):
        figures |= fused(f"areas_{areas}", scenario, cones, RESOLUTION_M, areas)
    return figures


def heard(scenario: Scenario) -> list[EchoCone]:
    """Cones of its pings."""
    pipeline = Pipeline()
    return [pipeline.reconstruct(trace) for _, trace in islice(simulate(scenario), PINGS)]


def fused(
    name: str, scenario: Scenario, cones: list[EchoCone], resolution_m: float, areas: int = 1
) -> dict[str, float]:
    """Milliseconds a cone, F1 and known."""
    mapping = MappingParameters(resolution_m=resolution_m, most_cells=10**9)
    pipeline = Pipeline(PipelineParameters(mapping=mapping))
    for area in range(1, areas):
        for cone in cones[:: 2 * areas]:
            place_m = cone.pose.position_m + np.array([area * DISTANCE_M, 0.0, 0.0])
            pipeline.fuse(replace(cone, pose=replace(cone.pose, position_m=place_m)))
    spent = []
    for cone in cones:
        begun_s = time.process_time()
        pipeline.fuse(cone)
        spent.append(1e3 * (time.process_time() - begun_s))
    timed = spent[-TIMED:]
    figures = {f"{name}_ms": float(np.median(timed)), f"{name}_mean_ms": float(np.mean(timed))}
    if areas == 1:
        truth = scenario.truth_map(resolution_m)
        found = score(pipeline.occupancy_map(), truth, PingViews.of(cones))
        figures |= {f"{name}_f1": found.f1, f"{name}_known": found.known}
    return figures


if __name__ == "__main__":
    print(json.dumps(run(), indent=2))
