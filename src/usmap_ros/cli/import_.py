"""``usmap import``: samples of one's own hardware to a bag."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def import_files(
    description: Annotated[
        Path,
        typer.Argument(
            metavar="SENSOR.yaml", help="Which files hold samples and poses, and what hardware."
        ),
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="BAG", help="Folder of the recording.")
    ],
    force: Annotated[
        bool, typer.Option("--force", "-f", help="Replace a recording that is there already.")
    ] = False,
) -> None:
    """Make a recording of samples and poses in NumPy, CSV or WAV files."""
    from usmap_ros.importing import imported_traces
    from usmap_ros.io.bags import write_bag

    count = write_bag(output, imported_traces(description), replace=force)
    typer.echo(f"{output}: {count} pings")
