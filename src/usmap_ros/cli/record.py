"""``usmap record``: live ROS topics to a bag."""

from pathlib import Path
from typing import Annotated

import typer

from usmap_ros.cli.live import run_live_node
from usmap_ros.live.requirements import require_ros


def record(
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="BAG", help="Folder of the new recording.")
    ],
    topics: Annotated[
        str | None,
        typer.Option(metavar="GLOBS", help="Record only topics whose whole name matches one."),
    ] = None,
) -> None:
    """Record ROS topics into MCAP until Ctrl-C; what was written outlives even a kill."""
    require_ros()
    from usmap_ros.nodes.bag_recorder import BagRecorder
    from usmap_ros.parameters.nodes import BagRecorderParameters

    given = {"bag": str(output), "topic_pattern": topics}
    run_live_node(BagRecorder, BagRecorderParameters, given)
