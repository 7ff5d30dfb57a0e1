"""Transducers that a scenario simulates."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from usmap_ros.live.scenario_time import ScenarioTime
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.simulation import EchoSimulator, MountedTransducer
from usmap_ros.simulation.robot import SimulatedRobot
from usmap_ros.simulation.scene import Scene
from usmap_ros.simulation.simulator import NANOSECONDS


@dataclass(frozen=True)
class SimulatedWorld:
    """Where a robot pings."""

    scene: Scene
    #: Frame that poses are in, shared by all robots.
    frame_id: str
    #: When the scenario began, which may change.
    time: ScenarioTime
    robot: SimulatedRobot
    #: Whose pulses it hears.
    others: Sequence[SimulatedRobot]


class SimulatedTransducers:
    """Transducers of a simulated robot that ping at once; a `PingSource`.

    Parameters
    ----------
    world : SimulatedWorld
        Where they ping.
    transducers : sequence of (MountedTransducer, SeedSequence)
        Each with what its noise is drawn from.
    """

    def __init__(
        self,
        world: SimulatedWorld,
        transducers: Sequence[tuple[MountedTransducer, np.random.SeedSequence]],
    ) -> None:
        self._world = world
        self._sonars = [(sonar, np.random.default_rng(seed)) for sonar, seed in transducers]
        self._array = world.robot.shared_array(0)
        self._errors = world.robot.shared_pose_errors()
        self._wheels = world.robot.wheels()

    def open(self) -> None:
        """Nothing has to be opened."""

    def close(self) -> None:
        """Nothing is open."""

    def ping(self, stamp_ns: int, base: Pose) -> list[EchoTrace]:
        """Simulate what they hear."""
        world = self._world
        # Its moving objects set off with the scenario, whose start follows jumps of the clock.
        simulator = EchoSimulator(world.scene, world.frame_id, world.time.start_ns)
        time_s = (stamp_ns - world.time.start_ns) / NANOSECONDS
        error = None if self._errors is None else self._errors.at(time_s)
        traces = [
            simulator.ping(
                sonar,
                base.compose(sonar.mount),
                stamp_ns,
                rng,
                array=self._array,
                pose_error=error,
                velocity_m_s=world.robot.velocity_m_s(time_s, sonar),
                intruders=[
                    one for other in world.others for one in other.intrusions(sonar, time_s)
                ],
            )
            for sonar, rng in self._sonars
        ]
        wheels = self._wheels
        if wheels is None:
            return traces
        return [
            world.robot.told(trace, wheels, time_s, sonar.mount)
            for trace, (sonar, _) in zip(traces, self._sonars, strict=True)
        ]
