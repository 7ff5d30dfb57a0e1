"""The echo simulator, one ping at a time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from usmap_ros.acoustics.legs import straight_legs
from usmap_ros.acoustics.propagation import Channel
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.arrays import FloatArray
from usmap_ros.geometry import Pose
from usmap_ros.simulation.receiver import Arrivals, Receiver
from usmap_ros.simulation.scene import Scene
from usmap_ros.simulation.view import View, targets_in_view
from usmap_ros.simulation.wall_paths import Ear, paths_by_walls
from usmap_ros.trace import EchoTrace, Emission
from usmap_ros.transducer_array import TransducerArray

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
        array: TransducerArray | None = None,
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
        array : TransducerArray, optional
            Transducers of its robot that ping at once, itself among them; None: it pings alone.
        pose_error : (3,) array, optional
            Error of the reported pose in standard deviations, which transducers of a robot that
            ping at once share; None: it is drawn.

        Returns
        -------
        EchoTrace
            With `sonar`'s stated channel and a pose that is off by as much as its covariance
            says.
        """
        receiver = sonar.receiver
        trace = EchoTrace(
            stamp_ns=stamp_ns,
            frame_id=self._frame_id,
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
        samples = receiver.receive(
            [self._arrivals(sonar, true_pose, stamp_ns, emission) for emission in trace.sent],
            sonar.transducer.pulse.carrier_hz,
            receiver.sample_count(sonar.listening_s),
            rng,
        )
        if pose_error is None:
            pose_error = rng.standard_normal(3)
        pose = reported_pose(true_pose, sonar.pose_stds, pose_error)
        return replace(trace, pose=pose, samples=samples)

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
        time_s = (stamp_ns - self._start_ns) / NANOSECONDS
        targets = targets_in_view(self._scene, view, time_s)
        channel, points_m = sonar.channel, targets.positions_m
        there = straight_legs(sender, emission.transducer.beam, channel, points_m)
        back = straight_legs(true_pose, sonar.transducer.beam, channel, points_m)
        lengths_m, gains = there.paths(back)
        amplitudes = targets.reflectivities[:, np.newaxis] * gains
        lengths_m, amplitudes = lengths_m.ravel(), amplitudes.ravel()
        if self._scene.wall_paths:
            listener = Ear(true_pose, sonar.transducer.beam)
            by_walls = paths_by_walls(
                self._scene, Ear(sender, emission.transducer.beam), listener, channel, time_s
            )
            lengths_m = np.concatenate([lengths_m, by_walls[0]])
            amplitudes = np.concatenate([amplitudes, by_walls[1]])
        delays_s = lengths_m / channel.sound_speed_m_s
        return Arrivals(emission.transducer.pulse, delays_s, amplitudes)


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
