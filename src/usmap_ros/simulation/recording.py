"""A whole scenario, ping by ping."""

import heapq
from collections.abc import Callable, Iterator

from usmap_ros.io.bag_writer import BagWriter
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.pings.trajectory import Trajectory
from usmap_ros.simulation.robot import stamp_of
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


def true_paths(scenario: Scenario) -> dict[str, Trajectory]:
    """Where each transducer really is at its pings, by topic."""
    paths = {}
    for robot in scenario.fleet(scenario.scene()):
        for index, transducer in enumerate(robot.transducers):
            times_s = robot.ping_times_s(index, scenario.duration_s)
            paths[transducer.topic] = Trajectory.of_poses(
                (
                    stamp_of(scenario.start_ns, at_s),
                    robot.motion.pose(at_s).compose(transducer.mount),
                )
                for at_s in times_s
            )
    return paths


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
