"""From many recordings to one map, by whoever does the work."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from usmap_ros.errors import UsmapError
from usmap_ros.grids import OccupancyMap
from usmap_ros.mapping.merging import merge_maps
from usmap_ros.parameters import PipelineParameters
from usmap_ros.pings.robot_paths import RobotPaths
from usmap_ros.processes.cluster import Failure, attempt, results
from usmap_ros.runs.collection.areas import AreaMap, AreaOptions, areas_of, fuse_area
from usmap_ros.runs.collection.cones import (
    STRETCH,
    Cones,
    Divided,
    cones_of_recording,
    cones_of_stretch,
    joined,
)
from usmap_ros.runs.collection.tiles import Tile, around, tiles_of
from usmap_ros.runs.offline import MappingRun

#: Folder, beside the map, of the cones of all recordings: a second run finds them there.
CONES_FOLDER = "cones"


@dataclass(frozen=True)
class Collected:
    """One map of many recordings."""

    #: The map of all areas, joined.
    occupancy: OccupancyMap
    #: Of all robots.
    paths: RobotPaths
    #: What became of their pings.
    run: MappingRun
    #: How many there were; tiles of areas, an area that is not divided being one.
    recordings: int
    areas: int
    tiles: int
    #: Why recordings, or areas by the names of their recordings, could not be used.
    failed: dict[str, str]
    #: What there is to be said of others.
    warnings: list[str]

    def summary(self, seconds: float) -> dict[str, Any]:
        """Contents of ``summary.json``."""
        counts = {
            "recordings": self.recordings, "areas": self.areas, "tiles": self.tiles,
            "failed": self.failed,
        }  # fmt: skip
        return self.run.summary(self.occupancy, seconds) | counts


def map_collection(
    recordings: Sequence[Path],
    output: Path,
    parameters: PipelineParameters,
    executor: Executor | None = None,
    *,
    wishes: AreaOptions = AreaOptions(),  # noqa: B008 - it cannot be changed
    step: Callable[[], None] = lambda: None,
    stretch: int = STRETCH,
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
    wishes : AreaOptions
        What else is asked for.
    step : callable
        Called twice for each recording: when its cones are there, and when it is mapped.
    stretch : int
        Pings of a recording from which on it is divided among workers.

    Raises
    ------
    UsmapError
        If nothing could be mapped, or the whole map would be too large.
    """
    files, failed = _reconstructed(recordings, output, parameters, executor, stretch, step)
    areas = areas_of(list(files.values()))
    names = {str(file.paths): str(recordings[number]) for number, file in files.items()}
    fuse = partial(fuse_area, parameters=parameters, wishes=wishes)
    maps: dict[int, AreaMap] = {}
    whose = [(n, tile) for n, area in enumerate(areas) for tile in _tiles(area, wishes)]
    area_of, left = [n for n, _ in whose], Counter(n for n, _ in whose)
    work = [(_paths(areas[n], tile), tile) for n, tile in whose]
    for number, fused in results(executor, fuse, work):
        area = areas[area_of[number]]
        left[area_of[number]] -= 1
        for _ in area if not left[area_of[number]] else ():
            step()
        if isinstance(fused, Failure):
            failed[", ".join(names[str(file.paths)] for file in area)] = fused.cause
        elif fused is not None:
            maps[number] = fused
    for number in _in_other_frames(maps):
        frame = maps.pop(number).occupancy.frame_id
        name = ", ".join(names[str(file.paths)] for file in areas[area_of[number]])
        failed[name] = f"is in the frame '{frame}', and most of the others are not"
    if not maps:
        raise UsmapError("; ".join(f"{name}: {cause}" for name, cause in failed.items()))
    warnings = [text for number in sorted(files) for text in files[number].warnings]
    merged = [maps[number] for number in sorted(maps)]
    paths = RobotPaths()
    for one in merged:
        paths.extend(one.paths)
    skipped = Counter[str]()
    for file in files.values():
        skipped.update(file.skipped)
    return Collected(
        merge_maps([one.occupancy for one in merged], parameters.mapping),
        paths,
        _joined_runs([one.run for one in merged], skipped),
        len(recordings), len({area_of[number] for number in maps}), len(maps), failed, warnings,
    )  # fmt: skip


def _tiles(area: Sequence[Cones], wishes: AreaOptions) -> list[Tile]:
    """Tiles of an area that any of its recordings may reach."""
    tiles = tiles_of(around([file.box_m for file in area]), wishes.tile_m)
    return [tile for tile in tiles if any(tile.is_near(file.box_m) for file in area)]


def _paths(area: Sequence[Cones], tile: Tile) -> list[str]:
    """Recordings of cones that may reach a tile of their area."""
    return [path for file in area if tile.is_near(file.box_m) for path in file.paths]


def _in_other_frames(maps: Mapping[int, AreaMap]) -> list[int]:
    """Numbers of the areas that are not in the frame of most pings: those do not join."""
    pings = Counter[str]()
    for area in maps.values():
        pings[area.occupancy.frame_id] += area.run.pings
    most = max(pings, key=lambda frame_id: pings[frame_id], default="")
    return [number for number, area in maps.items() if area.occupancy.frame_id != most]


def _reconstructed(
    recordings: Sequence[Path],
    output: Path,
    parameters: PipelineParameters,
    executor: Executor | None,
    length: int,
    step: Callable[[], None],
) -> tuple[dict[int, Cones], dict[str, str]]:
    """Cones of each recording by its number, and why others have none."""
    folder = (output / CONES_FOLDER).resolve()
    found: dict[int, Cones | Failure] = {}
    divided: dict[int, Divided] = {}
    whole = [(recording.resolve(), folder, parameters, length) for recording in recordings]
    for number, made in results(executor, cones_of_recording, whole):
        if isinstance(made, Divided):
            divided[number] = made
        else:
            found[number] = made
            step()
    owners = [
        (number, place) for number in divided for place in range(len(divided[number].stretches))
    ]
    work = [
        (*divided[number].stretches[place], divided[number].reception) for number, place in owners
    ]
    parts: dict[int, dict[int, Cones | Failure]] = {number: {} for number in divided}
    for done, made in results(executor, cones_of_stretch, work):
        number, place = owners[done]
        parts[number][place] = made
        if len(parts[number]) == len(divided[number].stretches):
            found[number] = _joined(divided[number], parts[number])
            step()
    failed = {
        str(recordings[number]): one.cause
        for number, one in sorted(found.items())
        if isinstance(one, Failure)
    }
    for _ in failed:
        step()
    return {n: one for n, one in sorted(found.items()) if isinstance(one, Cones)}, failed


def _joined(recording: Divided, parts: dict[int, Cones | Failure]) -> Cones | Failure:
    """A recording's cones, or the first reason why there are none."""
    made = [parts[place] for place in sorted(parts)]
    failures = [part for part in made if isinstance(part, Failure)]
    cones = [part for part in made if isinstance(part, Cones)]
    return failures[0] if failures else attempt(joined, recording.name, [recording.begun, *cones])


def _joined_runs(runs: Sequence[MappingRun], skipped: Counter[str]) -> MappingRun:
    total = MappingRun()
    for run in runs:
        total.pings += run.pings
        total.echoes += run.echoes
        skipped.update(run.skipped)
        for topic, counts in run.set_apart.items():
            before = Counter(total.set_apart.get(topic, {}))
            total.set_apart[topic] = dict(before + Counter(counts))
        # A robot that is at odds with others in one area is, whatever it was elsewhere.
        total.robots |= {
            topic: found
            for topic, found in run.robots.items()
            if topic not in total.robots or found.is_suspect
        }
        total.without = sorted({*total.without, *run.without})
        total.doubted |= {
            topic: share
            for topic, share in run.doubted.items()
            if share < total.doubted.get(topic, 1.0)
        }
        # Of areas with other air, one is told of.
        if run.common_error.reasons:
            total.common_error = run.common_error
    total.skipped = dict(skipped)
    return total
