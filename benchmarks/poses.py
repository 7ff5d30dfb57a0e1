"""How far poses are off as odometry tells them, and as the echoes correct them.

Three robots whose odometry drifts, in scenes drawn at random: ``python benchmarks/poses.py --seeds
31 32 33``.  Aligned is what each robot's way is off once it is laid over its true one as a stiff
body: the rest is a shift and a turn of all that the robot knows, which its start tells and no
range.  NEES is the squared error of places over what the stated covariance makes one expect: 1 if
it is right.  The maps that come of told, refined and true poses are compared with ``--maps``, which
takes some minutes: F1, known, leak and lost.  ``swarm`` are five robots with sensors that measure
ranges only, and with ``--first-echoes`` all report the first echo of each ping alone.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import scenes
from rangings import first_echoes, range_cones

from usmap_ros.evaluation.scoring import score
from usmap_ros.evaluation.trajectories import score_paths
from usmap_ros.localisation import Refinement, refine_poses
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.fields_of_view import Beam
from usmap_ros.pings.robot_paths import RobotPaths
from usmap_ros.pings.trajectory import Trajectory
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.simulation import Scenario, simulate, true_paths

Ping = tuple[str, EchoCone]
KINDS = ("poles", "rough_rooms", "smooth_rooms", "flat_rough", "flat_smooth")
#: Measures ranges only.
SWARM = "swarm"


def scenario(kind: str, seed: int, pings: int, speed_m_s: float) -> Scenario:
    """A scene in which three robots drift."""
    is_swarm = kind == SWARM
    content = scenes.scenario(kind, "ranges" if is_swarm else "plain", seed).model_dump()
    content["duration_s"] = pings / 10.0
    for robot in content["robots"]:
        robot |= {"odometry": {}, "pose_error": {}}
        if not is_swarm:
            robot["motion"]["speed_m_s"] = speed_m_s
    return Scenario.from_mapping(content, scenes.FLAT.parent / "drifting.yaml")


def heard(scene: Scenario, kind: str) -> tuple[list[Ping], dict[tuple[str, int], Pose]]:
    """What robots hear, with poses as told, and their true poses."""
    pipeline = Pipeline()
    told = [(topic, pipeline.reconstruct(trace)) for topic, trace in simulate(scene)]
    true = places(true_paths(scene))
    if kind != SWARM:
        return told, true
    # Ranges are read where the robots really are, and told from where they think they are.
    reported = {(topic, one.stamp_ns): one.pose for topic, one in told}
    exact = range_cones(scene)
    return [(t, replace(one, pose=reported[t, one.stamp_ns])) for t, one in exact], true


def places(paths: Mapping[str, Trajectory]) -> dict[tuple[str, int], Pose]:
    """True poses by topic and stamp."""
    return {
        (topic, stamp_ns): Pose(position_m, orientation)
        for topic, path in paths.items()
        for stamp_ns, position_m, orientation in zip(
            path.stamps_ns.tolist(), path.positions_m, path.orientations, strict=True
        )
    }


def ate_m(pings: list[Ping], true: Mapping[tuple[str, int], Pose]) -> float:
    """Root mean square of how far places are off."""
    off_m = [one.pose.position_m - true[topic, one.stamp_ns].position_m for topic, one in pings]
    return float(np.sqrt(np.mean(np.sum(np.square(off_m), axis=1))))


def aligned_ate_m(pings: list[Ping], true: Mapping[tuple[str, int], Pose]) -> float:
    """The same of ways that are laid over their true ones, each as a stiff body."""
    squares, count = 0.0, 0
    for robot in sorted({topic for topic, _ in pings}):
        own = [one for topic, one in pings if topic == robot]
        stamps_ns = np.array([one.stamp_ns for one in own])
        ways = (
            Trajectory.planar(stamps_ns, np.array([[*p.position_m[:2], p.yaw_rad] for p in poses]))
            for poses in ([one.pose for one in own], [true[robot, one.stamp_ns] for one in own])
        )
        found = score_paths(*({robot: way} for way in ways), aligned=True)[robot]
        squares, count = squares + found.poses * found.ate_m**2, count + found.poses
    return float(np.sqrt(squares / count))


def map_score(scene: Scenario, pings: list[Ping]) -> str:
    """F1, known, leak and lost of the map that comes of pings."""
    pipeline, paths = Pipeline(), RobotPaths()
    for topic, one in pings:
        pipeline.fuse(one)
        x_m, y_m, _ = map(float, one.pose.position_m)
        paths.add(topic, x_m, y_m, Beam.of(one), one.stamp_ns)
    found = score(pipeline.occupancy_map(), scene.truth_map(), paths.views())
    return f"{found.f1:.2f} / {found.known:.2f} / {found.leak:.3f} / {found.lost:.3f}"


def nees(found: Refinement, true: Mapping[tuple[str, int], Pose]) -> float:
    """Mean squared error of places, in units of what the stated covariance makes one expect."""
    off_m = np.array(
        [
            one.pose.position_m[:2] - true[topic, one.stamp_ns].position_m[:2]
            for topic, one in found.pings
        ]
    )
    known = found.covariances[:, :2, :2] + 1e-8 * np.eye(2)
    return float(np.einsum("ni,nij,nj->n", off_m, np.linalg.inv(known), off_m).mean() / 2.0)


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kinds", nargs="+", choices=scenes.KINDS, default=KINDS)
    parser.add_argument("--seeds", nargs="+", type=int, default=[31, 32, 33])
    parser.add_argument("--pings", type=int, default=200)
    parser.add_argument("--speed", type=float, default=0.6)
    parser.add_argument("--maps", action="store_true", help="score maps, too")
    parser.add_argument("--first-echoes", action="store_true", help="as sonars' Range has them")
    arguments = parser.parse_args()
    more = ("told: F1 / known / leak / lost", "refined", "true") if arguments.maps else ()
    columns = ("scene", "seed", "told", "refined", "aligned", "NEES", "ms a ping", *more)
    print("| " + " | ".join(columns) + " |")
    print("|" + "---|" * len(columns))
    for kind in arguments.kinds:
        for seed in arguments.seeds:
            scene = scenario(kind, seed, arguments.pings, arguments.speed)
            told, true = heard(scene, kind)
            if arguments.first_echoes:
                told = first_echoes(told, scene)
            started_s = time.process_time()
            found = refine_poses(told)
            refined = found.pings
            cost_ms = (time.process_time() - started_s) / len(told) * 1e3
            row = [kind, str(seed), f"{ate_m(told, true):.3f}", f"{ate_m(refined, true):.3f}"]
            row += [f"{aligned_ate_m(refined, true):.3f}"]
            row += [f"{nees(found, true):.1f}", f"{cost_ms:.1f}"]
            if arguments.maps:
                exact = [(t, replace(one, pose=true[t, one.stamp_ns])) for t, one in told]
                row += [map_score(scene, pings) for pings in (told, refined, exact)]
            print("| " + " | ".join(row) + " |", flush=True)


if __name__ == "__main__":
    main()
