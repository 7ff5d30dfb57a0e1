"""``usmap plot``: a picture of a bag, a cone, or a map."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from usmap_ros.cli import console
from usmap_ros.cli.parameters import ParametersFile, Settings, pipeline_parameters

if TYPE_CHECKING:
    from collections.abc import Iterator

    from usmap_ros.pings.cone import EchoCone
    from usmap_ros.pings.robot_paths import RobotPaths
    from usmap_ros.pings.trace import EchoTrace
    from usmap_ros.pings.trajectory import Trajectory


#: What can be drawn of a map instead of its probability, or on it.
Layer = Literal["normal_rad", "ambiguity"]


def plot(
    path: Annotated[
        Path, typer.Argument(metavar="PATH", help="A bag, or a folder that 'usmap map' wrote.")
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="Picture: .png, .pdf or .svg.")
    ],
    ping: Annotated[
        int | None,
        typer.Option(
            min=0,
            metavar="N",
            help="Which ping of a bag, in order of stamps; the first if left out.",
        ),
    ] = None,
    truth: Annotated[
        Path | None, typer.Option(metavar="MAP.yaml", help="Show what is really there, too.")
    ] = None,
    layer: Annotated[
        Layer | None,
        typer.Option(help="Of a map: which way surfaces face, or how undecided cells are."),
    ] = None,
    extent: Annotated[
        str | None,
        typer.Option(
            metavar="X0,X1,Y0,Y1",
            help="Of a map: show just this part (m), so that pictures can be compared.",
        ),
    ] = None,
    parameters_file: ParametersFile = None,
    settings: Settings = None,
) -> None:
    """Draw a map, or one ping of a bag: its trace, what was found in it, and its cone."""
    from usmap_ros.errors import MapFileError
    from usmap_ros.io.map_files import GRID_FILE, load_map, load_truth
    from usmap_ros.plotting.map import map_figure
    from usmap_ros.plotting.picture import draw
    from usmap_ros.plotting.style import save_figure

    shown = _extent(extent)
    true_cells = load_truth(truth) if truth else None
    if path.name == GRID_FILE or (path / GRID_FILE).exists():
        _refuse({"--ping": ping, "--parameters": parameters_file, "--set": settings}, "recordings")
        occupancy, paths = load_map(path)
        title = path.resolve().name
        try:
            told = _told(path, paths)
            figure = map_figure(occupancy, paths, true_cells, title, shown, layer, told)
        except ValueError as error:
            raise MapFileError(path, str(error)) from error
    else:
        _refuse({"--layer": layer, "--extent": shown}, "maps")
        parameters = pipeline_parameters(parameters_file, settings)
        chosen = _ping(path, ping or 0)
        console.compile_loops()
        figure = draw(chosen, true_cells, parameters)
    save_figure(figure, output)
    typer.echo(output)


def _told(path: Path, paths: RobotPaths) -> dict[str, Trajectory]:
    """Paths of a map as odometry told them, by topic, where poses were refined."""
    from usmap_ros.io.map_files import PATHS_FOLDER, TOLD_FOLDER
    from usmap_ros.io.tum_files import file_name, load_trajectories

    folder = (path if path.is_dir() else path.parent) / PATHS_FOLDER / TOLD_FOLDER
    if not folder.is_dir():
        return {}
    told = load_trajectories(folder)
    topics = {file_name(topic): topic for topic in paths.positions_m}
    return {topics[name]: path for name, path in told.items() if name in topics}


def _refuse(options: dict[str, object], only_for: str) -> None:
    """Refuse options that were given and would do nothing."""
    for option, value in options.items():
        if value is not None:
            raise typer.BadParameter(f"is for {only_for} only", param_hint=f"'{option}'")


def _extent(text: str | None) -> tuple[float, float, float, float] | None:
    """Lowest and highest x, lowest and highest y."""
    if text is None:
        return None
    try:
        x_min, x_max, y_min, y_max = (float(part) for part in text.split(","))
    except ValueError:
        x_min = x_max = y_min = y_max = math.nan
    # Comparisons with NaN are false.
    if not (x_min < x_max and y_min < y_max and max(map(abs, (x_min, x_max, y_min, y_max))) < 1e9):
        raise typer.BadParameter(
            f"{text!r} is not of the form X0,X1,Y0,Y1 with X0 < X1 and Y0 < Y1",
            param_hint="'--extent'",
        )
    return x_min, x_max, y_min, y_max


def _ping(bag_path: Path, number: int) -> EchoTrace | EchoCone:
    """Ping number `number` of a bag: its trace if the bag has traces, or else its cone."""
    from itertools import islice

    from usmap_ros.errors import BagError
    from usmap_ros.io.bag_reader import BagReader

    with BagReader([bag_path]) as bag:
        pings: Iterator[tuple[str, EchoTrace | EchoCone]] = bag.traces()
        if not bag.trace_count:
            pings = bag.cones()
        chosen = next(islice(pings, number, None), None)
        if chosen is None:
            usable = (bag.trace_count or bag.cone_count) - bag.skipped.total
            raise BagError(bag_path, f"has no ping {number}: its {usable} pings count from 0")
    return chosen[1]
