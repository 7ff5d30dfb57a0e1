"""``usmap replay``: a bag onto live ROS topics."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from usmap_ros.cli.live import require_ros, run_live_node


def replay(
    bag: Annotated[Path, typer.Argument(metavar="BAG", help="rosbag2 folder, .mcap or .db3 file.")],
    rate: Annotated[
        float,
        typer.Option(
            min=0.001, max=1000.0, metavar="R", help="Speed, relative to the recording's."
        ),
    ] = 1.0,
    loop: Annotated[bool, typer.Option("--loop", help="Start over at the end.")] = False,
    start_paused: Annotated[
        bool, typer.Option("--start-paused", help="Wait for the service /bag_replay/pause.")
    ] = False,
    topics: Annotated[
        str, typer.Option(metavar="REGEX", help="Publish topics whose whole name matches.")
    ] = ".*",
    clock: Annotated[bool, typer.Option(help="Publish /clock.")] = True,
    wait: Annotated[
        float, typer.Option(min=0.0, metavar="S", help="Longest wait for subscribers, in seconds.")
    ] = 5.0,
) -> None:
    """Publish a bag on ROS topics, with its own QoS, and its time on /clock."""
    require_ros()
    import rclpy

    from usmap_ros.nodes.bag_replay import BagReplay

    run_live_node(
        lambda **options: BagReplay(on_end=rclpy.try_shutdown, **options),
        {
            "bag": str(bag),
            "rate": rate,
            "loop": loop,
            "start_paused": start_paused,
            "topic_pattern": topics,
            "clock": clock,
            "wait_s": wait,
        },
    )
