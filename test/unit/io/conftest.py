"""What the tests of bags and files share."""

import logging
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.propagation import Channel
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.io.bag_writer import new_bag
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.trace import EchoTrace, Encoding
from usmap_ros.pings.transducer_array import ArrayElement, TransducerArray

SECOND = 1_000_000_000
EPOCH = 1_700_000_000 * SECOND

TRANSDUCER = Transducer(
    Pulse(PulseShape.HANN_BURST, 50e3, 0.32e-3),
    BeamPattern(np.array([0.0, 0.35, 0.7]), np.array([1.0, 0.5, 0.0])),
    min_range_m=0.2,
    max_range_m=5.0,
)


@pytest.fixture
def make_trace() -> Callable[..., EchoTrace]:
    """Give a function that makes a valid trace, some fields of it as the caller wants."""

    def make(time_s: float = 0.0, **fields: Any) -> EchoTrace:
        samples = np.random.default_rng(1).standard_normal(400).astype(np.float32)
        trace = EchoTrace(
            stamp_ns=EPOCH + round(time_s * SECOND),
            frame_id="map",
            child_frame_id="robot1/sonar",
            pose=Pose.planar(1.0, 2.0, 0.5, planar_covariance=np.diag([1e-4, 1e-4, 1e-5])),
            transducer=TRANSDUCER,
            channel=Channel(343.0, 1.3, 0.5, 0.25),
            encoding=Encoding.IQ,
            sample_rate_hz=25e3,
            start_delay_s=1e-3,
            noise_std=0.01,
            samples=samples,
        )
        return replace(trace, **fields)

    return make


@pytest.fixture
def cone() -> EchoCone:
    """Give a valid cone."""
    return EchoCone(
        stamp_ns=EPOCH,
        frame_id="map",
        child_frame_id="robot1/sonar",
        pose=Pose.planar(1.0, 2.0, 0.5),
        transducer=TRANSDUCER,
        attenuation_db_m=1.3,
        ranges_m=np.array([1.0, 2.0], dtype=np.float32),
        range_stds_m=np.array([0.001, 0.002], dtype=np.float32),
        amplitudes=np.array([0.5, 0.1], dtype=np.float32),
        amplitude_stds=np.array([0.01, 0.01], dtype=np.float32),
        limit_step_m=0.03125,
        detection_limits=np.arange(192, dtype=np.uint8),
        residual=0.25,
    )


@pytest.fixture
def array() -> TransducerArray:
    """Give two transducers side by side that send different chirps at once."""
    rising = replace(TRANSDUCER, pulse=Pulse(PulseShape.CHIRP, 50e3, 2e-3, 20e3))
    falling = replace(TRANSDUCER, pulse=Pulse(PulseShape.CHIRP, 50e3, 2e-3, -20e3))
    return TransducerArray(
        stamp_ns=EPOCH,
        frame_id="robot1/base_link",
        elements=(
            ArrayElement("robot1/left", Pose.planar(0.1, 0.05, 0.3, 0.2), True, rising),
            ArrayElement("robot1/right", Pose.planar(0.1, -0.05, -0.3, 0.2), True, falling),
        ),
    )


@pytest.fixture
def write_bag(tmp_path: Path) -> Callable[..., Path]:
    """Give a function that records (topic, trace) pairs in a bag of a given name."""

    def write(name: str, messages: list[tuple[str, EchoTrace]], compression: str = "none") -> Path:
        with new_bag(tmp_path / name, compression=compression) as writer:
            for topic, trace in messages:
                writer.write_trace(topic, trace)
        return tmp_path / name

    return write


@pytest.fixture
def warnings_of(caplog: pytest.LogCaptureFixture) -> Callable[[], list[str]]:
    """Give a function that returns the warnings logged so far."""
    caplog.set_level(logging.WARNING, logger="usmap_ros")
    return lambda: [record.getMessage() for record in caplog.records]
