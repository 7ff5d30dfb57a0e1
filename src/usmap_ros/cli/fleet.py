"""``usmap fleet``: all nodes of a scenario, as processes."""

import os
import signal
import time
from pathlib import Path
from typing import Annotated

import typer

from usmap_ros.cli import console
from usmap_ros.live.requirements import require_ros

#: Time that the nodes get to start before the robots set off, s.
_HEAD_START_S = 3.0


def fleet(
    scenario_file: Annotated[
        Path, typer.Argument(metavar="SCENARIO.yaml", help="World and robots.")
    ],
    checkpoint: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="DIR", help="Keep the map in this folder."),
    ] = None,
    parameters_file: Annotated[
        Path | None, typer.Option("--parameters", "-p", metavar="FILE.yaml", help="For ROS nodes.")
    ] = None,
    robots: Annotated[
        list[str] | None,
        typer.Option("--robot", metavar="NAME", help="Only this robot; may be repeated."),
    ] = None,
    discovery_server: Annotated[
        str | None,
        typer.Option(
            metavar="HOST:PORT",
            help="Find nodes on other hosts by this Fast DDS discovery server, not by multicast.",
        ),
    ] = None,
    duration: Annotated[
        float | None, typer.Option(min=0.0, metavar="S", help="End after so many seconds.")
    ] = None,
) -> None:
    """Simulate and map live: a driver and a reconstructor a robot, and one fusion.

    Each is a process of its own, restarted if it dies. Ctrl-C ends all of them.
    """
    require_ros()
    from usmap_ros.live.fleet_processes import check_parameter_file, fleet_nodes, fleet_task
    from usmap_ros.live.supervisor import Supervisor

    if parameters_file is not None:
        check_parameter_file(parameters_file)
    # Before it is settled when the robots set off: the nodes would miss that.
    console.compile_loops()
    nodes = fleet_nodes(
        scenario_file,
        start_time_s=time.time() + _HEAD_START_S,
        robots=robots or [],
        checkpoint=checkpoint,
    )
    if discovery_server is not None:
        os.environ["ROS_DISCOVERY_SERVER"] = discovery_server
    tasks = [fleet_task(node, parameters_file) for node in nodes]
    supervisor = Supervisor(tasks, lambda line: print(line, flush=True))
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: supervisor.stop())
    supervisor.run(duration)
