"""What a trace accepts, and how its samples are read."""

from dataclasses import replace

import numpy as np
import pytest
from made_pings import TRACE

from usmap_ros.acoustics.propagation import Channel
from usmap_ros.errors import MalformedMessageError
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.trace import Encoding


def test_iq_comes_in_pairs():
    TRACE.validate()
    np.testing.assert_array_equal(TRACE.signal(), [1 + 2j, 3 + 4j])
    np.testing.assert_allclose(TRACE.sample_times_s(), [0.001, 0.00104])


@pytest.mark.parametrize("encoding", [Encoding.RAW, Encoding.ENVELOPE])
def test_other_samples_are_real(encoding):
    trace = replace(TRACE, encoding=encoding)
    np.testing.assert_array_equal(trace.signal(), [1, 2, 3, 4])
    assert len(trace.sample_times_s()) == 4


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"frame_id": ""}, "frame_id"),
        ({"sample_rate_hz": 0.0}, "sample_rate"),
        ({"sample_rate_hz": float("nan")}, "sample_rate"),
        ({"sample_rate_hz": 100.0}, "sample_rate"),
        ({"sample_rate_hz": 1e12}, "sample_rate"),
        ({"sample_rate_hz": 2e7, "encoding": Encoding.RAW}, "6.4e.03 samples on a pulse"),
        ({"start_delay_s": -1.0}, "start_delay"),
        ({"noise_std": float("inf")}, "noise_std"),
        ({"samples": np.zeros(0, dtype=np.float32)}, "samples"),
        ({"samples": np.zeros(3, dtype=np.float32)}, "samples"),
        ({"samples": np.array([1, np.nan], dtype=np.float32)}, "samples"),
        ({"channel": Channel(0.0)}, "sound_speed"),
        ({"pose": Pose.planar(float("nan"), 0.0, 0.0)}, r"pose\.position"),
    ],
)
def test_what_no_sensor_could_have_produced_is_named(change, field):
    with pytest.raises(MalformedMessageError, match=field):
        replace(TRACE, **change).validate()


def test_clipped_samples_are_known_by_their_like():
    samples = (1.5 * np.sin(np.linspace(0.0, 10.0, 100))).astype(np.float32)
    clipped = np.clip(samples, -1.0, 1.0)
    assert not replace(TRACE, samples=samples).is_saturated
    assert replace(TRACE, samples=clipped).is_saturated


def test_of_the_noise_of_a_pair_either_sample_has_half():
    """A converter whose full scale was six times the noise of pairs did not seem to clip."""
    samples = np.array([0.0, 0.06, 0.06, 0.01, 0.03, 0.06, -0.02, 0.0], dtype=np.float32)
    trace = replace(TRACE, encoding=Encoding.IQ, noise_std=0.01, samples=samples)
    np.testing.assert_allclose(trace.saturated_s(), trace.sample_times_s()[:3])
    assert not replace(trace, encoding=Encoding.RAW).is_saturated


@pytest.mark.parametrize("level", [0.0, 0.01])
def test_silence_is_not_saturation(level):
    """Not even behind a converter that gives noise few values to take."""
    samples = np.tile(np.array([-level, level], dtype=np.float32), 50)
    assert not replace(TRACE, samples=samples).is_saturated
