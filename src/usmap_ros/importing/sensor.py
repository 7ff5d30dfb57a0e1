"""From samples as a sensor counts them to an echo trace, by what a description says of it."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from usmap_ros.acoustics.medium import Air
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.importing.description import Recording
from usmap_ros.numerics.geometry import PLANAR_AXES, Pose
from usmap_ros.pings.trace import EchoTrace, Encoding


class Sensor:
    """A transducer as a description has it.

    Parameters
    ----------
    description : Recording
        Hardware, air, and where the transducer sits on its robot.
    sample_rate_hz : float, optional
        Where the description states none.
    """

    def __init__(self, description: Recording, sample_rate_hz: float = 0.0) -> None:
        self._description = description
        self.sample_rate_hz = sample_rate_hz or description.samples.sample_rate_hz
        pulse = description.pulse.build()
        self._transducer = Transducer(
            pulse, description.beam.build(), description.min_range_m, description.max_range_m
        )
        air = description.air
        self._channel = Air(air.temperature_c, air.relative_humidity).channel(
            pulse.carrier_hz, air.floor_height_m, air.floor_reflectivity
        )
        poses = description.poses
        stds = [poses.position_std_m, poses.position_std_m, poses.yaw_std_rad]
        self._covariance = np.zeros((6, 6))
        self._covariance[PLANAR_AXES, PLANAR_AXES] = np.square(stds)
        self._mount = poses.mount.build()

    @property
    def robot(self) -> str:
        """Name of the robot."""
        return self._description.robot

    @property
    def frame_id(self) -> str:
        """World frame of poses."""
        return self._description.frame_id

    @property
    def child_frame_id(self) -> str:
        """Frame of the transducer."""
        return f"{self.robot}/{self._description.transducer}"

    def pose(self, base: Pose) -> Pose:
        """Pose of the transducer on a robot, whose own error the stated one adds to."""
        mounted = base.compose(self._mount)
        return Pose(mounted.position_m, mounted.orientation, base.covariance + self._covariance)

    def trace(self, samples: NDArray[Any], stamp_ns: int, pose: Pose) -> EchoTrace:
        """Trace of a ping.

        Parameters
        ----------
        samples : (n,) array
            As they were counted; of I/Q, complex or I and Q side by side.
        stamp_ns : int
            Start of emission.
        pose : Pose
            Of the transducer.

        Raises
        ------
        MalformedMessageError
            If it cannot be true.
        """
        stated = self._description.samples
        amplitudes = samples / (stated.full_scale or 1.0)
        if np.iscomplexobj(amplitudes):
            amplitudes = np.ascontiguousarray(amplitudes, dtype=np.complex64).view(np.float32)
        trace = EchoTrace(
            stamp_ns=stamp_ns,
            frame_id=self.frame_id,
            child_frame_id=self.child_frame_id,
            pose=pose,
            transducer=self._transducer,
            channel=self._channel,
            encoding=Encoding[stated.encoding.upper()],
            sample_rate_hz=self.sample_rate_hz,
            start_delay_s=stated.start_delay_s,
            noise_std=stated.noise_std,
            samples=amplitudes.astype(np.float32),
        )
        trace.validate()
        return trace
