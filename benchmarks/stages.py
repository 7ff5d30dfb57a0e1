"""Where a map's processor time goes: milliseconds a ping of each stage of the joint estimate.

    python benchmarks/stages.py poles:100_pings:901 flat_rough:plain:901 poles.yaml:100

A scene is a kind, a condition and a seed of `scenes.py`, or a scenario of `config/scenarios` and
how many seconds of it.  One core does it all, so that threads take nothing of other stages' time.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from unittest.mock import patch

import recordings
import scenes

from usmap_ros.mapping.joint import drawing, estimate, explanation
from usmap_ros.mapping.joint.forward_model import powers
from usmap_ros.mapping.joint.free_space import (
    free_space,
    heard_of_surfaces,
    listening,
    silence,
)
from usmap_ros.mapping.joint.fusion import JointFusion
from usmap_ros.mapping.joint.surfaces import smooth_surfaces
from usmap_ros.parameters import MappingParameters, ReconstructionParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.simulation import Scenario

#: What is timed as what; what one calls of another is the other's.
STAGES: dict[str, list[tuple[Any, str]]] = {
    "candidates": [(powers, "count_all_hits"), (powers, "candidates")],
    "projection": [(powers, "project")],
    "rays": [
        (powers, "cast_rays"), (smooth_surfaces, "cast_all_rays"), (free_space, "cast_all_rays"),
    ],
    "shadows": [(powers, "cast_shadows")],
    "sweeps": [(powers, "gather_gradients"), (powers, "update_powers")],
    "evidence": [
        (powers, "expect_powers"), (powers, "cells_of"), (powers, "weigh_pings"),
        (powers, "add_ratios"),
    ],
    "beliefs": [
        (estimate, "hiding"), (estimate, "optical_depth"), (estimate, "cell_log_odds"),
    ],
    "lines": [(estimate, "find_walls")],
    "mirrors": [(smooth_surfaces, "mirrors_of_parts")],
    "columns": [(smooth_surfaces, "columns_of_place")],
    "far points": [(smooth_surfaces, "lone_points")],
    "response": [
        (listening, "listen"), (silence, "look_at"), (silence, "learn_response"),
    ],
    "refutation": [(heard_of_surfaces, "refute_surfaces")],
    "first pings": [(explanation, "first_log_odds")],
    "normals and ambiguity": [(drawing, "surface_normals"), (drawing, "undecided")],
}  # fmt: skip


class Stages:
    """Processor time of each stage of what is done meanwhile, s."""

    def __init__(self) -> None:
        self.times_s = dict.fromkeys(STAGES, 0.0)
        self._inner_s: list[float] = []
        self._patches = ExitStack()

    def __enter__(self) -> Stages:
        for stage, functions in STAGES.items():
            for module, name in functions:
                timed = self._timed(stage, getattr(module, name))
                self._patches.enter_context(patch.object(module, name, timed))
        return self

    def __exit__(self, *what: object) -> None:
        self._patches.close()

    def _timed(self, stage: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*given: Any, **named: Any) -> Any:
            started = time.process_time()
            self._inner_s.append(0.0)
            result = function(*given, **named)
            taken_s = time.process_time() - started
            self.times_s[stage] += taken_s - self._inner_s.pop()
            if self._inner_s:
                self._inner_s[-1] += taken_s
            return result

        return timed


def cones_of(scene: str) -> list[EchoCone]:
    """Cones of a scene as the command line names it."""
    kind, *rest = scene.split(":")
    sensor = "sonar"
    if kind.endswith(".yaml"):
        scenario = Scenario.load(scenes.ROOT / "config" / "scenarios" / kind)
        scenario = scenario.model_copy(update={"duration_s": float(rest[0])})
    else:
        condition, seed = rest
        scenario, sensor = (
            scenes.scenario(kind, condition, int(seed)), scenes.CONDITIONS[condition].sensor,
        )  # fmt: skip
    kept = Path(os.environ.get("TMPDIR", "/tmp"), "usmap_bench")
    kept.mkdir(exist_ok=True)
    return [
        cone for _, cone in recordings.cones(scenario, ReconstructionParameters(), kept, sensor)
    ]


def stages_of(cones: list[EchoCone]) -> dict[str, float]:
    """Milliseconds a ping of each stage, of all that is not among them, and of the whole."""
    fusion = JointFusion(MappingParameters())
    for cone in cones:
        fusion.fuse(cone)
    with Stages() as stages:
        started = time.process_time()
        fusion.occupancy_map()
        whole_s = time.process_time() - started
    times_s = dict(stages.times_s)
    times_s["the rest"] = whole_s - sum(times_s.values())
    times_s["all"] = whole_s
    return {stage: 1e3 * taken_s / len(cones) for stage, taken_s in times_s.items()}


def main() -> None:
    """Print a table: a row for each stage, a column for each scene."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="+")
    chosen = parser.parse_args().scenes
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    recorded = [cones_of(scene) for scene in chosen]
    # All is compiled, or loaded, before anything is timed.
    stages_of(recorded[0])
    columns = [stages_of(cones) for cones in recorded]
    print("| ms a ping of processor time |", " | ".join(chosen), "|")
    print("|---|" + "---:|" * len(chosen))
    print("| pings |", " | ".join(str(len(cones)) for cones in recorded), "|")
    for stage in columns[0]:
        print(f"| {stage} |", " | ".join(f"{column[stage]:.2f}" for column in columns), "|")


if __name__ == "__main__":
    main()
