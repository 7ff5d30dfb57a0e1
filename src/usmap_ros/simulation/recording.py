"""A whole scenario, ping by ping."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator

from usmap_ros.io.bag_writer import BagWriter
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.simulation.scenario import Scenario
from usmap_ros.simulation.simulator import EchoSimulator


def record(scenario: Scenario, writer: BagWriter, step: Callable[[], None]) -> int:
    """Simulate a scenario into a recording.

    Parameters
    ----------
    scenario : Scenario
        What to simulate.
    writer : BagWriter
        Gets every trace.
    step : callable
        Called after each ping.

    Returns
    -------
    int
        How many traces were written.
    """
    count = 0
    for topic, trace in simulate(scenario):
        writer.write_trace(topic, trace)
        count += 1
        step()
    return count


def simulate(scenario: Scenario) -> Iterator[tuple[str, EchoTrace]]:
    """Topic and trace of every ping of a scenario, in the order of their stamps.

    The same scenario gives the same traces, bit by bit.
    """
    scene = scenario.scene()
    simulator = EchoSimulator(scene, scenario.frame_id, scenario.start_ns)
    fleet = scenario.fleet(scene)
    streams = [
        robot.pings(
            simulator,
            index,
            scenario.start_ns,
            scenario.duration_s,
            scenario.heard_by(robot, fleet),
        )
        for robot in fleet
        for index in range(len(robot.transducers))
    ]
    yield from heapq.merge(*streams, key=lambda ping: ping[1].stamp_ns)
