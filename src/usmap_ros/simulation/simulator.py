"""The echo simulator, one ping at a time."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from usmap_ros.acoustics.propagation import Channel
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.trace import EchoTrace, Emission
from usmap_ros.pings.transducer_array import TransducerArray
from usmap_ros.simulation.echo_paths import Sounding, direct_path, echo_paths
from usmap_ros.simulation.receiver import Arrivals, Receiver
from usmap_ros.simulation.scene import Scene
from usmap_ros.simulation.wall_paths import PathEnd

NANOSECONDS = 1_000_000_000
#: Quaternion of a frame that is not turned.
NO_TURN = np.array([0.0, 0.0, 0.0, 1.0])


@dataclass(frozen=True)
class MountedTransducer:
    """A transducer on a robot, with all that does not change from ping to ping."""

    topic: str
    #: Frame of the transducer, +x along the beam's axis.
    child_frame_id: str
    #: Of its frame in the robot's base frame.
    mount: Pose
    transducer: Transducer
    receiver: Receiver
    #: What the sound really travels through.
    channel: Channel
    #: What the trace says it travels through.
    stated_channel: Channel
    #: What the trace says of the noise.
    stated_noise_std: float
    #: (3,) array: standard deviations of the error of reported poses: x, y (m) and yaw (rad).
    pose_stds: FloatArray
    #: Whether it sends its pulse, or only listens to others'.
    emits: bool = True
    #: (3,) array: where its receiving element is in its frame, in which it sends from the origin.
    receiver_offset_m: FloatArray = field(default_factory=lambda: np.zeros(3))
    #: How fast the speed of sound changes, from that of `channel` at the scene's start on.
    drift_m_s2: float = 0.0

    def channel_at(self, time_s: float) -> Channel:
        """What the sound travels through at a time after the scene's start."""
        if self.drift_m_s2 == 0.0:
            return self.channel
        speed_m_s = self.channel.sound_speed_m_s + self.drift_m_s2 * time_s
        return replace(self.channel, sound_speed_m_s=speed_m_s)

    @property
    def listening_s(self) -> float:
        """Until one pulse length after the echo from the largest range, over the longest path.

        What follows that echo is noise alone, and tells where it ends.
        """
        longest = self.channel.delays_s(np.array(self.transducer.max_range_m)).max()
        return float(longest) + 2.0 * self.transducer.pulse.length_s


@dataclass(frozen=True)
class Intruder:
    """A pulse of another robot that is in the air."""

    sonar: MountedTransducer
    #: Pose in the world that the pulse is sent from.
    pose: Pose
    #: From the emission of the one that listens to its own.
    delay_s: float


@dataclass(frozen=True)
class EchoSimulator:
    """Simulates pings in a scene.

    Each ping is heard alone, unless pulses of others are named: the next one comes when it has
    faded.
    """

    #: Discs, walls and facets that return sound.
    scene: Scene
    #: World frame of all poses.
    frame_id: str = "map"
    #: Stamp at which the moving objects start.
    start_ns: int = 0

    def ping(
        self,
        sonar: MountedTransducer,
        true_pose: Pose,
        stamp_ns: int,
        rng: np.random.Generator,
        *,
        array: TransducerArray | None = None,
        pose_error: FloatArray | None = None,
        velocity_m_s: FloatArray | None = None,
        intruders: Sequence[Intruder] = (),
    ) -> EchoTrace:
        """What one ping brings back.

        Parameters
        ----------
        sonar : MountedTransducer
            The transducer that pings, and where it is on its robot.
        true_pose : Pose
            Where the transducer really is.
        stamp_ns : int
            Start of emission, nanoseconds since the epoch.
        rng : numpy.random.Generator
            For the noise and the error of the reported pose.
        array : TransducerArray, optional
            Transducers of its robot that ping at once, itself among them; None: it pings alone.
        pose_error : (3,) array, optional
            Error of the reported pose in standard deviations, which transducers of a robot that
            ping at once share; None: it is drawn.
        velocity_m_s : (3,) array, optional
            Of the transducer while it listens; None: it stands still.
        intruders : sequence of Intruder
            Pulses of other robots that are in the air.

        Returns
        -------
        EchoTrace
            With `sonar`'s stated channel and a pose that is off by as much as its covariance
            says.
        """
        receiver = sonar.receiver
        trace = EchoTrace(
            stamp_ns=stamp_ns,
            frame_id=self.frame_id,
            child_frame_id=sonar.child_frame_id,
            pose=true_pose,
            transducer=sonar.transducer,
            channel=sonar.stated_channel,
            encoding=receiver.encoding,
            sample_rate_hz=receiver.sample_rate_hz,
            start_delay_s=receiver.start_delay_s,
            noise_std=sonar.stated_noise_std,
            samples=np.zeros(0, dtype=np.float32),
        )
        if array is not None:
            trace = trace.in_array(array)
        time_s = (stamp_ns - self.start_ns) / NANOSECONDS
        heard_at = true_pose
        if np.any(sonar.receiver_offset_m):
            heard_at = true_pose.compose(Pose(sonar.receiver_offset_m, NO_TURN))
        listener = PathEnd(heard_at, sonar.transducer.beam)
        arrivals = [
            self._arrivals(sonar, true_pose, listener, time_s, emission, velocity_m_s)
            for emission in trace.sent
        ]
        arrivals += [self._intrusion(sonar, listener, time_s, one) for one in intruders]
        samples = receiver.receive(
            arrivals,
            sonar.transducer.pulse,
            receiver.sample_count(sonar.listening_s),
            rng,
            emits=sonar.emits,
        )
        if pose_error is None:
            pose_error = rng.standard_normal(3)
        pose = reported_pose(true_pose, sonar.pose_stds, pose_error)
        if sonar.transducer.pulse.profile is not None:
            # Messages know of the burst that drives a transducer, not of what comes of it.
            told = None if array is None else array.stated
            trace = replace(trace, transducer=sonar.transducer.stated, array=told)
        return replace(trace, pose=pose, samples=samples)

    def _arrivals(
        self,
        sonar: MountedTransducer,
        true_pose: Pose,
        listener: PathEnd,
        time_s: float,
        emission: Emission,
        velocity_m_s: FloatArray | None,
    ) -> Arrivals:
        """Paths of a pulse of its own robot that can arrive while the receiver listens."""
        sender, half_angle_rad = true_pose.compose(emission.mount), np.pi
        if emission.child_frame_id == sonar.child_frame_id:
            sender, half_angle_rad = true_pose, sonar.transducer.beam.half_angle_rad
        channel = sonar.channel_at(time_s)
        sounding = Sounding(
            PathEnd(sender, emission.transducer.beam),
            listener,
            half_angle_rad,
            sonar.listening_s * sonar.channel.sound_speed_m_s / 2.0,
            channel,
            time_s,
            velocity_m_s,
        )
        lengths_m, amplitudes = echo_paths(self.scene, sounding)
        return Arrivals(emission.transducer.pulse, lengths_m / channel.sound_speed_m_s, amplitudes)

    def _intrusion(
        self, sonar: MountedTransducer, listener: PathEnd, time_s: float, intruder: Intruder
    ) -> Arrivals:
        """Paths of another robot's pulse: straight, and over what answers."""
        channel, other = sonar.channel_at(time_s), intruder.sonar
        sender = PathEnd(intruder.pose, other.transducer.beam)
        reach_m = (sonar.listening_s - intruder.delay_s) * channel.sound_speed_m_s / 2.0
        sounding = Sounding(sender, listener, np.pi, reach_m, channel, time_s)
        straight = direct_path(self.scene, sender, listener, channel, time_s)
        echoes = echo_paths(self.scene, sounding)
        lengths_m, amplitudes = (
            np.concatenate(column) for column in zip(straight, echoes, strict=True)
        )
        delays_s = intruder.delay_s + lengths_m / channel.sound_speed_m_s
        return Arrivals(other.transducer.pulse, delays_s, amplitudes)


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
    turned = drifted.compose(true_pose)
    return Pose(true_pose.position_m + drifted.position_m, turned.orientation, drifted.covariance)
