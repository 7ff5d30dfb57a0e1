"""The demo's map, and what is made of the same pings while it forms."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from usmap_ros.evaluation.scoring import Score, score
from usmap_ros.grids import OccupancyMap, TruthMap
from usmap_ros.io.bag_reader import BagReader
from usmap_ros.mapping.candidates import CandidateCells, candidate_cells
from usmap_ros.mapping.joint.fusion import JointFusion
from usmap_ros.mapping.yardsticks.range_only import RangeSensorFusion
from usmap_ros.parameters import MappingParameters, PipelineParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.robot_paths import RobotPaths
from usmap_ros.plotting.shown import MapFrame
from usmap_ros.processes.threads import alone
from usmap_ros.reconstruction.explained import Reconstruction
from usmap_ros.reconstruction.reconstructor import reconstruct
from usmap_ros.runs.pipeline import Pipeline

#: Shares of the pings after which the animation has a frame, dense at first, when most changes.
#: Every second one explains all pings so far together, the one after it has half as many more
#: beside them: a live map's way, which takes a tenth of the time.
FRAMES_AFTER = (0.02, 0.05, 0.075, 0.15, 0.22, 0.4, 0.6)
#: The ping that is drawn has the fewest echoes from so many on, to show how each comes about.
LEAST_ECHOES = 3


class Film:
    """Maps while they form, made in a thread beside of the same pings.

    Parameters
    ----------
    pings : int
        How many will come.
    parameters : MappingParameters
        Of the maps.
    paths : RobotPaths
        Where the robots were, up to the newest ping.
    """

    def __init__(self, pings: int, parameters: MappingParameters, paths: RobotPaths) -> None:
        self._due = {round(share * pings) for share in FRAMES_AFTER}
        self._fusion, self._paths = JointFusion(parameters), paths
        self._thread = ThreadPoolExecutor(1)
        self._made: list[Future[MapFrame]] = []
        # Newest cone of each topic; pings since the last frame, and how many there were at all.
        self._cones: dict[str, EchoCone] = {}
        self._waiting: list[tuple[str, EchoCone]] = []
        self._seen = 0

    def add(self, topic: str, cone: EchoCone) -> None:
        """Take up a ping, and have a frame made if one is due."""
        self._cones[topic] = cone
        self._waiting.append((topic, cone))
        self._seen += 1
        if self._seen in self._due:
            self._made.append(self._thread.submit(self._map, self._waiting, self._looks()))
            self._waiting = []

    def frames(self, finished: OccupancyMap) -> list[MapFrame]:
        """All frames, the last of them with the finished map."""
        frames = [made.result() for made in self._made]
        self._thread.shutdown()
        return [*frames, self._looks()(finished)]

    def _looks(self) -> Callable[[OccupancyMap], MapFrame]:
        """What makes a frame of a map, with the robots where they are now."""
        cones, newest = dict(self._cones), max(cone.stamp_ns for cone in self._cones.values())
        behind = {topic: len(path) for topic, path in self._paths.positions_m.items()}
        return lambda occupancy: MapFrame(occupancy, cones, behind, newest)

    def _map(
        self, pings: list[tuple[str, EchoCone]], look: Callable[[OccupancyMap], MapFrame]
    ) -> MapFrame:
        for topic, cone in pings:
            self._fusion.fuse(cone, topic)
        # The finished map and the pictures have what else there is of cores.
        with alone():
            return look(self._fusion.live_snapshot()())


class Observer:
    """Looks on while the map forms: feeds the same cones to the film and to the baseline."""

    def __init__(self, pings: int) -> None:
        parameters = PipelineParameters()
        self.pipeline = Pipeline(parameters)
        self.range_only = RangeSensorFusion(parameters.mapping)
        self.paths = RobotPaths()
        self.film = Film(pings, parameters.mapping, self.paths)
        # Topic and stamp of the ping to be drawn, and what makes it the best so far.
        self.clearest: tuple[str, int] = ("", 0)
        self._order: tuple[bool, int] | None = None

    def watch(self, step: Callable[[], None]) -> Callable[[str, EchoCone], None]:
        """Make the function that is called after each ping."""

        def on_cone(topic: str, cone: EchoCone) -> None:
            self.range_only.fuse(cone)
            self.film.add(topic, cone)
            echoes = len(cone.ranges_m)
            # Too few are worse than many.
            order = (echoes < LEAST_ECHOES, echoes)
            if self._order is None or order < self._order:
                self.clearest, self._order = (topic, cone.stamp_ns), order
            step()

        return on_cone

    def explained(self, recording: Path) -> tuple[Reconstruction, CandidateCells]:
        """What is found in the ping that is to be drawn, and where its echoes may be from."""
        with BagReader([recording]) as bag:
            trace = next(
                one for topic, one in bag.traces() if (topic, one.stamp_ns) == self.clearest
            )
        parameters = self.pipeline.parameters
        found = reconstruct(trace, parameters.reconstruction)
        return found, candidate_cells(found.cone, parameters.mapping)

    def scores(self, truth: TruthMap) -> tuple[Score, Score]:
        """Score the map, and what ranges alone make of the same recording."""
        views = self.paths.views()
        ours, theirs = self.pipeline.occupancy_map(), self.range_only.occupancy_map()
        return score(ours, truth, views), score(theirs, truth, views)
