"""Robots that nobody knows the starts of: who is joined, and whether rightly.

Three robots whose odometry begins at their own starts, in scenes drawn at random: ``python
benchmarks/joining.py --kinds flat_rough --seeds 61 62 63``.  Robots wander, and may stay in the
room where they began; with ``--tours`` they go from place to place all over the scene.  Where
somebody stays alone, it says what each two robots share: pieces of 0.3 m that stand, seen from the
same side, in both of the maps that come of their true poses.  With ``--apart``, robots of one scene
and of the scene of the next seed, which must not be joined; flats are one place for all seeds.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from itertools import combinations

import numpy as np
import scenes
from poses import Ping, places, scenario
from tours import FloatArray, tours

from usmap_ros.localisation.planar import compose
from usmap_ros.localisation.submap import Submap, in_common
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import PipelineParameters
from usmap_ros.runs.correction import Corrected, correct_poses
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.simulation import Scenario, simulate, true_paths


def unknown_starts(
    kind: str, seed: int, pings: int, speed_m_s: float, is_toured: bool = False
) -> Scenario:
    """A scene in which robots drift from starts of their own, and go all over it if wanted."""
    scene = scenario(kind, seed, pings, speed_m_s)
    content = scene.model_dump()
    for robot in content["robots"]:
        robot["odometry"] = {"start": "unknown"}
    if is_toured:
        for robot, motion in zip(content["robots"], tours(scene, seed), strict=True):
            robot["motion"] = motion
    return Scenario.from_mapping(content, scenes.FLAT.parent / "drifting.yaml")


def heard(scene: Scenario, prefix: str = "") -> list[Ping]:
    """Cones of a scene; a prefix keeps robots of several scenes apart."""
    pipeline = Pipeline()
    pings = []
    for topic, trace in simulate(scene):
        cone = pipeline.reconstruct(trace)
        own = {name: f"{prefix}{getattr(cone, name)}" for name in ("frame_id", "child_frame_id")}
        pings.append((f"/{prefix}{topic.strip('/')}", replace(cone, **own)))
    return pings


def off_m(done: Corrected, true: dict[tuple[str, int], Pose], robots: list[str]) -> float:
    """How far places of robots in one frame are off, laid over the true ones (RMS)."""
    ways = [
        (cone.pose.position_m[:2], true[topic, cone.stamp_ns].position_m[:2])
        for topic, cone in done.pings
        if topic.split("/")[1] in robots
    ]
    found_m, true_m = np.swapaxes(ways, 0, 1)
    there = compose(laid_over(found_m, true_m), np.column_stack([found_m, np.zeros(len(ways))]))
    return float(np.sqrt(np.mean(np.sum((there[:, :2] - true_m) ** 2, axis=1))))


def laid_over(found_m: FloatArray, true_m: FloatArray) -> FloatArray:
    """Pose of a frame in which places are found in the one in which they truly are."""
    one, other = (places_m - places_m.mean(axis=0) for places_m in (found_m, true_m))
    turn = np.vdot(one @ [1.0, 1.0j], other @ [1.0, 1.0j])
    turned = compose(np.array([0.0, 0.0, np.angle(turn)]), np.append(found_m.mean(axis=0), 0.0))
    return np.append(true_m.mean(axis=0) - turned[:2], np.angle(turn))


def shared(pings: list[Ping], true: dict[tuple[str, int], Pose]) -> str:
    """How many pieces each two robots have in common by their true poses."""
    pipelines: dict[str, Pipeline] = {}
    for topic, cone in pings:
        pipeline = pipelines.setdefault(topic.split("/")[1], Pipeline())
        pipeline.fuse(replace(cone, frame_id="map", pose=true[topic, cone.stamp_ns]), topic)
    maps = [Submap.of(pipeline.occupancy_map()) for pipeline in pipelines.values()]
    # Both maps' are counted.
    return ", ".join(f"{0.5 * in_common(*two)[0]:.0f}" for two in combinations(maps, 2))


def options(description: str | None, seeds: list[int]) -> argparse.ArgumentParser:
    """Which scenes of robots with unknown starts are wanted, those of some seeds by default."""
    parser = argparse.ArgumentParser(description=description)
    kinds = [*scenes.KINDS, *scenes.UNSCORED]
    parser.add_argument("--kinds", nargs="+", choices=kinds, default=["flat_rough"])
    parser.add_argument("--seeds", nargs="+", type=int, default=seeds)
    parser.add_argument("--pings", type=int, default=400)
    parser.add_argument("--speed", type=float, default=0.6)
    parser.add_argument("--tours", action="store_true", help="robots go all over the scene")
    return parser


def main() -> None:
    """Print a table."""
    parser = options(__doc__, [61, 62, 63])
    parser.add_argument("--apart", action="store_true", help="robots of two scenes")
    arguments = parser.parse_args()
    print("| scene | seed | joined | off, m | shared: 12, 13, 23 | ms a ping |")
    print("|---|---|---|---|---|---|")
    for kind in arguments.kinds:
        for seed in arguments.seeds:
            how = arguments.pings, arguments.speed, arguments.tours
            scene = unknown_starts(kind, seed, *how)
            here, true = heard(scene), places(true_paths(scene))
            pings = here
            if arguments.apart:
                other = unknown_starts(kind, seed + 1, *how)
                pings = sorted(pings + heard(other, "other_"), key=lambda ping: ping[1].stamp_ns)
            started_s = time.process_time()
            done = correct_poses(pings, PipelineParameters())
            cost_ms = (time.process_time() - started_s) / len(pings) * 1e3
            groups: dict[str, list[str]] = {}
            for robot, one in done.robots.items():
                groups.setdefault(one.frame_id, []).append(robot)
            joined = [group for group in groups.values() if len(group) > 1]
            off = [
                "wrong" if len({one.startswith("other_") for one in group}) > 1
                else f"{off_m(done, true, group):.2f}" if not group[0].startswith("other_") else "-"
                for group in joined
            ]  # fmt: skip
            common = shared(here, true) if any(len(one) == 1 for one in groups.values()) else ""
            names = "; ".join(" ".join(group) for group in joined) or "nobody"
            row = kind, str(seed), names, "; ".join(off), common, f"{cost_ms:.1f}"
            print("| " + " | ".join(row) + " |", flush=True)


if __name__ == "__main__":
    main()
