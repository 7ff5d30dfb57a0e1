"""What a live map costs as the window grows: processor time of one, after so many pings.

    python benchmarks/live_map.py poles:100_pings:901 flat_rough:plain:901

A scene is a kind, a condition and a seed of `scenes.py`, recorded for as long as it takes.  After
each number of pings the map is worked out of all of them; then a second's worth comes, of three
robots that ping ten times a second, and the next map is asked for: as nodes do, and whole.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import recordings
import scenes

from usmap_ros.grids import OccupancyMap
from usmap_ros.mapping.joint.fusion import JointFusion
from usmap_ros.parameters import MappingParameters, ReconstructionParameters
from usmap_ros.pings.cone import EchoCone

#: Pings that a map is made of, and those that come before the next one.
WINDOWS, NEW = (600, 1200, 2400), 30


def cones_of(scene: str, pings: int) -> list[EchoCone]:
    """So many cones of a scene."""
    kind, condition, seed = scene.split(":")
    scenario = scenes.scenario(kind, condition, int(seed))
    kept = Path(os.environ.get("TMPDIR", "/tmp"), "usmap_bench")
    kept.mkdir(exist_ok=True)
    cones: list[EchoCone] = []
    for longer in (2, 4, 8, 16):
        longer_one = scenario.model_copy(update={"duration_s": longer * scenario.duration_s})
        told = recordings.cones(
            longer_one, ReconstructionParameters(), kept, scenes.CONDITIONS[condition].sensor
        )
        cones = [cone for _, cone in told]
        if len(cones) >= pings:
            return cones[:pings]
    raise SystemExit(f"{scene}: has {len(cones)} pings, must have {pings}")


def ms_of(make: Callable[[], OccupancyMap]) -> float:
    """Processor time of a map."""
    started = time.process_time()
    make()
    return 1e3 * (time.process_time() - started)


def costs(cones: Sequence[EchoCone], window: int) -> tuple[float, float]:
    """Processor time of a live map and of a whole one after the newest pings, ms."""
    fusion = JointFusion(MappingParameters())
    for cone in cones[:window]:
        fusion.fuse(cone)
    fusion.live_snapshot()()
    for cone in cones[window : window + NEW]:
        fusion.fuse(cone)
    return ms_of(fusion.live_snapshot()), ms_of(fusion.occupancy_map)


def main() -> None:
    """Print a table: a row for each scene and window."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="+")
    parser.add_argument("--pings", type=int, nargs="+", default=WINDOWS)
    arguments = parser.parse_args()
    chosen, windows = arguments.scenes, arguments.pings
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    print("| ms of processor time a map | pings before | live | whole |")
    print("|---|---:|---:|---:|")
    for scene in chosen:
        cones = cones_of(scene, max(windows) + NEW)
        # All is compiled, or loaded, before anything is timed.
        costs(cones, 200)
        for window in windows:
            live_ms, whole_ms = costs(cones, window)
            print(f"| {scene} | {window} | {live_ms:.0f} | {whole_ms:.0f} |", flush=True)


if __name__ == "__main__":
    main()
