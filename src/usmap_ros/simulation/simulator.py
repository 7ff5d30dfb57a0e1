"""The echo simulator: one ping at a time, or a whole scenario."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from usmap_ros.acoustics.propagation import Channel
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.arrays import FloatArray
from usmap_ros.geometry import Pose
from usmap_ros.simulation.motion import Motion
from usmap_ros.simulation.receiver import Receiver
from usmap_ros.simulation.scene import Scene
from usmap_ros.simulation.view import View, targets_in_view
from usmap_ros.trace import EchoTrace

if TYPE_CHECKING:
    from usmap_ros.simulation.scenario import Scenario


NANOSECONDS = 1_000_000_000


@dataclass(frozen=True)
class MountedTransducer:
    """A transducer on a robot, with all that does not change from ping to ping.

    Parameters
    ----------
    topic : str
        Where its echoes are published.
    child_frame_id : str
        Its frame.
    mount : Pose
        Of its frame in the robot's base frame.
    transducer : Transducer
        Pulse, beam and range limits.
    receiver : Receiver
        Noise, converter, encoding.
    channel : Channel
        What the sound really travels through.
    stated_channel : Channel
        What the trace says it travels through.
    stated_noise_std : float
        What the trace says of the noise.
    pose_stds : (3,) array
        Standard deviations of the error of reported poses: x, y (m) and yaw (rad).
    """

    topic: str
    child_frame_id: str
    mount: Pose
    transducer: Transducer
    receiver: Receiver
    channel: Channel
    stated_channel: Channel
    stated_noise_std: float
    pose_stds: FloatArray

    @property
    def listening_s(self) -> float:
        """Until one pulse length after the echo from the largest range, over the longest path.

        What follows that echo is noise alone, and tells where it ends.
        """
        longest = self.channel.delays_s(np.array(self.transducer.max_range_m)).max()
        return float(longest) + 2.0 * self.transducer.pulse.duration_s


class EchoSimulator:
    """Simulates pings in a scene.

    Each ping is heard alone: the next one, and other robots, come when it has faded.

    Parameters
    ----------
    scene : Scene
        The world.
    frame_id : str
        World frame of all poses.
    start_ns : int
        Stamp at which the moving objects start.
    """

    def __init__(self, scene: Scene, frame_id: str = "map", start_ns: int = 0) -> None:
        self._scene = scene
        self._frame_id = frame_id
        self._start_ns = start_ns

    def ping(
        self, sonar: MountedTransducer, true_pose: Pose, stamp_ns: int, rng: np.random.Generator
    ) -> EchoTrace:
        """What one ping brings back.

        Parameters
        ----------
        sonar : MountedTransducer
            Who pings.
        true_pose : Pose
            Where the transducer really is.
        stamp_ns : int
            Start of emission, nanoseconds since the epoch.
        rng : numpy.random.Generator
            For the noise and the error of the reported pose.

        Returns
        -------
        EchoTrace
            With `sonar`'s stated channel and a pose that is off by as much as its covariance
            says.
        """
        delays_s, amplitudes = self._paths(sonar, true_pose, stamp_ns)
        receiver = sonar.receiver
        samples = receiver.receive(
            sonar.transducer.pulse,
            delays_s,
            amplitudes,
            receiver.sample_count(sonar.listening_s),
            rng,
        )
        return EchoTrace(
            stamp_ns=stamp_ns,
            frame_id=self._frame_id,
            child_frame_id=sonar.child_frame_id,
            pose=reported_pose(true_pose, sonar.pose_stds, rng),
            transducer=sonar.transducer,
            channel=sonar.stated_channel,
            encoding=receiver.encoding,
            sample_rate_hz=receiver.sample_rate_hz,
            start_delay_s=receiver.start_delay_s,
            noise_std=sonar.stated_noise_std,
            samples=samples,
        )

    def _paths(
        self, sonar: MountedTransducer, true_pose: Pose, stamp_ns: int
    ) -> tuple[FloatArray, FloatArray]:
        """Delays and amplitudes of all paths that can arrive while the receiver listens."""
        beam = sonar.transducer.beam
        view = View(
            true_pose,
            beam.half_angle_rad,
            sonar.listening_s * sonar.channel.sound_speed_m_s / 2.0,
        )
        targets = targets_in_view(self._scene, view, (stamp_ns - self._start_ns) / NANOSECONDS)
        echoes = targets.reflectivities * beam.gain(targets.bearings_rad)
        amplitudes = echoes[:, np.newaxis] * sonar.channel.amplitudes(targets.ranges_m)
        return sonar.channel.delays_s(targets.ranges_m).ravel(), amplitudes.ravel()


def reported_pose(true_pose: Pose, stds: FloatArray, rng: np.random.Generator) -> Pose:
    """`true_pose` with independent errors of x, y and yaw, and the covariance they came from."""
    x_error, y_error, yaw_error = stds * rng.standard_normal(3)
    x, y, z = true_pose.position_m
    yaw = true_pose.yaw_rad + yaw_error
    return Pose.planar(x + x_error, y + y_error, yaw, z, np.diag(stds**2))


@dataclass(frozen=True)
class SimulatedRobot:
    """A robot of a scenario.

    Parameters
    ----------
    name : str
        Its name, and the first part of its topics and frames.
    motion : Motion
        Where its base is.
    transducers : list of MountedTransducer
        What it carries.
    first_ping_s : list of float
        When each transducer pings first.
    ping_interval_s : float
        From each transducer's ping to its next one.
    noise_seeds : list of numpy.random.SeedSequence
        For each transducer's noise and errors.
    """

    name: str
    motion: Motion
    transducers: list[MountedTransducer]
    first_ping_s: list[float]
    ping_interval_s: float
    noise_seeds: list[np.random.SeedSequence]

    def pings(
        self, simulator: EchoSimulator, index: int, start_ns: int, duration_s: float
    ) -> Iterator[tuple[str, EchoTrace]]:
        """Topic and trace of every ping of transducer `index`."""
        transducer, rng = self.transducers[index], np.random.default_rng(self.noise_seeds[index])
        for ping in range(ping_count(duration_s, self.ping_interval_s)):
            time_s = self.first_ping_s[index] + ping * self.ping_interval_s
            stamp_ns = start_ns + round(time_s * NANOSECONDS)
            pose = self.motion.pose(time_s).compose(transducer.mount)
            yield transducer.topic, simulator.ping(transducer, pose, stamp_ns, rng)


def ping_count(duration_s: float, interval_s: float) -> int:
    """How many pings, the first at 0, begin before `duration_s`."""
    # A duration of whole intervals counts exactly, whatever the last bit of the quotient.
    return max(1, int(np.ceil(round(duration_s / interval_s, 6))))


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
