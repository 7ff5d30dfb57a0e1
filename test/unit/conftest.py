"""Traces of points, as the simulator hears them."""

from dataclasses import replace

import pytest

import usmap_ros
from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.propagation import Channel
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.pings.trace import Encoding
from usmap_ros.simulation.receiver import Receiver

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
        trace = usmap_ros.hear(
            points,
            1.0 if reflectivities is None else reflectivities,
            pose=pose,
            transducer=Transducer(pulse, BeamPattern.linear(), 0.2, max_range_m),
            receiver=Receiver(encoding, rate_hz, start_delay_s, noise_std),
            channel=channel or Channel(343.0),
            seed=seed,
        )
        return trace if stated_noise_std is None else replace(trace, noise_std=stated_noise_std)

    return hear
