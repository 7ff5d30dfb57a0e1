"""``usmap map``: bags to a map."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from usmap_ros.cli import console
from usmap_ros.cli.elapsed import seconds_since_start
from usmap_ros.cli.parameters import ParametersFile, Settings, pipeline_parameters


def _methods() -> list[str]:
    """Ways of fusing, as a shell completes them."""
    from usmap_ros.pipeline import FUSIONS

    return list(FUSIONS)


def map_bags(
    bags: Annotated[
        list[Path], typer.Argument(metavar="BAG...", help="rosbag2 folders, .mcap or .db3 files.")
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
            help="Short for --set mapping.method=NAME: superposition, additive, or range_only to"
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
    jobs: Annotated[
        int,
        typer.Option(
            "--jobs", "-j", min=0, help="Processes that reconstruct; 0: one for each core."
        ),
    ] = 0,
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
    from usmap_ros.io.bag_reader import BagReader
    from usmap_ros.io.map_files import GRID_FILE, RobotPaths, map_folder, save_map, save_summary
    from usmap_ros.offline import map_bag, resume_map
    from usmap_ros.parallel import available_cores, reconstructors
    from usmap_ros.pipeline import Pipeline

    is_continued = resume is not None and resume.resolve() == output.resolve()
    # Programs are not asked: whoever writes one says what it replaces.
    if (output / GRID_FILE).exists() and sys.stdin.isatty() and not (force or is_continued):
        typer.confirm(f"{output}: holds a map already; replace it?", abort=True, err=True)
    chosen = [f"mapping.method={method}"] if method else []
    parameters = pipeline_parameters(parameters_file, [*(settings or []), *chosen], resolution)
    if resume is None:
        pipeline, paths = Pipeline(parameters), RobotPaths()
    else:
        pipeline, paths = resume_map(resume, parameters)
    with (
        reconstructors(pipeline, jobs or available_cores()) as workers,
        BagReader(bags) as bag,
        map_folder(output),
    ):
        with console.progress(
            "mapping", (bag.trace_count or bag.cone_count) + bag.range_count
        ) as step:
            run = map_bag(bag, pipeline, paths, lambda topic, cone: step(), workers, without or ())
        pipeline.refine(passes)
        occupancy = pipeline.occupancy_map()
        save_map(output, occupancy, paths)
        summary = run.summary(occupancy, seconds_since_start())
        save_summary(output, summary)
    for topic, problem in run.suspects().items():
        typer.echo(f"usmap: warning: {topic}: {problem}; --without {topic} leaves it out", err=True)
    if as_json:
        typer.echo(json.dumps(summary, indent=2))
    else:
        typer.echo(
            f"{output / 'map.yaml'}: {run.pings} pings, {run.echoes} echoes,"
            f" {summary['cells_occupied']} of {summary['cells_observed']} observed cells occupied;"
            f" {summary['seconds']:.1f} s, {summary['pings_per_second']:.0f} pings/s"
        )
