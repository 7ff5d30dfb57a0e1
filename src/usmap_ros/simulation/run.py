"""A whole scenario, ping by ping."""

from __future__ import annotations

import heapq
from collections.abc import Iterator

from usmap_ros.simulation.scenario import Scenario
from usmap_ros.simulation.simulator import EchoSimulator
from usmap_ros.trace import EchoTrace


def simulate(scenario: Scenario) -> Iterator[tuple[str, EchoTrace]]:
    """Topic and trace of every ping of a scenario, in the order of their stamps.

    The same scenario gives the same traces, bit by bit.
    """
    scene = scenario.scene()
    simulator = EchoSimulator(scene, scenario.frame_id, scenario.start_ns)
    streams = [
        robot.pings(simulator, index, scenario.start_ns, scenario.duration_s)
        for robot in scenario.fleet(scene)
        for index in range(len(robot.transducers))
    ]
    yield from heapq.merge(*streams, key=lambda ping: ping[1].stamp_ns)
