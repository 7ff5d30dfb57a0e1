"""``usmap map``: bags to a map."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from usmap_ros.cli import console
from usmap_ros.cli.mapped import seconds_since_start, tell
from usmap_ros.cli.parameters import (
    ParametersFile,
    Settings,
    pipeline_parameters,
    with_short_options,
)

if TYPE_CHECKING:
    from collections.abc import Iterable

    from usmap_ros.parameters import PipelineParameters
    from usmap_ros.runs.pipeline import Pipeline


def _methods() -> list[str]:
    """Ways of fusing, as a shell completes them."""
    from usmap_ros.runs.pipeline import FUSIONS

    return list(FUSIONS)


def map_bags(
    bags: Annotated[
        list[Path],
        typer.Argument(
            metavar="BAG...",
            help="rosbag2 folders, .mcap or .db3 files, or folders with many of them inside.",
        ),
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for the map's files.")
    ],
    resolution: Annotated[
        float | None, typer.Option(metavar="M", help="Side of a map cell in metres.")
    ] = None,
    method: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Short for --set mapping.method=NAME: joint, additive, or range_only to"
            " see what a sensor that measures ranges only would make of the same pings.",
            autocompletion=_methods,
        ),
    ] = None,
    parameters_file: ParametersFile = None,
    settings: Settings = None,
    resume: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Continue the map in this folder.")
    ] = None,
    without: Annotated[
        list[str] | None,
        typer.Option(metavar="ROBOT", help="Leave out this robot, or topic; may be repeated."),
    ] = None,
    frame: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="The map's frame; without it, the one that most robots share in the first seconds."
            " Pings in other frames are set apart.",
        ),
    ] = None,
    poses: Annotated[
        Literal["told", "refined"] | None,
        typer.Option(
            help="Short for --set poses.use=...: map with poses as they were told, or refine them"
            " by the echoes; without it, odometry, whose covariance grows or whose frame is the"
            " robot's own, is refined."
        ),
    ] = None,
    jobs: Annotated[
        int,
        typer.Option(
            "--jobs",
            "-j",
            min=0,
            help="Processes that reconstruct; 0: one for each core if the recording is long.",
        ),
    ] = 0,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Have a Dask cluster do it: its scheduler, such as tcp://10.0.0.1:8786, or 'local'"
            " for one of --jobs processes. Its workers need the bags and DIR under the same names.",
        ),
    ] = None,
    tile: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            min=1.0,
            help="Divide areas into tiles of this side (m) at the most, each for one worker; for"
            " folders of recordings, and for clusters.",
        ),
    ] = None,
    passes: Annotated[
        int,
        typer.Option(
            min=0, max=100, help="Further looks at the recent pings (mapping.window) at the end."
        ),
    ] = 0,
    force: Annotated[
        bool, typer.Option("--force", "-f", help="Replace a map that is there, without asking.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    """Turn recorded bags into a map: for nav2, as log-odds, and a summary."""
    from usmap_ros.io.map_files import GRID_FILE
    from usmap_ros.runs.collection import find_recordings

    is_continued = resume is not None and resume.resolve() == output.resolve()
    # Programs are not asked: whoever writes one says what it replaces.
    if (output / GRID_FILE).exists() and sys.stdin.isatty() and not (force or is_continued):
        typer.confirm(f"{output}: holds a map already; replace it?", abort=True, err=True)
    short = {
        "--method": ("mapping.method", method),
        "--resolution": ("mapping.resolution_m", resolution),
        "--poses": ("poses.use", poses),
    }
    parameters = pipeline_parameters(parameters_file, with_short_options(settings, short))
    order = _Order(output, parameters, jobs, passes, without or [], frame or "", tile or math.inf)
    _refuse_idle(order, scheduler)
    recordings = find_recordings(bags, besides=output)
    if scheduler is None and set(recordings) == set(bags):
        if tile:
            raise typer.BadParameter(
                "goes with folders of recordings, or a --scheduler", param_hint="'--tile'"
            )
        _map_together(order, bags, resume, as_json=as_json)
    elif resume is not None:
        raise typer.BadParameter("--resume goes with single recordings, on this machine")
    elif parameters.poses.use == "refined" or parameters.poses.starts():
        raise typer.BadParameter(
            "refined, and poses.initial_poses: go with single recordings", param_hint="'--poses'"
        )
    else:
        _map_collection(order, recordings, scheduler, as_json=as_json)


@dataclass(frozen=True)
class _Order:
    """What is wanted, wherever the pings come from."""

    output: Path
    parameters: PipelineParameters
    jobs: int
    passes: int
    without: list[str]
    frame: str
    tile_m: float


def _refuse_idle(order: _Order, scheduler: str | None) -> None:
    """Refuse options that would do nothing, before there is any work."""
    from usmap_ros.errors import UsmapError
    from usmap_ros.runs.parallel import most_processes
    from usmap_ros.runs.pipeline import Pipeline

    if order.jobs and scheduler not in (None, "local"):
        raise typer.BadParameter("is up to the cluster's workers", param_hint="'--jobs'")
    if order.jobs > most_processes():
        raise typer.BadParameter(
            f"{order.jobs} processes are more than {most_processes()}, a few for each core",
            param_hint="'--jobs'",
        )
    # Without a single ping it costs nothing.
    pipeline = Pipeline(order.parameters)
    try:
        pipeline.refine(order.passes)
    except UsmapError as error:
        raise typer.BadParameter(str(error), param_hint="'--passes'") from error


def _refuse_absent(without: list[str], topics: Iterable[str]) -> None:
    """Refuse to leave out who is not there."""
    from usmap_ros.mapping.robot_check.consistency import is_of

    known = sorted(topics)
    for name in without:
        if not any(is_of(topic, [name]) for topic in known):
            raise typer.BadParameter(
                f"{name!r} is nobody's name here; there are {', '.join(known)}",
                param_hint="'--without'",
            )


def _map_together(order: _Order, bags: list[Path], resume: Path | None, *, as_json: bool) -> None:
    """Map recordings as if they were one."""
    from usmap_ros.io.bag_reader import BagReader
    from usmap_ros.io.map_files import PATHS_FOLDER, TOLD_FOLDER, map_folder, save_map
    from usmap_ros.io.tum_files import save_trajectories
    from usmap_ros.pings.robot_paths import RobotPaths
    from usmap_ros.processes.cores import available_cores
    from usmap_ros.runs.offline import map_bag, resume_map
    from usmap_ros.runs.parallel import WORTH_A_POOL, reconstructors
    from usmap_ros.runs.pipeline import Pipeline
    from usmap_ros.runs.recorded import learn_reception

    if resume is None:
        pipeline, paths = Pipeline(order.parameters), RobotPaths()
    else:
        pipeline, paths = resume_map(resume, order.parameters)
    _state_frame(order, pipeline)
    pipeline.refine(order.passes)
    with BagReader(bags) as bag, map_folder(order.output):
        _refuse_absent(order.without, bag.ping_topics())
        # Not before it is known that all there is to read can be read.
        console.compile_loops()
        cores = available_cores() if bag.trace_count > WORTH_A_POOL else 1
        pings = (bag.trace_count or bag.cone_count) + bag.range_count
        with reconstructors(pipeline, order.jobs or cores) as workers:
            learn_reception(bag, pipeline, workers)
            with console.progress("mapping", pings) as step:
                run = map_bag(
                    bag, pipeline, paths, lambda topic, cone: step(), workers, order.without
                )
        occupancy = pipeline.occupancy_map()
        run.doubted = pipeline.fusion.doubted
        run.common_error = pipeline.fusion.common_error
        summary = save_map(
            order.output, occupancy, paths, lambda: run.summary(occupancy, seconds_since_start())
        )
    if run.poses.robots:
        save_trajectories(order.output / PATHS_FOLDER, paths.trajectories())
        told = order.output / PATHS_FOLDER / TOLD_FOLDER
        save_trajectories(told, run.poses.told.trajectories())
    tell(order.output, run, summary, as_json=as_json)


def _state_frame(order: _Order, pipeline: Pipeline) -> None:
    """Have the map in the frame that is asked for."""
    before = pipeline.fusion.frame_id
    if order.frame and before not in ("", order.frame):
        raise typer.BadParameter(f"the map to continue is in '{before}'", param_hint="'--frame'")
    pipeline.fusion.frame_id = order.frame or before


def _map_collection(
    order: _Order, recordings: list[Path], scheduler: str | None, *, as_json: bool
) -> None:
    """Map many recordings, each by itself as far as that goes; a second run takes up the first."""
    from usmap_ros.errors import UsmapError
    from usmap_ros.io.map_files import map_folder, save_map
    from usmap_ros.processes.cluster import cluster
    from usmap_ros.processes.cores import available_cores
    from usmap_ros.processes.workers import worker_processes
    from usmap_ros.runs.collection import AreaOptions, map_collection

    with map_folder(order.output):
        console.compile_loops()
    jobs = order.jobs or available_cores()
    with (
        cluster(scheduler, jobs) if scheduler else worker_processes(jobs) as executor,
        console.progress("mapping", 2 * len(recordings)) as step,
    ):
        done = map_collection(
            recordings, order.output, order.parameters, executor,
            wishes=AreaOptions(order.passes, tuple(order.without), order.frame, order.tile_m),
            step=step,
        )  # fmt: skip
    summary = save_map(
        order.output, done.occupancy, done.paths, lambda: done.summary(seconds_since_start())
    )
    for text in [*done.warnings, *(f"{name}: {cause}" for name, cause in done.failed.items())]:
        typer.echo(f"usmap: warning: {text}", err=True)
    tell(order.output, done.run, summary, as_json=as_json)
    _refuse_absent(order.without, {*done.run.without, *done.run.robots})
    if done.failed:
        raise UsmapError(
            f"{len(done.failed)} of {len(recordings)} recordings could not be used; the map is of"
            " the others"
        )
