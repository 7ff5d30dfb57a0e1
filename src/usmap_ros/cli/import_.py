"""``usmap import``: samples or ranges of one's own hardware to a bag."""

from pathlib import Path
from typing import Annotated

import typer


def import_files(
    description: Annotated[
        Path,
        typer.Argument(
            metavar="SENSOR.yaml",
            help="Which files hold samples, or ranges, and poses, and what hardware.",
        ),
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="BAG", help="Folder of the recording.")
    ],
    force: Annotated[
        bool, typer.Option("--force", "-f", help="Replace a recording that is there already.")
    ] = False,
) -> None:
    """Make a recording of samples, or ranges, and poses in NumPy, CSV or WAV files."""
    from usmap_ros.importing import imported_ranges, imported_traces
    from usmap_ros.io.bags import write_bag
    from usmap_ros.io.yaml_files import read_mapping

    has_ranges = "ranges" in read_mapping(description)
    imported = imported_ranges if has_ranges else imported_traces
    count = write_bag(output, imported(description), replace=force)
    typer.echo(f"{output}: {count} pings")
