"""When a signal is sampled, and which samples a pulse falls on."""

import numpy as np
import pytest

from usmap_ros.acoustics.sampling import Sampling

SAMPLING = Sampling(1000.0, 0.01, 50)


def test_samples_are_taken_at_an_even_rate():
    np.testing.assert_allclose(SAMPLING.times_s[[0, 1, -1]], [0.01, 0.011, 0.059])
    assert SAMPLING.end_s == pytest.approx(0.06)
    assert len(SAMPLING.times_s) == 50


def test_a_pulse_touches_every_sample_that_falls_on_it_and_no_earlier_one():
    delays_s, duration_s = np.array([0.0203, 0.0457, 0.030]), 0.0032
    samples, ages_s = SAMPLING.touched(delays_s, duration_s)
    for delay_s, touched, age_s in zip(delays_s, samples, ages_s, strict=True):
        on_pulse = np.flatnonzero(
            (SAMPLING.times_s >= delay_s - 1e-9) & (SAMPLING.times_s <= delay_s + duration_s)
        )
        assert set(on_pulse) <= set(touched)
        np.testing.assert_allclose(age_s, SAMPLING.times_s[touched] - delay_s, atol=1e-12)
        assert np.all(age_s > -1e-9)


def test_pulses_before_and_behind_touch_no_sample_that_is_taken():
    samples, _ = SAMPLING.touched(np.array([0.001, 0.09]), 0.0032)
    assert not SAMPLING.takes(samples).any()


def test_one_pulse_may_begin_before_the_first_sample_or_end_behind_the_last():
    samples, _ = SAMPLING.touched(np.array([[0.0085], [0.0585]]), 0.0032)
    taken = SAMPLING.takes(samples)
    assert samples.shape == (2, 1, 5)
    assert set(samples[taken]) >= {0, 1, 49}
    assert 48 not in samples[taken]
