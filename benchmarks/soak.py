"""Whether time and memory stay flat while cones keep coming: a hundred thousand of them.

Three robots go round among poles over and over, with the errors that their odometry has; their
cones go into the fusion as map_fusion runs it, which is asked for its map every few seconds of
their time.  Prints one line for every tenth of the cones.

    nice -n 19 python benchmarks/soak.py --cones 100000
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from memory import resident_mb

from usmap_ros.live.live_fusion import LiveFusion
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.simulation import Scenario, simulate

SCENARIO = Path(__file__).parents[1] / "config/scenarios/poles.yaml"
#: Cones between two maps: about a second of three robots, and ten.
MAP_EVERY = 30
#: Error of a position, m, that is another one each time round.
POSITION_ERROR_M = 0.01


def endless(seed: int = 1) -> Iterator[tuple[str, EchoCone]]:
    """Cones of a scenario, again and again, later each time."""
    pipeline = Pipeline()
    recorded = [(topic, pipeline.reconstruct(trace)) for topic, trace in simulate(_scenario())]
    step_ns = recorded[-1][1].stamp_ns - recorded[0][1].stamp_ns + 10**8
    rng = np.random.default_rng(seed)
    turn = 0
    while True:
        for topic, cone in recorded:
            error_m = np.append(rng.normal(0.0, POSITION_ERROR_M, 2), 0.0)
            pose = replace(cone.pose, position_m=cone.pose.position_m + error_m)
            yield topic, replace(cone, pose=pose, stamp_ns=cone.stamp_ns + turn * step_ns)
        turn += 1


def _scenario() -> Scenario:
    return Scenario.load(SCENARIO)


def main() -> None:
    """Fuse cones, and say how that goes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cones", type=int, default=100_000)
    arguments = parser.parse_args()
    fusion = LiveFusion(MappingParameters(), order_wait_s=0.0, capacity=1000)
    cones, tenth = endless(), max(arguments.cones // 10, 1)
    done = 0
    while done < arguments.cones:
        fusion_s = map_s = 0.0
        maps, number = 0, min(tenth, arguments.cones - done)
        for _ in range(number):
            topic, cone = next(cones)
            begun_s = time.process_time()
            fusion.receive(topic, cone)
            while fusion.fuse_next() is not None:
                pass
            fusion_s += time.process_time() - begun_s
            done += 1
            if done % MAP_EVERY == 0:
                begun_s = time.process_time()
                fusion.occupancy_map()
                map_s += time.process_time() - begun_s
                maps += 1
        told = {
            "cones": done,
            "ms_a_cone": round(1e3 * fusion_s / number, 3),
            "ms_a_map": round(1e3 * map_s / max(maps, 1), 1),
            "resident_mb": round(resident_mb(), 1),
        }
        print(json.dumps(told), flush=True)


if __name__ == "__main__":
    main()
