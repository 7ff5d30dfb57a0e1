"""From recordings to a map, with an account of what was done."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from usmap_ros.errors import BagError, MalformedMessageError, MapFileError, MapSizeError, UsmapError
from usmap_ros.grids import OCCUPIED_PROBABILITY, OccupancyMap
from usmap_ros.io.bag_reader import BagReader
from usmap_ros.io.map_files import load_map
from usmap_ros.mapping.common_error import NO_ERROR, CommonError
from usmap_ros.mapping.far_off import Ping
from usmap_ros.mapping.robot_check.consistency import Consistency, is_of
from usmap_ros.mapping.robot_check.finding import Finding
from usmap_ros.parameters import PipelineParameters
from usmap_ros.pings.amplitude_scale import AmplitudeScales
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.fields_of_view import Beam
from usmap_ros.pings.repeats import SeenPings
from usmap_ros.pings.robot_paths import RobotPaths
from usmap_ros.processes.memory import peak_memory_mb
from usmap_ros.runs.parallel import Reconstructors
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.runs.poses import PoseRun
from usmap_ros.runs.recorded import learn_reception, recorded_cones
from usmap_ros.runs.set_apart import SetApart, pings_of_one_map

logger = logging.getLogger(__name__)

#: Called with topic and cone after each ping that was fused.
ConeCallback = Callable[[str, EchoCone], None]


@dataclass
class MappingRun:
    """What became of the pings of a recording."""

    #: Pings that went into the map.
    pings: int = 0
    #: Echoes found in them.
    echoes: int = 0
    #: Number of pings left out, by the field of the message that was to blame.
    skipped: dict[str, int] = field(default_factory=dict)
    #: Number of sound pings that are not of this map, by topic and by why: they are in another
    #: frame than most, or far off.
    set_apart: dict[str, dict[str, int]] = field(default_factory=dict)
    #: What is to be said of the robots, by topic, as compared with what all others heard.
    robots: dict[str, Finding] = field(default_factory=dict)
    #: Topics that others contradict in the map, and what of their trust is left, less than 1.
    doubted: dict[str, float] = field(default_factory=dict)
    #: What was wrong with all pings, and is not in the map.
    common_error: CommonError = NO_ERROR
    #: Topics that were left out because they should be.
    without: list[str] = field(default_factory=list)
    #: Which poses were used, and how far they were corrected.
    poses: PoseRun = field(default_factory=PoseRun)

    def suspects(self) -> dict[str, str]:
        """What is wrong with robots, by topic; those of which nothing is are left out."""
        return {topic: found.reason for topic, found in self.robots.items() if found.is_suspect}

    def contradicted(self) -> dict[str, str]:
        """Robots that contradict one another while nobody can tell which is wrong, with why."""
        return {
            topic: found.reason
            for topic, found in self.robots.items()
            if found.verdict == "contradicted"
        }

    def summary(self, occupancy: OccupancyMap, seconds: float) -> dict[str, Any]:
        """Contents of ``summary.json``."""
        occupied = occupancy.observed & (occupancy.probability() >= OCCUPIED_PROBABILITY)
        return {
            "pings": self.pings,
            "echoes": self.echoes,
            "seconds": seconds,
            "pings_per_second": self.pings / seconds,
            "cells_observed": int(np.count_nonzero(occupancy.observed)),
            "cells_occupied": int(np.count_nonzero(occupied)),
            "peak_memory_mb": peak_memory_mb(),
            "skipped": self.skipped,
            "set_apart": self.set_apart,
            "robots": {topic: found.summary() for topic, found in self.robots.items()},
            "doubted": self.doubted,
            "common_error": self.common_error._asdict(),
            "without": self.without,
            "poses": self.poses.summary(),
            "frame_id": occupancy.frame_id,
            "resolution_m": occupancy.geometry.resolution_m,
        }


def map_bag(
    bag: BagReader,
    pipeline: Pipeline,
    paths: RobotPaths,
    on_cone: ConeCallback | None = None,
    workers: Reconstructors | None = None,
    without: Collection[str] = (),
    wanted: Callable[[EchoCone], bool] = lambda cone: True,
) -> MappingRun:
    """Put every ping of an open recording into a pipeline's map.

    Parameters
    ----------
    bag : BagReader
        The recording; its traces are mapped, or its cones if it holds no traces.
    pipeline : Pipeline
        Where the map forms.
    paths : RobotPaths
        Gets the position and the beam of each ping.
    on_cone : callable, optional
        Called after each ping.
    workers : Reconstructors, optional
        Processes that reconstruct its traces, which began with what `learn_reception` found;
        without them the caller's does, and what its receivers are is learnt first.
    without : collection of str
        Topics, or robots, whose pings stay out of the map.
    wanted : callable
        Which pings go into the map, by their poses as they are used; if none does, the run is of
        no pings.

    Raises
    ------
    BagError
        If not a single ping could be used.
    MapSizeError
        If a single ping makes the map too large.
    """
    poses = PoseRun(pipeline.parameters, pipeline.fusion.frame_id, pipeline.resumed)
    run, seen, apart = MappingRun(poses=poses), SeenPings(), SetApart()
    scales = AmplitudeScales()
    if workers is None:
        workers = Reconstructors(pipeline)
        learn_reception(bag, pipeline, workers)
    consistency, left_out = Consistency(pipeline.parameters.mapping), set[str]()
    heard = run.poses.corrected(_wanted(recorded_cones(bag, workers), without, left_out))
    asked = Counter[bool]()
    for topic, cone in pings_of_one_map(_asked_for(heard, wanted, asked), pipeline, apart):
        try:
            seen.add(cone)
            pipeline.fuse(cone, topic)
        except MalformedMessageError as error:
            bag.skipped.add(f"{topic} at {cone.stamp_ns / 1e9:.6f} s", error)
            continue
        scales.add(topic, cone)
        consistency.add(topic, cone)
        run.pings += 1
        run.echoes += len(cone.ranges_m)
        x_m, y_m = (float(value) for value in cone.pose.position_m[:2])
        paths.add(topic, x_m, y_m, Beam.of(cone), cone.stamp_ns)
        if on_cone is not None:
            on_cone(topic, cone)
    for problems in (scales.problems(), apart.causes()):
        for topic, problem in problems.items():
            logger.warning("%s: %s", topic, problem)
    run.skipped, run.without = dict(bag.skipped.by_field), sorted(left_out)
    run.set_apart = apart.summary()
    if asked[False] and not asked[True]:
        return run
    if not run.pings:
        raise _why_nothing(bag, left_out, apart)
    # What either leaves of the cores, the other takes; nobody being doubted, the map stands.
    found = workers.last(Consistency.findings, consistency)
    pipeline.fusion.snapshot()()
    run.robots = found()
    pipeline.fusion.trust({topic: found.trust for topic, found in run.robots.items()})
    return run


def _wanted(pings: Iterable[Ping], without: Collection[str], left_out: set[str]) -> Iterator[Ping]:
    """Pings of those that are not to be left out; topics of the others go into `left_out`."""
    for topic, cone in pings:
        if is_of(topic, without):
            left_out.add(topic)
        else:
            yield topic, cone


def _asked_for(
    pings: Iterable[Ping], wanted: Callable[[EchoCone], bool], asked: Counter[bool]
) -> Iterator[Ping]:
    """Pings that are wanted; how many are, and how many are not, goes into `asked`."""
    for topic, cone in pings:
        is_wanted = wanted(cone)
        asked[is_wanted] += 1
        if is_wanted:
            yield topic, cone


def _why_nothing(bag: BagReader, left_out: set[str], apart: SetApart) -> UsmapError:
    """Error of a recording of which nothing was mapped."""
    if causes := apart.causes():
        return MapSizeError("; ".join(causes.values()))
    if left_out:
        return BagError(", ".join(map(str, bag.paths)), "all of its robots are left out")
    return nothing_usable(bag.paths, bag.skipped.by_field)


def nothing_usable(paths: Iterable[str | Path], skipped: Counter[str]) -> BagError:
    """Error of recordings of which every ping was skipped."""
    causes = ", ".join(f"{field} ({n})" for field, n in skipped.most_common())
    return BagError(
        ", ".join(map(str, paths)),
        f"none of its {skipped.total()} pings can be used, by field: {causes}",
    )


def resume_map(folder: Path, parameters: PipelineParameters) -> tuple[Pipeline, RobotPaths]:
    """Continue the map that was saved in `folder`.

    Raises
    ------
    MapFileError
        If there is none, or its cells are not those of `parameters`.
    """
    occupancy, paths = load_map(folder)
    pipeline = Pipeline(parameters)
    try:
        pipeline.resume(occupancy)
    except ValueError as error:
        raise MapFileError(folder, f"cannot be continued: {error}") from error
    return pipeline, paths
