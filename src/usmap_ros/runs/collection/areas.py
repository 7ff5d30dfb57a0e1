"""Which recordings belong together because their pings reach the same places."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from usmap_ros.grids import OccupancyMap
from usmap_ros.io.bag_reader import BagReader
from usmap_ros.parameters import PipelineParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.fields_of_view import Beam
from usmap_ros.pings.robot_paths import RobotPaths
from usmap_ros.runs.collection.cones import Cones
from usmap_ros.runs.collection.tiles import Box, Tile, around
from usmap_ros.runs.offline import MappingRun, map_bag
from usmap_ros.runs.pipeline import Pipeline


@dataclass(frozen=True)
class AreaMap:
    """The map of one area, or of a tile of it."""

    #: The map of that alone.
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
    areas: list[tuple[Box, list[Cones]]] = []
    for file in files:
        box, members = file.box_m, [file]
        # A box that grows by another one may touch a third.
        while touching := [area for area in areas if Tile(*area[0]).is_near(box)]:
            areas = [area for area in areas if not Tile(*area[0]).is_near(box)]
            box = around([box, *(other for other, _ in touching)])
            members += [file for _, others in touching for file in others]
        areas.append((box, members))
    groups = [sorted(members, key=lambda file: file.paths) for _, members in areas]
    return sorted(groups, key=lambda group: group[0].paths)


@dataclass(frozen=True)
class AreaOptions:
    """What is asked for of every area's map."""

    #: Further looks at the recent pings.
    passes: int = 0
    #: Topics, or robots, whose pings stay out of the map.
    without: tuple[str, ...] = ()
    #: The map's frame; empty: the one that most robots share.
    frame_id: str = ""
    #: Side of a tile that one worker maps, at the most; infinite: areas are not divided.
    tile_m: float = math.inf


@dataclass
class _OwnPings:
    """Pings that are sent from a tile: those that only reach it are another one's."""

    tile: Tile
    paths: RobotPaths = field(default_factory=RobotPaths)
    pings: int = 0
    echoes: int = 0

    def add(self, topic: str, cone: EchoCone) -> None:
        """Count a ping that was fused."""
        x_m, y_m = map(float, cone.pose.position_m[:2])
        if self.tile.holds(x_m, y_m):
            self.paths.add(topic, x_m, y_m, Beam.of(cone), cone.stamp_ns)
            self.pings += 1
            self.echoes += len(cone.ranges_m)


def fuse_area(
    cones: Sequence[str], tile: Tile, parameters: PipelineParameters, wishes: AreaOptions
) -> AreaMap | None:
    """Fuse recordings of cones in the order of their stamps.

    Parameters
    ----------
    cones : sequence of str
        Paths of the recordings of cones whose pings reach the area.
    tile : Tile
        The part of it that is mapped.
    parameters : PipelineParameters
        Of which those of mapping count.
    wishes : AreaOptions
        What else is asked for.

    Returns
    -------
    AreaMap or None
        None where no ping reaches the tile.

    Raises
    ------
    UsmapError
        If nothing in them can be used, or the map would be too large.
    """
    pipeline, own = Pipeline(parameters), _OwnPings(tile)
    pipeline.fusion.frame_id = wishes.frame_id
    pipeline.refine(wishes.passes)
    with BagReader([Path(path) for path in cones]) as bag:
        run = map_bag(
            bag, pipeline, RobotPaths(), own.add, without=wishes.without,
            wanted=tile.is_reached_by,
        )  # fmt: skip
    occupancy = tile.cut(pipeline.occupancy_map()) if run.pings else None
    if occupancy is None:
        return None
    run.pings, run.echoes = own.pings, own.echoes
    run.doubted, run.common_error = pipeline.fusion.doubted, pipeline.fusion.common_error
    return AreaMap(occupancy, own.paths, run)
