"""Robots that move and ping, and how their reported poses are off."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from usmap_ros.acoustics.pulse import PulseShape
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.geometry import Pose, on_base
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.pings.transducer_array import ArrayElement, TransducerArray
from usmap_ros.simulation.motion import Motion
from usmap_ros.simulation.simulator import NANOSECONDS, EchoSimulator, Intruder, MountedTransducer
from usmap_ros.simulation.wheel_odometry import OdometryErrors, WheelOdometry

#: Over so much of a path its velocity is measured.
_MOMENT_S = 1e-3


class PoseErrors:
    """Errors of x, y and yaw in standard deviations, from ping to ping.

    A first-order Gauss-Markov process: what odometry or a filter makes of a pose is not off anew
    a tenth of a second later.

    Parameters
    ----------
    seed : numpy.random.SeedSequence
        What they are drawn from.
    wander_s : float
        Time in which the memory of an error falls to 1/e; 0 draws each anew.
    """

    def __init__(self, seed: np.random.SeedSequence, wander_s: float) -> None:
        self._rng = np.random.default_rng(seed)
        self._wander_s = wander_s
        self._time_s = -math.inf
        self._error = np.zeros(3)

    def at(self, time_s: float) -> FloatArray:
        """Errors at a time, which lies after the last one that was asked for.

        Parameters
        ----------
        time_s : float
            On any clock; where it was set back, the error stays as it is.
        """
        passed_s = max(time_s - self._time_s, 0.0)
        memory = math.exp(-passed_s / self._wander_s) if self._wander_s else 0.0
        news = self._rng.standard_normal(3)
        self._error = memory * self._error + math.sqrt(1.0 - memory * memory) * news
        self._time_s = time_s
        return self._error


@dataclass(frozen=True)
class SimulatedRobot:
    """A robot of a scenario."""

    #: Its name, and the first part of its topics and frames.
    name: str
    motion: Motion
    transducers: list[MountedTransducer]
    #: When each transducer pings first.
    first_ping_s: list[float]
    #: From each transducer's ping to its next one.
    ping_interval_s: float
    #: For each transducer's noise and errors.
    noise_seeds: list[np.random.SeedSequence]
    #: Whether the transducers ping at once, and hear one another's pulses.
    simultaneous: bool
    #: For the errors of poses that its transducers share.
    error_seed: np.random.SeedSequence
    #: Time in which the memory of such an error falls to 1/e; 0 draws each ping's anew.
    pose_wander_s: float = 0.0
    #: How long before its stamp a pose was true.
    pose_late_s: float = 0.0
    #: Whether it goes on moving while it listens.
    moves_during_ping: bool = False
    #: How its poses drift; None: they are absolute.
    odometry: OdometryErrors | None = None
    #: When it is carried off.
    jumps_s: tuple[float, ...] = ()

    @property
    def knows_start(self) -> bool:
        """Whether poses that drift are in the world's frame, and not in one of its own."""
        return self.odometry is None or self.odometry.start == "known"

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
            if self.simultaneous or group[0].transducer.pulse.shape is PulseShape.CHIRP
        ]

    def shared_array(self, start_ns: int) -> TransducerArray | None:
        """The array of all its transducers, if they ping at once; see `arrays`."""
        return self.arrays(start_ns)[0] if self.simultaneous else None

    def shared_pose_errors(self) -> PoseErrors | None:
        """Errors that its transducers share: of pings at once, or of one bias that wanders.

        Each transducer draws the same from a process of its own; None if each ping has its own.
        """
        if not (self.simultaneous or self.pose_wander_s):
            return None
        return PoseErrors(self.error_seed, self.pose_wander_s)

    def wheels(self) -> WheelOdometry | None:
        """Its odometry, from its start on; None if its poses are absolute.

        Each transducer has one of its own, and all draw the same.
        """
        if self.odometry is None:
            return None
        start = self.motion.pose(0.0) if self.knows_start else Pose.planar(0.0, 0.0, 0.0)
        return WheelOdometry(self.motion, self.odometry, self.error_seed, start, self.jumps_s)

    def told(
        self, trace: EchoTrace, wheels: WheelOdometry | None, time_s: float, mount: Pose
    ) -> EchoTrace:
        """A trace with the pose that its odometry, or what knows of its place too late, has."""
        told_s = max(0.0, time_s - self.pose_late_s)
        if wheels is not None:
            pose = on_base(wheels.at(told_s), mount)
            frame_id = trace.frame_id if self.knows_start else f"{self.name}/odom"
            return replace(trace, pose=pose, frame_id=frame_id)
        if not self.pose_late_s:
            return trace
        now, then = (self.motion.pose(at_s).compose(mount) for at_s in (time_s, told_s))
        return replace(trace, pose=then.compose(now.inverse().compose(trace.pose)))

    def velocity_m_s(self, time_s: float, sonar: MountedTransducer) -> FloatArray | None:
        """Velocity, (3,), of a transducer on its path; None if it stands still while it listens."""
        is_carried = any(time_s < jump_s <= time_s + _MOMENT_S for jump_s in self.jumps_s)
        if not self.moves_during_ping or is_carried:
            return None
        now, soon = (
            self.motion.pose(at_s).compose(sonar.mount).position_m
            for at_s in (time_s, time_s + _MOMENT_S)
        )
        velocity_m_s: FloatArray = (soon - now) / _MOMENT_S
        return velocity_m_s

    def intrusions(self, sonar: MountedTransducer, time_s: float) -> Iterator[Intruder]:
        """Pulses of its own that are in the air while another robot's `sonar` listens."""
        for own, first_s in zip(self.transducers, self.first_ping_s, strict=True):
            if not own.emits:
                continue
            # What was sent longer ago has faded.
            earliest_s = time_s - sonar.listening_s - first_s
            latest_s = time_s + sonar.listening_s - first_s
            first = max(0, int(np.ceil(earliest_s / self.ping_interval_s)))
            last = int(np.floor(latest_s / self.ping_interval_s))
            for ping in range(first, last + 1):
                sent_s = first_s + ping * self.ping_interval_s
                pose = self.motion.pose(sent_s).compose(own.mount)
                yield Intruder(own, pose, sent_s - time_s)

    def ping_times_s(self, index: int, duration_s: float) -> Iterator[float]:
        """When transducer `index` pings, after the scene's start."""
        for ping in range(ping_count(duration_s, self.ping_interval_s)):
            yield self.first_ping_s[index] + ping * self.ping_interval_s

    def pings(
        self,
        simulator: EchoSimulator,
        index: int,
        start_ns: int,
        duration_s: float,
        others: Sequence[SimulatedRobot] = (),
    ) -> Iterator[tuple[str, EchoTrace]]:
        """Topic and trace of every ping of transducer `index`, among which `others` are heard."""
        transducer, rng = self.transducers[index], np.random.default_rng(self.noise_seeds[index])
        array = self.shared_array(start_ns)
        errors, wheels = self.shared_pose_errors(), self.wheels()
        for time_s in self.ping_times_s(index, duration_s):
            stamp_ns = stamp_of(start_ns, time_s)
            pose = self.motion.pose(time_s).compose(transducer.mount)
            trace = simulator.ping(
                transducer,
                pose,
                stamp_ns,
                rng,
                array=array,
                pose_error=None if errors is None else errors.at(time_s),
                velocity_m_s=self.velocity_m_s(time_s, transducer),
                intruders=[one for other in others for one in other.intrusions(transducer, time_s)],
            )
            yield transducer.topic, self.told(trace, wheels, time_s, transducer.mount)


def stamp_of(start_ns: int, time_s: float) -> int:
    """Stamp of a time after the scene's start."""
    return start_ns + round(time_s * NANOSECONDS)


def ping_count(duration_s: float, interval_s: float) -> int:
    """How many pings, the first at 0, begin before `duration_s`."""
    # A duration of whole intervals counts exactly, whatever the last bit of the quotient.
    return max(1, int(np.ceil(round(duration_s / interval_s, 6))))
