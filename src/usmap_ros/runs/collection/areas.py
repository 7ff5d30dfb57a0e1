"""Which recordings belong together because their pings reach the same places."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from usmap_ros.grids import OccupancyMap
from usmap_ros.io.bag_reader import BagReader
from usmap_ros.parameters import PipelineParameters
from usmap_ros.pings.robot_paths import RobotPaths
from usmap_ros.runs.collection.cones import Cones
from usmap_ros.runs.offline import MappingRun, map_bag
from usmap_ros.runs.pipeline import Pipeline

#: How far areas are apart: farther than gaps in walls are bridged.
MARGIN_M = 2.0


@dataclass(frozen=True)
class AreaMap:
    """The map of one area."""

    #: The map of the area alone.
    occupancy: OccupancyMap
    #: Of the robots in it.
    paths: RobotPaths
    #: What became of their pings.
    run: MappingRun


def areas_of(files: Sequence[Cones]) -> list[list[Cones]]:
    """Group recordings: those of different groups do not reach the same places.

    Parameters
    ----------
    files : sequence of Cones
        In any order.

    Returns
    -------
    areas : list of lists of Cones
        In the order of their first recordings' names.
    """
    areas: list[tuple[tuple[float, ...], list[Cones]]] = []
    for file in files:
        box, members = tuple(file.box_m), [file]
        # A box that grows by another one may touch a third.
        while touching := [area for area in areas if _touch(area[0], box)]:
            areas = [area for area in areas if not _touch(area[0], box)]
            box = _around([box, *(other for other, _ in touching)])
            members += [file for _, others in touching for file in others]
        areas.append((box, members))
    groups = [sorted(members, key=lambda file: file.paths) for _, members in areas]
    return sorted(groups, key=lambda group: group[0].paths)


def _touch(one: Sequence[float], other: Sequence[float]) -> bool:
    return all(
        one[axis] <= other[axis + 2] + MARGIN_M and other[axis] <= one[axis + 2] + MARGIN_M
        for axis in (0, 1)
    )


def _around(boxes: Sequence[Sequence[float]]) -> tuple[float, ...]:
    sides = np.array(boxes)
    return (*map(float, sides[:, :2].min(axis=0)), *map(float, sides[:, 2:].max(axis=0)))


@dataclass(frozen=True)
class AreaOptions:
    """What is asked for of every area's map."""

    #: Further looks at the recent pings.
    passes: int = 0
    #: Topics, or robots, whose pings stay out of the map.
    without: tuple[str, ...] = ()
    #: The map's frame; empty: the one that most robots share.
    frame_id: str = ""


def fuse_area(cones: Sequence[str], parameters: PipelineParameters, wishes: AreaOptions) -> AreaMap:
    """Fuse recordings of cones in the order of their stamps.

    Parameters
    ----------
    cones : sequence of str
        Paths of the recordings of cones whose pings reach the area.
    parameters : PipelineParameters
        Of which those of mapping count.
    wishes : AreaOptions
        What else is asked for.

    Raises
    ------
    UsmapError
        If nothing in them can be used, or the map would be too large.
    """
    pipeline, paths = Pipeline(parameters), RobotPaths()
    pipeline.fusion.frame_id = wishes.frame_id
    pipeline.refine(wishes.passes)
    with BagReader([Path(path) for path in cones]) as bag:
        run = map_bag(bag, pipeline, paths, without=wishes.without)
    occupancy = pipeline.occupancy_map()
    run.doubted, run.common_error = pipeline.fusion.doubted, pipeline.fusion.common_error
    return AreaMap(occupancy, paths, run)
