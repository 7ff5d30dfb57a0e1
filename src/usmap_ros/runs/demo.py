"""The main job, end to end: simulate, record, reconstruct, fuse, score, draw."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from usmap_ros.errors import FileError
from usmap_ros.grids import AMBIGUITY, NORMAL, OccupancyMap, TruthMap
from usmap_ros.io.bag_reader import BagReader
from usmap_ros.io.bag_writer import new_bag
from usmap_ros.io.map_files import NAV2_FILE, map_folder, save_map, save_truth
from usmap_ros.io.yaml_files import read_mapping
from usmap_ros.pings.robot_paths import RobotPaths
from usmap_ros.plotting.shown import Extent, MapFrame, shown_extent
from usmap_ros.processes.cluster import Failure, attempt, results
from usmap_ros.processes.threads import begun
from usmap_ros.processes.workers import worker_processes
from usmap_ros.simulation import Scenario, record

if TYPE_CHECKING:
    from usmap_ros.evaluation.scoring import Score
    from usmap_ros.mapping.candidates import CandidateCells
    from usmap_ros.reconstruction.explained import Reconstruction
    from usmap_ros.runs.demo_map import Observer

#: Shows how far something is that takes a number of steps; gives what tells of each step.
Progress = Callable[[str, int], AbstractContextManager[Callable[[], None]]]

#: Processes that simulate and draw while this one loads what it maps with, maps and scores.
HELPERS = 2


@dataclass(frozen=True)
class DemoResult:
    """What the demo made."""

    #: Where it is, by what it is.
    paths: dict[str, Path]
    #: As in ``summary.json``.
    summary: dict[str, Any]
    #: Of the map, and of what a range-only sonar model makes of the same recording.
    score: Score
    range_score: Score


def run_demo(folder: Path, progress: Progress, compile_loops: Callable[[], None]) -> DemoResult:
    """Simulate a fleet, record it, map the recording, score the map and draw it all.

    Parameters
    ----------
    folder : path
        Where everything goes; what an earlier demo left there is replaced.
    progress : callable
        Shows how far it is.
    compile_loops : callable
        Has all inner loops compiled; called before the first is needed.
    """
    with map_folder(folder), worker_processes(HELPERS) as helpers:
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
        recorded = _begun(helpers, _record, scenario, paths["recording"])
        # Not at once: until all is recorded, two cores have enough to do.
        begun(partial(_load_plotting_after, recorded, helpers))
        compile_loops()
        # These take as long to load as the robots take to be simulated.
        from usmap_ros.runs.demo_map import Observer
        from usmap_ros.runs.offline import map_bag

        with progress("simulating", 1) as step:
            _check(paths["recording"], recorded.result())
            step()
        _begun(helpers, _load_plotting)
        truth = scenario.truth_map()
        save_truth(paths["truth"], truth)
        started = time.perf_counter()
        observer = Observer(scenario.ping_count)
        with (
            BagReader([paths["recording"]]) as bag,
            progress("mapping", bag.trace_count) as step,
        ):
            run = map_bag(bag, observer.pipeline, observer.paths, observer.watch(step))
        occupancy = observer.pipeline.occupancy_map()
        summary = save_map(
            folder,
            occupancy,
            observer.paths,
            lambda: run.summary(occupancy, time.perf_counter() - started),
        )
        scores = begun(partial(observer.scores, truth))
        _draw(observer, truth, paths, helpers, progress)
        return DemoResult(paths, summary, *scores.result())


def _demo_scenario() -> Scenario:
    source = Path(str(files("usmap_ros").joinpath("config", "scenarios", "room.yaml")))
    return Scenario.from_mapping(read_mapping(source), source)


def _begun(helpers: Executor | None, work: Callable[..., None], *arguments: Any) -> Future[Any]:
    """Have something done meanwhile: by a thread, if there are no helpers."""
    if helpers is None:
        return begun(partial(attempt, work, *arguments))
    return helpers.submit(attempt, work, *arguments)


def _check(path: Path, done: object) -> None:
    """Raise what kept a file from being written."""
    if isinstance(done, Failure):
        raise FileError(path, done.cause)


def _record(scenario: Scenario, path: Path) -> None:
    with new_bag(path, replace=True) as writer:
        record(scenario, writer, lambda: None)


def _load_plotting_after(recorded: Future[Any], helpers: Executor | None) -> None:
    """Let the helper that has recorded load what draws; the other one does when maps begin."""
    recorded.result()
    _begun(helpers, _load_plotting)


def _load_plotting() -> None:
    for module in ("animation", "overview"):
        import_module(f"usmap_ros.plotting.{module}")


def _draw(
    observer: Observer,
    truth: TruthMap,
    paths: dict[str, Path],
    helpers: Executor | None,
    progress: Progress,
) -> None:
    """Draw both maps to the same extent, one ping, and the map forming."""
    occupancy, range_only = observer.pipeline.occupancy_map(), observer.range_only.occupancy_map()
    extent_m = shown_extent([occupancy, range_only], observer.paths, truth)
    draw_map = partial(_draw_map, observer.paths, truth, extent_m)
    draw_film = partial(_draw_film, observer.paths, truth, extent_m)
    pictures: dict[str, Callable[[Path], None]] = {
        "picture of a ping": partial(_draw_ping, *observer.explained(paths["recording"]), truth),
        "picture of the map": partial(draw_map, occupancy, "Three robots, one map", None),
        "range-only sonar": partial(
            draw_map, range_only, "The same recording, from the first echoes' ranges alone", None
        ),
        "which way walls face": partial(draw_map, occupancy, "Which way surfaces face", NORMAL),
        "what is undecided": partial(draw_map, occupancy, "What is undecided", AMBIGUITY),
    }
    names = [*pictures, "map forming"]

    def work() -> Iterator[tuple[Callable[[Path], None], Path]]:
        for name, draw in pictures.items():
            yield draw, paths[name]
        # Last, because the others are drawn while its maps are made.
        yield partial(draw_film, observer.film.frames(occupancy)), paths["map forming"]

    with progress("drawing", len(names)) as step:
        for number, drawn in results(helpers, _draw_to, work()):
            _check(paths[names[number]], drawn)
            step()


def _draw_to(draw: Callable[[Path], None], path: Path) -> None:
    draw(path)


def _draw_film(
    paths: RobotPaths, truth: TruthMap, extent_m: Extent, frames: list[MapFrame], path: Path
) -> None:
    from usmap_ros.plotting.animation import save_animation

    save_animation(frames, paths, path, truth, extent_m)


def _draw_map(
    paths: RobotPaths,
    truth: TruthMap,
    extent_m: Extent,
    occupancy: OccupancyMap,
    title: str,
    layer: str | None,
    path: Path,
) -> None:
    from usmap_ros.plotting.map import map_figure
    from usmap_ros.plotting.style import save_figure

    save_figure(map_figure(occupancy, paths, truth, title, extent_m, layer), path)


def _draw_ping(
    reconstruction: Reconstruction, candidates: CandidateCells, truth: TruthMap, path: Path
) -> None:
    from usmap_ros.plotting.overview import overview_figure
    from usmap_ros.plotting.style import save_figure

    save_figure(overview_figure(reconstruction, candidates, truth), path)
