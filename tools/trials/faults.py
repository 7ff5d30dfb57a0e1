"""Three robots, one of them faulty: what each fault costs the map, and whether it is named."""

from __future__ import annotations

import logging
import sys
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from usmap_ros.errors import UsmapError
from usmap_ros.evaluation.scoring import Score, score
from usmap_ros.grids import TruthMap
from usmap_ros.io.bag_reader import BagReader
from usmap_ros.io.bags import write_bag
from usmap_ros.mapping.far_off import Ping
from usmap_ros.mapping.robot_check.consistency import Consistency
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.fields_of_view import PingViews
from usmap_ros.pings.robot_paths import RobotPaths
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.runs.offline import MappingRun, map_bag
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.simulation import Scenario, simulate
from usmap_ros.simulation.models.transducers import MountModel

# Behind what lies here: both folders have modules of the same names.
sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
import scenes

#: Scenes by their names in the table, and what `benchmarks/scenes.py` calls them.
SCENES = {"poles": "poles", "rough": "rough_rooms", "smooth": "smooth_rooms"}
FAULTY = "/robot3/echo"
HEALTHY, OTHERS = "healthy", "two others"
#: Where transducers look, off the way ahead: a mount that is mirrored must make a difference.
MOUNT_RAD = 0.7
LATE_S = 1.0
#: What a liar reports: so many echoes, which it makes up, at such a rate, Hz.
LIAR, MADE_UP, LIAR_HZ = "liar", 1000, 20.0

#: Traces of the faulty robot, in their order, as its fault makes them.
Fault = Callable[[Iterator[EchoTrace], np.random.Generator], Iterator[EchoTrace]]


def _each(change: Callable[[EchoTrace, np.random.Generator], EchoTrace]) -> Fault:
    """A fault that every ping has by itself."""

    def fault(traces: Iterator[EchoTrace], rng: np.random.Generator) -> Iterator[EchoTrace]:
        for trace in traces:
            yield change(trace, rng)

    return fault


def _louder(trace: EchoTrace, factor: float) -> EchoTrace:
    return replace(trace, samples=trace.samples * np.float32(factor))


def _clipped(trace: EchoTrace, _: np.random.Generator) -> EchoTrace:
    """By a converter whose full scale is what a pole at four metres returns."""
    return replace(trace, samples=np.clip(trace.samples, -0.06, 0.06))


def _noise(trace: EchoTrace, factor: float, rng: np.random.Generator) -> np.ndarray:
    # Half of the power in either quadrature.
    std = factor * trace.noise_std / np.sqrt(2.0)
    return rng.normal(0.0, std, len(trace.samples)).astype(np.float32)


def _moved(trace: EchoTrace, x_m: float, y_m: float) -> EchoTrace:
    position_m = trace.pose.position_m + np.array([x_m, y_m, 0.0])
    return replace(trace, pose=replace(trace.pose, position_m=position_m))


def _turned(trace: EchoTrace, angle_rad: float) -> EchoTrace:
    """The same place, faced in another direction; covariances stay those of the pose."""
    turn = Pose.planar(0.0, 0.0, angle_rad).compose(replace(trace.pose, position_m=np.zeros(3)))
    return replace(trace, pose=replace(trace.pose, orientation=turn.orientation))


def _late(traces: Iterator[EchoTrace], _: np.random.Generator) -> Iterator[EchoTrace]:
    """With the pose of a second ago."""
    past: deque[EchoTrace] = deque()
    for trace in traces:
        past.append(trace)
        while len(past) > 1 and past[1].stamp_ns <= trace.stamp_ns - LATE_S * 1e9:
            past.popleft()
        yield replace(trace, pose=past[0].pose)


FAULTS: dict[str, Fault] = {
    "gain x10": _each(lambda trace, _: _louder(trace, 10.0)),
    "gain x100": _each(lambda trace, _: _louder(trace, 100.0)),
    "clipped": _each(_clipped),
    "noise x30": _each(
        lambda trace, rng: replace(trace, samples=trace.samples + _noise(trace, 30.0, rng))
    ),
    "dead": _each(lambda trace, rng: replace(trace, samples=_noise(trace, 1.0, rng))),
    "1 m off": _each(lambda trace, _: _moved(trace, 0.8, -0.6)),
    "heading off 20°": _each(lambda trace, _: _turned(trace, np.deg2rad(20.0))),
    "sound speed +5 %": _each(
        lambda trace, _: replace(
            trace,
            channel=replace(trace.channel, sound_speed_m_s=1.05 * trace.channel.sound_speed_m_s),
        )
    ),
    "poses 1 s late": _late,
    "mirrored mount": _each(lambda trace, _: _turned(trace, -2.0 * MOUNT_RAD)),
}


def _lies(cones: list[EchoCone], rng: np.random.Generator) -> Iterator[EchoCone]:
    """Echoes from anywhere, and pings in between."""
    for cone, following in pairwise([*cones, cones[-1]]):
        for stamp_ns in range(cone.stamp_ns, following.stamp_ns, round(1e9 / LIAR_HZ)):
            reach = cone.transducer.min_range_m, cone.transducer.max_range_m
            amplitudes = rng.uniform(0.05, 1.0, MADE_UP).astype(np.float32)
            yield replace(
                cone,
                stamp_ns=stamp_ns,
                ranges_m=np.sort(rng.uniform(*reach, MADE_UP)).astype(np.float32),
                range_stds_m=np.full(MADE_UP, 2e-3, np.float32),
                amplitudes=amplitudes,
                amplitude_stds=np.float32(0.05) * amplitudes,
            )


@dataclass(frozen=True)
class Outcome:
    """How a map became, and who was named."""

    score: Score
    named: frozenset[str]


def try_faults(
    folder: Path, kinds: list[str], names: list[str], seeds: list[int], pings: int, within: float
) -> tuple[dict[str, str], list[str]]:
    """Map with and without a faulty robot; a table's rows, and what went wrong.

    Parameters
    ----------
    folder : path
        For recordings.
    kinds, names : list of str
        Scenes and faults.
    seeds : list of int
        Of scenes and noise.
    pings : int
        Of each robot.
    within : float
        More than that a fault may not cost F1 or known, as compared with the two others alone.
    """
    logging.getLogger("usmap_ros").setLevel(logging.ERROR)
    rows = {"fault": "F1 and known: healthy; with it; two others alone; named; others accused"}
    troubles: list[str] = []
    for kind in kinds:
        found: dict[str, list[Outcome]] = {name: [] for name in [HEALTHY, OTHERS, *names]}
        for seed in seeds:
            _try_seed(folder, kind, seed, pings, found)
        accused = sum(bool(outcome.named) for outcome in found[HEALTHY])
        rows[f"{kind}, {HEALTHY}"] = f"accused in {accused} of {len(seeds)}"
        for name in names:
            rows[f"{kind}, {name}"] = _row(found, name)
            f1, known = np.subtract(_means(found[OTHERS]), _means(found[name]))
            if max(f1, known) > within:
                troubles.append(f"{kind}, {name}: costs {f1:.2f} of F1 and {known:.2f} of known")
    return rows, troubles


def try_names(
    kinds: list[str], names: list[str], seeds: list[int], pings: int
) -> tuple[dict[str, str], list[str]]:
    """Judge robots of which one is faulty, or none, without a map; parameters as in `try_faults`.

    A healthy robot that is accused is a trouble.
    """
    rows = {"fault": "named; cannot be told from another; others accused"}
    troubles: list[str] = []
    for kind in kinds:
        counts = {name: np.zeros(3, int) for name in (HEALTHY, *names)}
        for seed in seeds:
            for name, cones in _recordings(kind, seed, pings, tuple(counts)):
                counts[name] += _judged(cones, FAULTY if name != HEALTHY else "")
            print(f"{kind}, seed {seed}: done", file=sys.stderr, flush=True)
        for name, (named, contradicted, others) in counts.items():
            rows[f"{kind}, {name}"] = f"{named}; {contradicted}; {others} of {len(seeds)}"
            if others:
                troubles.append(f"{kind}, {name}: a healthy robot is accused in {others}")
    return rows, troubles


def _judged(cones: list[Ping], faulty: str) -> tuple[bool, bool, bool]:
    """Whether a robot is named, whether it or another one is, and whether somebody else is."""
    consistency = Consistency(MappingParameters())
    for topic, cone in cones:
        consistency.add(topic, cone)
    findings = consistency.findings()
    suspects = {topic for topic, finding in findings.items() if finding.is_suspect}
    doubted = {topic for topic, one in findings.items() if one.verdict == "contradicted"}
    return faulty in suspects, faulty in doubted, bool(suspects - {faulty})


def _try_seed(
    folder: Path, kind: str, seed: int, pings: int, found: dict[str, list[Outcome]]
) -> None:
    truth, views = scene(kind, seed, pings).truth_map(), None
    for name, cones in _recordings(kind, seed, pings, tuple(found)):
        views = views or PingViews.of([cone for topic, cone in cones if topic != FAULTY])
        found[name].append(_outcome(folder / "bag", cones, truth, views))
    print(f"{kind}, seed {seed}: done", file=sys.stderr, flush=True)


def _recordings(
    kind: str, seed: int, pings: int, names: tuple[str, ...]
) -> Iterator[tuple[str, list[Ping]]]:
    """What all robots hear, in the order of stamps, with one fault after another."""
    traces, pipeline = list(simulate(scene(kind, seed, pings))), Pipeline()
    others = [(topic, pipeline.reconstruct(trace)) for topic, trace in traces if topic != FAULTY]
    honest = [trace for topic, trace in traces if topic == FAULTY]
    for name in names:
        rng = np.random.default_rng([seed, *name.encode()])
        fault = FAULTS.get(name, _each(lambda trace, _: trace))
        heard = [pipeline.reconstruct(trace) for trace in fault(iter(honest), rng)]
        if name == OTHERS:
            heard = []
        elif name == LIAR:
            heard = list(_lies(heard, rng))
        recorded = [*others, *((FAULTY, cone) for cone in heard)]
        yield name, sorted(recorded, key=lambda each: each[1].stamp_ns)


def scene(kind: str, seed: int, pings: int) -> Scenario:
    """Three robots whose transducers look to the left of the way ahead."""
    drawn = scenes.scenario(SCENES[kind], "plain", seed)
    mount = MountModel(yaw_rad=MOUNT_RAD)
    robots = [
        robot.model_copy(
            update={
                "transducers": [
                    one.model_copy(update={"mount": mount}) for one in robot.transducers
                ]
            }
        )
        for robot in drawn.robots
    ]
    return drawn.model_copy(update={"robots": robots, "duration_s": pings / robots[0].ping_rate_hz})


def _outcome(bag: Path, cones: list[Ping], truth: TruthMap, views: PingViews) -> Outcome:
    """Map as `usmap map` does; what the two healthy robots looked at is what is scored."""
    write_bag(bag, cones, replace=True)
    pipeline, run = Pipeline(), MappingRun()
    try:
        with BagReader([bag]) as reader:
            run = map_bag(reader, pipeline, RobotPaths())
    except UsmapError as error:
        print(f"nothing was mapped: {error}", file=sys.stderr)
    return Outcome(score(pipeline.occupancy_map(), truth, views), frozenset(run.suspects()))


def _row(found: dict[str, list[Outcome]], name: str) -> str:
    cells = ["{:.2f}, {:.2f}".format(*_means(found[which])) for which in (HEALTHY, name, OTHERS)]
    named = sum(FAULTY in outcome.named for outcome in found[name])
    accused = sum(bool(outcome.named - {FAULTY}) for outcome in found[name])
    count = len(found[name])
    return "; ".join([*cells, f"{named} of {count}", f"{accused} of {count}"])


def _means(outcomes: list[Outcome]) -> tuple[float, float]:
    """Mean F1 and known."""
    return (
        float(np.mean([outcome.score.f1 for outcome in outcomes])),
        float(np.mean([outcome.score.known for outcome in outcomes])),
    )
