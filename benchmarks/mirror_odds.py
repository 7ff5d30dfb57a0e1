"""How well it is told whether a place has mirrors, or panes, and the weights by which it is.

Rooms with smooth and with rough walls, and poles, are recorded by sensors that differ from the
usual one, their walls by surfaces that do; what was heard squarely is looked at.  Weights of
`usmap_ros.mapping.joint.surfaces.mirror_odds` are fitted by logistic regression to all seeds but
one, and judged by that one, for each in turn; those of the product are judged by all.

With ``--panes``, rooms of which some walls are of glass and rough places are recorded by some of
the sensors, and lines of lone echoes are looked at, one after the other, for the weights of
`usmap_ros.mapping.joint.surfaces.panes`.

python benchmarks/mirror_odds.py [--seeds 1000 1001 1002 1003] [--panes]
"""

from __future__ import annotations

import argparse
import json
import random
from collections.abc import Callable, Iterator, Sequence
from itertools import product
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
from logistic import logistic_weights
from numpy.typing import NDArray
from rich.progress import track
from scenes import scenario
from scipy.special import expit, logit

from usmap_ros.mapping.joint.surfaces import mirror_odds, mirror_walls, panes
from usmap_ros.mapping.joint.surfaces.mirrors import MirrorWall
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.simulation import Scenario, simulate
from usmap_ros.simulation.occlusion import point_segment_distances
from usmap_ros.simulation.scene import WallSegments

FloatArray = NDArray[np.float64]
SMOOTH = ("columns_smooth", "turned_smooth", "flat_smooth", "smooth_rooms")
ROUGH = (
    "flat_rough", "columns_rough", "turned_rough", "depot", "corridors", "corners", "clutter",
    "warehouse", "arena", "swarm",
)  # fmt: skip
#: Mirror and scattering reflectivities of walls, of which one each is drawn.
SURFACES = {
    True: ((0.35, 0.5, 0.8), (0.1, 0.3, 0.6)),
    False: ((0.05, 0.1, 0.2), (3.0, 5.0, 8.0)),
}
#: What differs of transducers, by name.
SENSORS: dict[str, dict[str, Any]] = {
    "usual": {},
    "raw": {"receiver": {"encoding": "raw", "sample_rate_hz": 250_000.0}},
    "envelope": {"receiver": {"encoding": "envelope", "sample_rate_hz": 40_000.0}},
    "noisy": {"receiver": {"noise_std": 0.03}},
    "wide": {"beam": {"kind": "linear", "half_angle_rad": 1.2}},
    "piston": {"beam": {"kind": "piston"}},
    "narrow": {"beam": {"kind": "senscomp_600"}},
    "far": {"max_range_m": 10.0},
    "long pulse": {"pulse": {"shape": "hann_burst", "carrier_hz": 40_000.0, "duration_s": 0.001}},
}
CONDITIONS = ("100_pings", "plain", "few_pings", "headings_off")
#: Conditions and sensors of panes, and mirror reflectivity from which on a wall is one.
OF_PANES, GLASS = (("100_pings", "plain"), ("usual", "raw", "wide")), 0.3
#: A line is of a wall whose normal has such a cosine to its own, and that is so near to its middle.
FACES, NEAR_M = 0.97, 0.15
#: Ridge of the fit.
RIDGE = 0.01


class Heard(NamedTuple):
    """What was heard squarely in one recording."""

    #: ``smooth``, ``rough``, ``poles`` or ``panes``.
    kind: str
    seed: int
    #: (walls, signs) array.
    signs: FloatArray
    #: (walls,) bool array: which are mirrors.
    are_mirrors: NDArray[np.bool_]


def recordings(seeds: Sequence[int]) -> Iterator[tuple[str, int, Scenario]]:
    """Kind, seed and scenario of what is recorded."""
    cases = [("100_pings", name) for name in SENSORS] + [(each, "usual") for each in CONDITIONS[1:]]
    for seed in seeds:
        for condition, sensor in cases:
            draw = random.Random(f"{seed} {condition} {sensor}")
            for kind in (*draw.sample(SMOOTH, 2), *draw.sample(ROUGH, 2), "poles"):
                content = _heard_by(sensor, kind, condition, seed)
                if kind != "poles":
                    mirror, scatter = map(draw.choice, SURFACES[kind in SMOOTH])
                    surface = {"specular_reflectivity": mirror, "diffuse_reflectivity": scatter}
                    content["world"].get("map", content["world"])["surface"] |= surface
                of = "poles" if kind == "poles" else "smooth" if kind in SMOOTH else "rough"
                yield of, seed, Scenario.from_mapping(content, f"{kind} {seed}")


def _heard_by(sensor: str, kind: str, condition: str, seed: int) -> dict[str, Any]:
    """A scene whose robots carry a sensor."""
    world = scenario(kind, condition, seed)
    content: dict[str, Any] = json.loads(world.model_dump_json(exclude_unset=True))
    for robot in content["robots"]:
        robot["transducers"] = [_varied(t, sensor) for t in robot["transducers"]]
    return content


def _varied(transducer: dict[str, Any], sensor: str) -> dict[str, Any]:
    """A transducer with what differs of a sensor."""
    differs = SENSORS[sensor]
    receiver = transducer["receiver"] | differs.get("receiver", {})
    return transducer | differs | {"receiver": receiver}


def heard(kind: str, seed: int, world: Scenario) -> Heard:
    """Map a recording, and note what is told of the walls that it hears squarely."""
    noted = list[FloatArray]()

    def note(walls: Sequence[MirrorWall], explained: float) -> FloatArray:
        noted.append(mirror_odds.signs_of(walls, explained))
        return mirror_odds.mirror_odds(walls, explained)

    _map(world, mirror_walls, "mirror_odds", note)
    signs = noted[0] if noted else np.zeros((0, len(mirror_odds.WEIGHTS)))
    return Heard(kind, seed, signs, np.full(len(signs), kind == "smooth"))


def places_with_panes(seeds: Sequence[int]) -> Iterator[tuple[str, int, Scenario]]:
    """Kind, seed and scenario of what is recorded to tell panes from chance."""
    for seed, condition, sensor in product(seeds, *OF_PANES):
        draw = random.Random(f"{seed} {condition} {sensor}")
        for kind in ("panes", *draw.sample(ROUGH, 3)):
            content = _heard_by(sensor, kind, condition, seed)
            of = "panes" if kind == "panes" else "rough"
            yield of, seed, Scenario.from_mapping(content, f"{kind} {seed}")


def heard_alone(kind: str, seed: int, world: Scenario) -> Heard:
    """Map a recording, and note what is told of the lines of its lone echoes."""
    noted = list[tuple[FloatArray, NDArray[np.bool_]]]()
    walls, likely = world.scene().walls, panes.LoneLines.likely

    def note(lines: panes.LoneLines, usual_rad: float | None) -> FloatArray:
        are_panes = np.array([_is_glass(line, walls) for line in lines.lines], bool)
        noted.append((lines.facing(usual_rad), are_panes))
        return likely(lines, usual_rad)

    _map(world, panes.LoneLines, "likely", note)
    nothing = np.zeros((0, len(panes.PANE_WEIGHTS))), np.zeros(0, bool)
    return Heard(kind, seed, *(noted[0] if noted else nothing))


def _map(world: Scenario, of: object, name: str, note: Callable[..., Any]) -> None:
    """Map a recording with something else in place of a function."""
    pipeline = Pipeline()
    for topic, trace in simulate(world):
        pipeline.fuse(pipeline.reconstruct(trace), topic)
    with patch.object(of, name, note):
        pipeline.occupancy_map()


def _is_glass(line: MirrorWall, walls: WallSegments) -> bool:
    """Whether a line is of a wall that is a mirror."""
    normal = np.array([np.cos(line.normal_rad), np.sin(line.normal_rad)])
    along = 0.5 * (line.begin_m + line.end_m) * np.array([-normal[1], normal[0]])
    middle_m = normal * line.distance_m + along
    apart_m = point_segment_distances(middle_m, walls.starts_m, walls.ends_m)
    are_its = (np.abs(walls.normals @ normal) > FACES) & (apart_m < NEAR_M)
    return bool((are_its & (walls.specular_reflectivity > GLASS)).any())


def fitted(among: Sequence[Heard]) -> FloatArray:
    """Weights, such that each wall is as likely a mirror as not before it is looked at."""
    signs = np.concatenate([each.signs for each in among])
    is_mirror = np.concatenate([each.are_mirrors for each in among])
    weights = logistic_weights(signs, is_mirror, RIDGE)
    weights[0] -= logit(np.clip(is_mirror.mean(), 1e-3, 1.0 - 1e-3))
    return weights


def found(each: Heard, weights: Sequence[float] | FloatArray) -> bool:
    """Whether a place is said to have mirrors, but for those that are certain."""
    odds = np.clip(each.signs @ weights, -mirror_odds.MOST_ODDS, mirror_odds.MOST_ODDS)
    return bool(odds.sum() >= mirror_odds.LEAST_ODDS)


def expected(each: Heard, weights: Sequence[float] | FloatArray) -> bool:
    """Whether half a pane or more is expected in a place."""
    return bool(expit(each.signs @ weights + panes.PANE_BEFORE).sum() >= 0.5)


def main() -> None:
    """Print weights, and how many places of each kind are said to have mirrors."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=[1000, 1001, 1002, 1003])
    parser.add_argument("--panes", action="store_true")
    given = parser.parse_args()
    if given.panes:
        _print(given.seeds, places_with_panes, heard_alone, expected, panes.PANE_WEIGHTS)
    else:
        _print(given.seeds, recordings, heard, found, mirror_odds.WEIGHTS)


def _print(
    seeds: Sequence[int],
    recorded: Callable[[Sequence[int]], Iterator[tuple[str, int, Scenario]]],
    listen: Callable[[str, int, Scenario], Heard],
    has_mirrors: Callable[[Heard, Sequence[float] | FloatArray], bool],
    own: Sequence[float],
) -> None:
    """Record, listen, fit, judge and print."""
    todo = list(recorded(seeds))
    all_heard = [listen(*each) for each in track(todo, description="Listening", transient=True)]
    by_others = {
        seed: fitted([each for each in all_heard if each.seed != seed or len(seeds) == 1])
        for seed in seeds
    }
    print("weights", fitted(all_heard).round(2).tolist())
    print("| kind | recordings | with mirrors, by the other seeds' weights | by the product's |")
    print("|---|---:|---:|---:|")
    for kind in dict.fromkeys(each.kind for each in all_heard):
        those = [each for each in all_heard if each.kind == kind]
        others = np.mean([has_mirrors(each, by_others[each.seed]) for each in those])
        by_product = np.mean([has_mirrors(each, own) for each in those])
        print(f"| {kind} | {len(those)} | {others:.1%} | {by_product:.1%} |")


if __name__ == "__main__":
    main()
