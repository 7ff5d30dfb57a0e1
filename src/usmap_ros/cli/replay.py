"""``usmap replay``: a bag onto live ROS topics."""

from pathlib import Path
from typing import Annotated

import typer

from usmap_ros.cli.live import run_live_node
from usmap_ros.live.requirements import require_ros


def replay(
    bag: Annotated[Path, typer.Argument(metavar="BAG", help="rosbag2 folder, .mcap or .db3 file.")],
    rate: Annotated[
        float | None, typer.Option(metavar="R", help="Speed, relative to the recording's.")
    ] = None,
    loop: Annotated[bool, typer.Option("--loop", help="Start over at the end.")] = False,
    start_paused: Annotated[
        bool, typer.Option("--start-paused", help="Wait for the service /bag_replay/pause.")
    ] = False,
    topics: Annotated[
        str | None,
        typer.Option(metavar="GLOBS", help="Publish only topics whose whole name matches one."),
    ] = None,
    clock: Annotated[
        bool | None, typer.Option("--clock/--no-clock", help="Whether to publish /clock.")
    ] = None,
    wait: Annotated[
        float | None, typer.Option(metavar="S", help="Longest wait for subscribers, in seconds.")
    ] = None,
) -> None:
    """Publish a bag on ROS topics, with its own QoS, and its time on /clock.

    What is not given has the default of the node bag_replay.
    """
    require_ros()
    import rclpy

    from usmap_ros.nodes.bag_replay import BagReplay
    from usmap_ros.parameters.nodes import BagReplayParameters

    run_live_node(
        lambda **options: BagReplay(on_end=rclpy.try_shutdown, **options),
        BagReplayParameters,
        {
            "bag": str(bag),
            "rate": rate,
            "loop": loop or None,
            "start_paused": start_paused or None,
            "topic_pattern": topics,
            "clock": clock,
            "wait_s": wait,
        },
    )
