"""``usmap merge``: the maps of several areas, or of several fusions, as one."""

from pathlib import Path
from typing import Annotated

import typer

from usmap_ros.cli.parameters import ParametersFile, Settings, pipeline_parameters

#: Parameters of mapping that joining maps obeys.
OBEYED = ("prior", "least_log_odds", "greatest_log_odds", "most_cells")


def merge(
    maps: Annotated[
        list[Path],
        typer.Argument(metavar="DIR...", help="Folders of maps, such as those of map_fusion."),
    ],
    output: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="DIR", help="Folder for the whole map's files."),
    ],
    parameters_file: ParametersFile = None,
    settings: Settings = None,
) -> None:
    """Join maps of one frame: side by side, and where they overlap, by adding their log-odds.

    No ping may be in two of them, or it counts twice.
    """
    from usmap_ros.io.map_files import NAV2_FILE, load_map, map_folder, save_map
    from usmap_ros.mapping.merging import merge_maps
    from usmap_ros.pings.robot_paths import RobotPaths

    for setting in settings or []:
        if setting.partition("=")[0].strip() not in {f"mapping.{name}" for name in OBEYED}:
            raise typer.BadParameter(
                f"{setting!r} changes nothing: maps are joined by mapping.{', '.join(OBEYED)}",
                param_hint="'--set'",
            )
    parameters = pipeline_parameters(parameters_file, settings)
    paths, loaded = RobotPaths(), []
    for folder in dict.fromkeys(maps):
        occupancy, own = load_map(folder)
        loaded.append(occupancy)
        paths.extend(own)
    whole = merge_maps(loaded, parameters.mapping)
    with map_folder(output):
        save_map(output, whole, paths)
    rows, columns = whole.geometry.shape
    typer.echo(f"{output / NAV2_FILE}: {len(loaded)} maps, {columns} x {rows} cells")
