"""The echo simulator: one ping at a time, or a whole scenario."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from usmap_ros.acoustics.propagation import Channel
from usmap_ros.acoustics.pulse import PulseShape
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.arrays import FloatArray
from usmap_ros.geometry import Pose
from usmap_ros.simulation.motion import Motion
from usmap_ros.simulation.receiver import Arrivals, Receiver
from usmap_ros.simulation.scene import Scene
from usmap_ros.simulation.view import View, targets_in_view
from usmap_ros.trace import EchoTrace, Emission
from usmap_ros.transducer_array import ArrayElement, TransducerArray

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
    emits : bool
        Whether it sends its pulse, or only listens to others'.
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
    emits: bool = True

    def emission_to(self, listener: MountedTransducer) -> Emission:
        """Its pulse, as one that listens on the same robot has it."""
        mount = listener.mount.inverse().compose(self.mount)
        return Emission(self.child_frame_id, mount, self.transducer)

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
        self,
        sonar: MountedTransducer,
        true_pose: Pose,
        stamp_ns: int,
        rng: np.random.Generator,
        *,
        emissions: tuple[Emission, ...] = (),
        pose_error: FloatArray | None = None,
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
        emissions : tuple of Emission
            All pulses in the air, where transducers of a robot ping at once; none: its own.
        pose_error : (3,) array, optional
            Error of the reported pose in standard deviations, which transducers of a robot that
            ping at once share; None: it is drawn.

        Returns
        -------
        EchoTrace
            With `sonar`'s stated channel and a pose that is off by as much as its covariance
            says.
        """
        arrivals = [
            self._arrivals(sonar, true_pose, stamp_ns, emission)
            for emission in emissions or (sonar.emission_to(sonar),)
        ]
        receiver = sonar.receiver
        samples = receiver.receive(
            arrivals,
            sonar.transducer.pulse.carrier_hz,
            receiver.sample_count(sonar.listening_s),
            rng,
        )
        if pose_error is None:
            pose_error = rng.standard_normal(3)
        return EchoTrace(
            stamp_ns=stamp_ns,
            frame_id=self._frame_id,
            child_frame_id=sonar.child_frame_id,
            pose=reported_pose(true_pose, sonar.pose_stds, pose_error),
            transducer=sonar.transducer,
            channel=sonar.stated_channel,
            encoding=receiver.encoding,
            sample_rate_hz=receiver.sample_rate_hz,
            start_delay_s=receiver.start_delay_s,
            noise_std=sonar.stated_noise_std,
            samples=samples,
            emissions=emissions,
        )

    def _arrivals(
        self, sonar: MountedTransducer, true_pose: Pose, stamp_ns: int, emission: Emission
    ) -> Arrivals:
        """Paths of a pulse that can arrive while the receiver listens."""
        sender, half_angle_rad = true_pose.compose(emission.mount), np.pi
        if emission.child_frame_id == sonar.child_frame_id:
            sender, half_angle_rad = true_pose, sonar.transducer.beam.half_angle_rad
        # What is nearest to the two of them together is nearest to the middle between them.
        middle_m = 0.5 * (true_pose.position_m + sender.position_m)
        view = View(
            replace(true_pose, position_m=middle_m),
            half_angle_rad,
            sonar.listening_s * sonar.channel.sound_speed_m_s / 2.0,
        )
        targets = targets_in_view(self._scene, view, (stamp_ns - self._start_ns) / NANOSECONDS)
        there_m, sent_at = sender.polar(targets.positions_m)
        back_m, heard_at = true_pose.polar(targets.positions_m)
        # One way the gain is the root of that both ways.
        gains = np.sqrt(
            emission.transducer.beam.gain(sent_at) * sonar.transducer.beam.gain(heard_at)
        )
        delays_s, amplitudes = sonar.channel.between(there_m, back_m)
        amplitudes *= (targets.reflectivities * gains)[:, np.newaxis]
        return Arrivals(emission.transducer.pulse, delays_s.ravel(), amplitudes.ravel())


def reported_pose(true_pose: Pose, stds: FloatArray, error: FloatArray) -> Pose:
    """`true_pose` with errors of x, y and yaw, and the covariance that they came from.

    Parameters
    ----------
    true_pose : Pose
        Tilted or not.
    stds : (3,) array
        Standard deviations: x, y (m) and yaw (rad).
    error : (3,) array
        The errors themselves, in standard deviations.
    """
    x_error, y_error, yaw_error = stds * error
    drifted = Pose.planar(x_error, y_error, yaw_error, planar_covariance=np.diag(stds**2))
    return Pose(
        position_m=true_pose.position_m + drifted.position_m,
        orientation=(drifted.rotation * true_pose.rotation).as_quat(),
        covariance=drifted.covariance,
    )


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
    simultaneous : bool
        Whether the transducers ping at once, and hear one another's pulses.
    error_seed : numpy.random.SeedSequence
        For the errors of poses that transducers share which ping at once.
    """

    name: str
    motion: Motion
    transducers: list[MountedTransducer]
    first_ping_s: list[float]
    ping_interval_s: float
    noise_seeds: list[np.random.SeedSequence]
    simultaneous: bool
    error_seed: np.random.SeedSequence

    def emissions_to(self, listener: MountedTransducer) -> tuple[Emission, ...]:
        """All pulses in the air when a transducer listens; none where it is alone."""
        if not self.simultaneous:
            return ()
        return tuple(one.emission_to(listener) for one in self.transducers if one.emits)

    def arrays(self, start_ns: int) -> list[TransducerArray]:
        """What the traces of its transducers do not say of themselves, if there is anything.

        Parameters
        ----------
        start_ns : int
            Stamp from which on it holds.
        """
        groups = [self.transducers] if self.simultaneous else [[one] for one in self.transducers]
        return [
            TransducerArray(
                start_ns,
                f"{self.name}/base_link",
                tuple(
                    ArrayElement(one.child_frame_id, one.mount, one.emits, one.transducer)
                    for one in group
                ),
            )
            for group in groups
            if len(group) > 1 or group[0].transducer.pulse.shape is PulseShape.CHIRP
        ]

    def pings(
        self, simulator: EchoSimulator, index: int, start_ns: int, duration_s: float
    ) -> Iterator[tuple[str, EchoTrace]]:
        """Topic and trace of every ping of transducer `index`."""
        transducer, rng = self.transducers[index], np.random.default_rng(self.noise_seeds[index])
        emissions = self.emissions_to(transducer)
        # Those that ping at once draw the same errors, each from a generator of its own.
        errors = np.random.default_rng(self.error_seed)
        for ping in range(ping_count(duration_s, self.ping_interval_s)):
            time_s = self.first_ping_s[index] + ping * self.ping_interval_s
            stamp_ns = start_ns + round(time_s * NANOSECONDS)
            pose = self.motion.pose(time_s).compose(transducer.mount)
            error = errors.standard_normal(3) if self.simultaneous else None
            yield (
                transducer.topic,
                simulator.ping(
                    transducer, pose, stamp_ns, rng, emissions=emissions, pose_error=error
                ),
            )


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
