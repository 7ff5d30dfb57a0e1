"""What the tests of bags and files share."""

import logging
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_pings import CONE, TRACE, TRANSDUCER

from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.io.bag_writer import new_bag
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.pings.transducer_array import ArrayElement, TransducerArray

SECOND = 1_000_000_000
EPOCH = 1_700_000_000 * SECOND


@pytest.fixture
def make_trace() -> Callable[..., EchoTrace]:
    """Give a function that makes a valid trace, some fields of it as the caller wants."""

    def make(time_s: float = 0.0, **fields: Any) -> EchoTrace:
        samples = np.random.default_rng(1).standard_normal(400).astype(np.float32)
        stamp_ns = EPOCH + round(time_s * SECOND)
        return replace(TRACE, **({"stamp_ns": stamp_ns, "samples": samples} | fields))

    return make


@pytest.fixture
def cone() -> EchoCone:
    """Give a valid cone."""
    return replace(CONE, stamp_ns=EPOCH)


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
