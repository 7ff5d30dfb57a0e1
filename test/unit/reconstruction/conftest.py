"""Traces of points, as the simulator hears them."""

import numpy as np
import pytest

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.propagation import Channel
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.geometry import Pose
from usmap_ros.simulation.receiver import Receiver
from usmap_ros.simulation.scene import Discs, Scene
from usmap_ros.simulation.simulator import EchoSimulator, MountedTransducer
from usmap_ros.simulation.surfaces import Scatterers, Walls
from usmap_ros.trace import Encoding

HANN = Pulse(PulseShape.HANN_BURST, 50_000.0, 0.00032)
TONE = Pulse(PulseShape.TONE_BURST, 50_000.0, 0.00032)
SQUARE = Pulse(PulseShape.SQUARE, 0.0, 0.00032)
CHIRP = Pulse(PulseShape.CHIRP, 50_000.0, 0.002, 20_000.0)
#: An encoding with a pulse and a sample rate that suit it.
RECEPTIONS = {
    "iq": (Encoding.IQ, HANN, 25_000.0),
    "envelope": (Encoding.ENVELOPE, HANN, 25_000.0),
    "raw": (Encoding.RAW, HANN, 250_000.0),
    "square": (Encoding.RAW, SQUARE, 25_000.0),
    "tone_iq": (Encoding.IQ, TONE, 50_000.0),
    "chirp_iq": (Encoding.IQ, CHIRP, 30_000.0),
    "chirp_raw": (Encoding.RAW, CHIRP, 250_000.0),
    "chirp_envelope": (Encoding.ENVELOPE, CHIRP, 30_000.0),
}


@pytest.fixture(scope="session")
def hear():
    """Give a function that makes the trace of points at x, y with reflectivities."""

    def hear(
        points,
        reflectivities=None,
        *,
        reception="iq",
        channel=None,
        noise_std=0.0,
        stated_noise_std=None,
        pose=None,
        start_delay_s=0.0,
        max_range_m=5.0,
        seed=0,
    ):
        encoding, pulse, rate_hz = RECEPTIONS[reception]
        points = np.reshape(np.asarray(points, dtype=float), (-1, 2))
        strengths = np.ones(len(points)) if reflectivities is None else reflectivities
        receiver = Receiver(encoding, rate_hz, start_delay_s, noise_std)
        channel = channel or Channel(343.0)
        sonar = MountedTransducer(
            topic="echo",
            child_frame_id="sonar",
            mount=Pose.planar(0.0, 0.0, 0.0),
            transducer=Transducer(pulse, BeamPattern.linear(), 0.2, max_range_m),
            receiver=receiver,
            channel=channel,
            stated_channel=channel,
            stated_noise_std=(
                receiver.stated_noise_std if stated_noise_std is None else stated_noise_std
            ),
            pose_stds=np.zeros(3),
        )
        scene = Scene(
            Discs(points, np.zeros(len(points)), np.asarray(strengths, dtype=float)),
            Walls.joined([]),
            Scatterers.joined([]),
        )
        pose = pose or Pose.planar(0.0, 0.0, 0.0)
        return EchoSimulator(scene).ping(sonar, pose, 0, np.random.default_rng(seed))

    return hear
