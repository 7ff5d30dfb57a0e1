"""``usmap simulate``: a scenario to a bag."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from usmap_ros.cli import console


def simulate(
    scenario_file: Annotated[
        Path, typer.Argument(metavar="SCENARIO.yaml", help="World, robots and noise.")
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="BAG", help="Folder of the recording.")
    ],
    compression: Annotated[
        Literal["none", "lz4", "zstd"], typer.Option(help="Compression of the recording.")
    ] = "none",
    truth: Annotated[
        Path | None,
        typer.Option(metavar="MAP.yaml", help="Write the true map as well, in nav2's format."),
    ] = None,
    true_paths_folder: Annotated[
        Path | None,
        typer.Option(
            "--true-paths",
            metavar="DIR",
            help="Write where each transducer really was as well: TUM files, for 'usmap evaluate"
            " --paths'.",
        ),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", "-f", help="Replace a recording that is there already.")
    ] = False,
) -> None:
    """Simulate a scenario and record it: the same scenario gives the same bag on a machine."""
    if truth is not None and truth.suffix not in (".yaml", ".yml"):
        raise typer.BadParameter("must end in .yaml", param_hint="'--truth'")
    from usmap_ros.io.bag_writer import new_bag
    from usmap_ros.io.map_files import save_truth
    from usmap_ros.io.tum_files import save_trajectories
    from usmap_ros.io.yaml_files import read_mapping
    from usmap_ros.simulation import Scenario, record, true_paths

    scenario = Scenario.from_mapping(read_mapping(scenario_file), scenario_file)
    with (
        new_bag(output, replace=force, compression=compression) as writer,
        console.progress("simulating", scenario.ping_count) as step,
    ):
        # Before what takes long, and where an error takes the recording along.
        if truth is not None:
            save_truth(truth, scenario.truth_map())
        if true_paths_folder is not None:
            save_trajectories(true_paths_folder, true_paths(scenario))
        count = record(scenario, writer, step)
    typer.echo(f"{output}: {count} pings of {len(scenario.robots)} robots")
