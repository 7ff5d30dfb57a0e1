"""Robots that move and ping."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from usmap_ros.acoustics.pulse import PulseShape
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.pings.transducer_array import ArrayElement, TransducerArray
from usmap_ros.simulation.motion import Motion
from usmap_ros.simulation.pose_errors import PoseErrors
from usmap_ros.simulation.simulator import (
    NANOSECONDS,
    EchoSimulator,
    Intruder,
    MountedTransducer,
)

#: Over so much of a path its velocity is measured.
_MOMENT_S = 1e-3


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
        For the errors of poses that its transducers share.
    pose_wander_s : float
        Time in which the memory of such an error falls to 1/e; 0 draws each ping's anew.
    moves_during_ping : bool
        Whether it goes on moving while it listens.
    """

    name: str
    motion: Motion
    transducers: list[MountedTransducer]
    first_ping_s: list[float]
    ping_interval_s: float
    noise_seeds: list[np.random.SeedSequence]
    simultaneous: bool
    error_seed: np.random.SeedSequence
    pose_wander_s: float = 0.0
    moves_during_ping: bool = False

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

    def velocity_m_s(self, time_s: float, sonar: MountedTransducer) -> FloatArray | None:
        """Velocity, (3,), of a transducer on its path; None if it stands still while it listens."""
        if not self.moves_during_ping:
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
        errors = self.shared_pose_errors()
        for ping in range(ping_count(duration_s, self.ping_interval_s)):
            time_s = self.first_ping_s[index] + ping * self.ping_interval_s
            stamp_ns = start_ns + round(time_s * NANOSECONDS)
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
            yield transducer.topic, trace


def ping_count(duration_s: float, interval_s: float) -> int:
    """How many pings, the first at 0, begin before `duration_s`."""
    # A duration of whole intervals counts exactly, whatever the last bit of the quotient.
    return max(1, int(np.ceil(round(duration_s / interval_s, 6))))
