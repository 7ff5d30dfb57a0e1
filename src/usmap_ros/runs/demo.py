"""The main job, end to end: simulate, record, reconstruct, fuse, score, draw."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

from usmap_ros.evaluation.scoring import Score, score
from usmap_ros.grids import AMBIGUITY, NORMAL, OccupancyMap, TruthMap
from usmap_ros.io.bag_reader import BagReader
from usmap_ros.io.bag_writer import new_bag
from usmap_ros.io.map_files import NAV2_FILE, map_folder, save_map, save_truth
from usmap_ros.io.yaml_files import read_mapping
from usmap_ros.mapping.joint.fusion import JointFusion
from usmap_ros.mapping.yardsticks.range_only import RangeSensorFusion
from usmap_ros.parameters import MappingParameters, PipelineParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.robot_paths import RobotPaths
from usmap_ros.plotting import draw, map_figure, save_figure
from usmap_ros.plotting.animation import MapFrame, save_animation
from usmap_ros.plotting.map import shown_extent
from usmap_ros.processes.threads import alone
from usmap_ros.runs.offline import map_bag
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.simulation import Scenario, record

#: Shows how far something is that takes a number of steps; gives what tells of each step.
Progress = Callable[[str, int], AbstractContextManager[Callable[[], None]]]

#: Shares of the pings after which the animation has a frame, dense at first, when most changes.
#: Every second one explains all pings so far together, the one after it has half as many more
#: beside them: a live map's way, which takes a tenth of the time.
FRAMES_AFTER = (0.02, 0.05, 0.075, 0.15, 0.22, 0.4, 0.6)
#: The ping that is drawn has the fewest echoes from so many on, to show how each comes about.
LEAST_ECHOES = 3


@dataclass(frozen=True)
class DemoResult:
    """What the demo made.

    Parameters
    ----------
    paths : dict
        Where it is, by what it is.
    summary : dict
        As in ``summary.json``.
    score, range_score : Score
        Of the map, and of what a range-only sonar model makes of the same recording.
    """

    paths: dict[str, Path]
    summary: dict[str, Any]
    score: Score
    range_score: Score


def run_demo(folder: Path, progress: Progress) -> DemoResult:
    """Simulate a fleet, record it, map the recording, score the map and draw it all.

    Parameters
    ----------
    folder : path
        Where everything goes; what an earlier demo left there is replaced.
    progress : callable
        Shows how far it is.
    """
    with map_folder(folder):
        scenario = _demo_scenario()
        paths = {
            "recording": folder / "bag",
            "map for nav2": folder / NAV2_FILE,
            "map as log-odds": folder / "map.npz",
            "truth": folder / "truth.yaml",
            "picture of the map": folder / "map.png",
            "range-only sonar": folder / "range_only.png",
            "which way walls face": folder / "normals.png",
            "what is undecided": folder / "ambiguity.png",
            "picture of a ping": folder / "ping.png",
            "map forming": folder / "map.gif",
        }
        _record(scenario, paths["recording"], progress)
        truth = scenario.truth_map()
        save_truth(paths["truth"], truth)
        started = time.perf_counter()
        recorder = _Observer(scenario.ping_count)
        with (
            BagReader([paths["recording"]]) as bag,
            progress("mapping", bag.trace_count) as step,
        ):
            run = map_bag(bag, recorder.pipeline, recorder.paths, recorder.watch(step))
        occupancy = recorder.pipeline.occupancy_map()
        summary = save_map(
            folder,
            occupancy,
            recorder.paths,
            lambda: run.summary(occupancy, time.perf_counter() - started),
        )
        _draw(recorder, truth, paths, progress)
        range_only = recorder.range_only.occupancy_map()
        views = recorder.paths.views()
        return DemoResult(
            paths, summary, score(occupancy, truth, views), score(range_only, truth, views)
        )


def _demo_scenario() -> Scenario:
    source = Path(str(files("usmap_ros").joinpath("config", "scenarios", "room.yaml")))
    return Scenario.from_mapping(read_mapping(source), source)


def _record(scenario: Scenario, path: Path, progress: Progress) -> None:
    with (
        new_bag(path, replace=True) as writer,
        progress("simulating", scenario.ping_count) as step,
    ):
        record(scenario, writer, step)


class _Film:
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


class _Observer:
    """Looks on while the map forms: feeds the same cones to the film and to the baseline."""

    def __init__(self, pings: int) -> None:
        parameters = PipelineParameters()
        self.pipeline = Pipeline(parameters)
        self.range_only = RangeSensorFusion(parameters.mapping)
        self.paths = RobotPaths()
        self.film = _Film(pings, parameters.mapping, self.paths)
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


def _draw(observer: _Observer, truth: TruthMap, paths: dict[str, Path], progress: Progress) -> None:
    """Draw both maps to the same extent, one ping, and the map forming."""
    occupancy = observer.pipeline.occupancy_map()
    range_only = observer.range_only.occupancy_map()
    extent_m = shown_extent([occupancy, range_only], observer.paths, truth)
    pictures: dict[str, tuple[OccupancyMap, str, str | None]] = {
        "picture of the map": (occupancy, "Three robots, one map", None),
        "range-only sonar": (
            range_only, "The same recording, from the first echoes' ranges alone", None,
        ),
        "which way walls face": (occupancy, "Which way surfaces face", NORMAL),
        "what is undecided": (occupancy, "What is undecided", AMBIGUITY),
    }  # fmt: skip
    with progress("drawing", len(pictures) + 2) as step:
        for picture, (drawn, title, layer) in pictures.items():
            figure = map_figure(drawn, observer.paths, truth, title, extent_m, layer)
            save_figure(figure, paths[picture])
            step()
        _draw_ping(observer, truth, paths)
        step()
        frames = observer.film.frames(occupancy)
        save_animation(frames, observer.paths, paths["map forming"], truth, extent_m)
        step()


def _draw_ping(observer: _Observer, truth: TruthMap, paths: dict[str, Path]) -> None:
    """Draw a ping of the recording that has few echoes."""
    topic, stamp_ns = observer.clearest
    with BagReader([paths["recording"]]) as bag:
        trace = next(
            trace for name, trace in bag.traces() if (name, trace.stamp_ns) == (topic, stamp_ns)
        )
    save_figure(draw(trace, truth, observer.pipeline.parameters), paths["picture of a ping"])
