"""From many recordings to one map, by whoever does the work."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from usmap_ros.collection.areas import AreaMap, areas_of, fuse_area
from usmap_ros.collection.cones import ConesFile, cones_file
from usmap_ros.errors import UsmapError
from usmap_ros.grids import OccupancyMap
from usmap_ros.io.map_files import RobotPaths
from usmap_ros.mapping.merging import merge_maps
from usmap_ros.offline import MappingRun
from usmap_ros.parallel import Failure, results
from usmap_ros.parameters import PipelineParameters

#: Folder, beside the map, of the cones of all recordings: a second run finds them there.
CONES_FOLDER = "cones"


@dataclass(frozen=True)
class Collected:
    """One map of many recordings.

    Parameters
    ----------
    occupancy : OccupancyMap
        The map.
    paths : RobotPaths
        Of all robots.
    run : MappingRun
        What became of their pings.
    recordings, areas : int
        How many there were.
    failed : dict
        Why recordings, or areas by the names of their recordings, could not be used.
    warnings : list of str
        What there is to be said of others.
    """

    occupancy: OccupancyMap
    paths: RobotPaths
    run: MappingRun
    recordings: int
    areas: int
    failed: dict[str, str]
    warnings: list[str]

    def summary(self, seconds: float) -> dict[str, Any]:
        """Contents of ``summary.json``."""
        counts = {"recordings": self.recordings, "areas": self.areas, "failed": self.failed}
        return self.run.summary(self.occupancy, seconds) | counts


def map_collection(
    recordings: Sequence[Path],
    output: Path,
    parameters: PipelineParameters,
    executor: Executor | None = None,
    *,
    passes: int = 0,
    without: Sequence[str] = (),
    step: Callable[[], None] = lambda: None,
) -> Collected:
    """Map recordings: each to cones, areas apart, and their maps to one.

    Parameters
    ----------
    recordings : sequence of path
        As the workers can read them.
    output : path
        Folder of the map, which the workers can write to.
    parameters : PipelineParameters
        Of reconstruction and mapping.
    executor : Executor, optional
        Does the work; without one this process does.
    passes : int
        Further looks at the recent pings of each area.
    without : sequence of str
        Topics, or robots, whose pings stay out of the map.
    step : callable
        Called twice for each recording: when its cones are there, and when it is mapped.

    Raises
    ------
    UsmapError
        If nothing could be mapped, or the whole map would be too large.
    """
    folder = (output / CONES_FOLDER).resolve()
    work = [(recording.resolve(), folder, parameters) for recording in recordings]
    files: dict[int, ConesFile] = {}
    failed: dict[str, str] = {}
    for number, made in results(executor, cones_file, work):
        step()
        if isinstance(made, Failure):
            failed[str(recordings[number])] = made.cause
            step()
        else:
            files[number] = made
    areas = areas_of(list(files.values()))
    names = {file.path: str(recordings[number]) for number, file in files.items()}
    fuse = partial(fuse_area, parameters=parameters, passes=passes, without=tuple(without))
    maps: dict[int, AreaMap] = {}
    for number, fused in results(executor, fuse, [([f.path for f in area],) for area in areas]):
        for _ in areas[number]:
            step()
        if isinstance(fused, Failure):
            failed[", ".join(names[file.path] for file in areas[number])] = fused.cause
        else:
            maps[number] = fused
    if not maps:
        raise UsmapError("; ".join(f"{name}: {cause}" for name, cause in failed.items()))
    warnings = [text for number in sorted(files) for text in files[number].warnings]
    merged = [maps[number] for number in sorted(maps)]
    paths = RobotPaths()
    for area in merged:
        paths.extend(area.paths)
    skipped = Counter[str]()
    for file in files.values():
        skipped.update(file.skipped)
    return Collected(
        merge_maps([area.occupancy for area in merged], parameters.mapping),
        paths,
        _joined_runs([area.run for area in merged], skipped),
        len(recordings), len(merged), failed, warnings,
    )  # fmt: skip


def _joined_runs(runs: Sequence[MappingRun], skipped: Counter[str]) -> MappingRun:
    total = MappingRun()
    for run in runs:
        total.pings += run.pings
        total.echoes += run.echoes
        skipped.update(run.skipped)
        # A robot that is at odds with others in one area is, whatever it was elsewhere.
        total.robots |= {
            topic: found
            for topic, found in run.robots.items()
            if topic not in total.robots or found.is_suspect
        }
        total.without = sorted({*total.without, *run.without})
    total.skipped = dict(skipped)
    return total
