"""``usmap plot``: a picture of a bag, a cone, or a map."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from usmap_ros.cli.parameters import ParametersFile, Settings, pipeline_parameters

if TYPE_CHECKING:
    from collections.abc import Iterator

    from usmap_ros.cone import EchoCone
    from usmap_ros.trace import EchoTrace


class Layer(str, Enum):
    """What can be drawn of a map instead of its probability, or on it."""

    NORMAL = "normal_rad"
    AMBIGUITY = "ambiguity"


def plot(
    path: Annotated[
        Path, typer.Argument(metavar="PATH", help="A bag, or a folder that 'usmap map' wrote.")
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="Picture: .png, .pdf or .svg.")
    ],
    ping: Annotated[
        int, typer.Option(min=0, metavar="N", help="Which ping of a bag, in order of stamps.")
    ] = 0,
    truth: Annotated[
        Path | None, typer.Option(metavar="MAP.yaml", help="Show what is really there, too.")
    ] = None,
    layer: Annotated[
        Layer | None,
        typer.Option(help="Of a map: which way surfaces face, or how undecided cells are."),
    ] = None,
    parameters_file: ParametersFile = None,
    settings: Settings = None,
) -> None:
    """Draw a map, or one ping of a bag: its trace, what was found in it, and its cone."""
    from usmap_ros.errors import MapFileError
    from usmap_ros.io.map_files import GRID_FILE, load_map, load_truth
    from usmap_ros.plotting import draw, map_figure, save_figure

    true_cells = load_truth(truth) if truth else None
    if path.name == GRID_FILE or (path / GRID_FILE).exists():
        occupancy, paths = load_map(path)
        name, title = layer and layer.value, path.resolve().name
        try:
            figure = map_figure(occupancy, paths, true_cells, title, layer=name)
        except ValueError as error:
            raise MapFileError(path, str(error)) from error
    elif layer is not None:
        raise typer.BadParameter("is for maps only", param_hint="'--layer'")
    else:
        parameters = pipeline_parameters(parameters_file, settings)
        figure = draw(_ping(path, ping), true_cells, parameters)
    save_figure(figure, output)
    typer.echo(output)


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
