"""Ring-down and muted receivers say nothing: not of echoes, of their absence, or of the noise."""

from dataclasses import replace

import numpy as np
import pytest

from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.pings.preparation.valid_part import valid_part
from usmap_ros.pings.trace import Encoding
from usmap_ros.reconstruction.reconstructor import reconstruct

PARAMETERS = ReconstructionParameters()
POINTS, STRENGTHS = [(1.0, 0.1), (1.6, -0.2)], [0.6, 0.8]
RECEPTIONS = ["iq", "envelope", "raw"]
FULL_SCALE = 1.5


def with_samples(trace, change):
    """Return the trace, its samples (or pairs) changed in place by a function of their times."""
    width = 2 if trace.encoding is Encoding.IQ else 1
    samples = trace.samples.copy().reshape(-1, width)
    change(samples, trace.sample_times_s())
    return replace(trace, samples=samples.reshape(-1))


def muted(trace, from_m, level=0.0):
    """As of a receiver that is muted from a range on, but for a little noise."""

    def mute(samples, times_s):
        dead = times_s > 2.0 * from_m / 343.0
        noise = level * np.random.default_rng(5).normal(size=samples[dead].shape)
        samples[dead] = np.abs(noise) if trace.encoding is Encoding.ENVELOPE else noise

    return with_samples(trace, mute)


def ringing(trace, until_m=0.17):
    """As of a transmitter that rings, clipped, until the echo of a range would come, and fades."""

    def ring(samples, times_s):
        end_s = 2.0 * until_m / 343.0
        loudness = 4.0 * FULL_SCALE * np.exp(-np.maximum(times_s - end_s, 0.0) / 2e-5)
        loudness[times_s > end_s + 5e-4] = 0.0
        carrier = np.sin(2.0 * np.pi * 50e3 * times_s) if trace.encoding is Encoding.RAW else 1.0
        samples += (loudness * carrier)[:, np.newaxis]
        np.clip(samples, -FULL_SCALE, FULL_SCALE, out=samples)

    return with_samples(trace, ring)


@pytest.fixture
def trace(hear):
    """Give a function that makes the trace of two points."""

    def make(reception, stated_noise_std=None):
        return hear(
            POINTS,
            STRENGTHS,
            reception=reception,
            noise_std=0.01,
            stated_noise_std=stated_noise_std,
        )

    return make


@pytest.mark.parametrize("reception", RECEPTIONS)
def test_a_trace_is_listened_to_from_the_least_range_on(trace, reception):
    whole = trace(reception)
    part = valid_part(whole)

    assert part.start_delay_s == pytest.approx(2.0 * 0.2 / 343.0, abs=1.0 / whole.sample_rate_hz)
    assert part.sampling.end_s == pytest.approx(whole.sampling.end_s)


@pytest.mark.parametrize("level", [0.0, 0.0005])
@pytest.mark.parametrize("reception", RECEPTIONS)
def test_a_muted_end_does_not_set_the_noise(trace, reception, level):
    unknown = trace(reception, stated_noise_std=0.0)
    alive = reconstruct(unknown, PARAMETERS)
    found = reconstruct(muted(unknown, 2.2, level), PARAMETERS)

    assert found.noise_std == pytest.approx(alive.noise_std, rel=0.3)
    assert len(found.cone.ranges_m) == len(alive.cone.ranges_m) == 2


@pytest.mark.parametrize("stated_noise_std", [None, 0.0])
@pytest.mark.parametrize("reception", RECEPTIONS)
def test_nothing_is_said_of_where_a_receiver_is_muted(trace, reception, stated_noise_std):
    heard = trace(reception, stated_noise_std)
    cone = reconstruct(muted(heard, 2.2), PARAMETERS).cone
    ranges_m = 0.2 + cone.limit_step_m * (0.5 + np.arange(len(cone.detection_limits)))

    assert np.all(cone.detection_limits[ranges_m > 2.4] == 255)
    assert np.all(cone.detection_limits[ranges_m < 2.0] < 255)


@pytest.mark.parametrize("min_range_m", [0.25, 0.05])
@pytest.mark.parametrize("reception", RECEPTIONS)
def test_ring_down_changes_nothing(trace, reception, min_range_m):
    clean = trace(reception, stated_noise_std=0.0)
    transducer = replace(clean.transducer, min_range_m=min_range_m)
    clean = replace(clean, transducer=transducer)
    rung = ringing(clean)
    before, after = reconstruct(clean, PARAMETERS), reconstruct(rung, PARAMETERS)

    np.testing.assert_allclose(after.cone.ranges_m, before.cone.ranges_m, atol=1e-3)
    assert after.noise_std == pytest.approx(before.noise_std, rel=0.1)
    assert after.cone.residual == pytest.approx(before.cone.residual, rel=0.15)
    assert rung.is_saturated
    assert not valid_part(rung).is_saturated


@pytest.mark.parametrize("reception", RECEPTIONS)
def test_silence_is_not_taken_for_a_muted_receiver(hear, reception):
    for seed in range(20):
        silent = hear([], reception=reception, noise_std=0.01, seed=seed)
        assert valid_part(silent).sampling.end_s == pytest.approx(silent.sampling.end_s)
        near = hear([(0.5, 0.0)], reception=reception, noise_std=0.01, seed=seed)
        assert valid_part(near).sampling.end_s == pytest.approx(near.sampling.end_s)


def test_a_coarse_converter_is_not_taken_for_a_muted_receiver(trace):
    fine = trace("iq")
    coarse = replace(fine, samples=(np.rint(fine.samples / 0.1) * 0.1).astype(np.float32))
    assert valid_part(coarse).sampling.end_s == pytest.approx(fine.sampling.end_s)


@pytest.mark.parametrize("starts_s", [0.0, 4e-4])
@pytest.mark.parametrize("reception", RECEPTIONS)
def test_a_transmitter_that_rises_slowly_and_rings_unclipped_is_left_out(
    trace, reception, starts_s
):
    def ring(samples, times_s):
        # Loudest behind the burst, as resonances make it, and heard far beyond the least range.
        loudness = 20.0 * times_s / 5e-4 * np.exp(1.0 - times_s / 5e-4) * (times_s < 3e-3)
        loudness[times_s < 3.5e-4] = 0.0
        carrier = np.sin(2.0 * np.pi * 50e3 * times_s) if trace_.encoding is Encoding.RAW else 1.0
        samples += (loudness * carrier)[:, np.newaxis]

    trace_ = trace(reception)
    late = round((starts_s - trace_.start_delay_s) * trace_.sample_rate_hz)
    heard = with_samples(trace_, ring).cut(max(0, late), trace_.sampling.sample_count)
    cone = reconstruct(heard, PARAMETERS).cone

    assert valid_part(heard).start_delay_s > 2.2e-3
    loudest_m = cone.ranges_m[np.argmax(cone.amplitudes)]
    assert min(abs(loudest_m - np.hypot(*point)) for point in POINTS) < 0.01
