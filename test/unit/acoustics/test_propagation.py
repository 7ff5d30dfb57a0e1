"""The channel, against the formula of received signals written out path by path."""

import itertools

import numpy as np
import pytest

from usmap_ros.acoustics.propagation import Channel
from usmap_ros.errors import MalformedMessageError


def four_paths(channel, range_m):
    """Delay and amplitude of the paths (a, b) in {0, 1}², one by one."""
    legs = [range_m, np.sqrt(range_m**2 + (2.0 * channel.floor_height_m) ** 2)]
    paths = []
    for there, back in itertools.product((0, 1), repeat=2):
        length = legs[there] + legs[back]
        absorbed = 10.0 ** (-channel.attenuation_db_m * length / 20.0)
        reflected = channel.floor_reflectivity ** (there + back)
        amplitude = reflected * absorbed / (legs[there] * legs[back])
        paths.append((length / channel.sound_speed_m_s, amplitude))
    return paths


@pytest.mark.parametrize("range_m", [0.2, 1.0, 3.7])
def test_floor_makes_four_paths_of_three_lengths(range_m):
    channel = Channel(340.0, 1.3, 0.6, 0.7)
    delays, amplitudes = channel.delays_s(range_m), channel.amplitudes(range_m)
    assert delays.shape == amplitudes.shape == (3,)
    (direct, there, back, both) = four_paths(channel, range_m)
    np.testing.assert_allclose(delays, [direct[0], there[0], both[0]])
    assert there == pytest.approx(back)
    np.testing.assert_allclose(amplitudes, [direct[1], there[1] + back[1], both[1]])


@pytest.mark.parametrize("channel", [Channel(343.0), Channel(343.0, 0.0, 0.5, 0.0)])
def test_without_reflecting_floor_the_direct_path_is_left(channel):
    assert not channel.has_floor
    np.testing.assert_allclose(channel.delays_s(np.array([3.43])), [[0.02]])
    np.testing.assert_allclose(channel.amplitudes(np.array([2.0])), [[0.25]])


def test_unit_target_at_a_metre_comes_back_with_amplitude_one():
    np.testing.assert_allclose(Channel(343.0).amplitudes(np.array(1.0)), [1.0])


def test_absorption_counts_both_ways():
    lossless, lossy = Channel(343.0), Channel(343.0, 1.0)
    ratio = lossy.amplitudes(np.array(5.0)) / lossless.amplitudes(np.array(5.0))
    np.testing.assert_allclose(20.0 * np.log10(ratio), -10.0)


def test_shapes_follow_the_ranges():
    ranges = np.full((4, 5), 2.0)
    assert Channel(343.0).delays_s(ranges).shape == (4, 5, 1)
    assert Channel(343.0, 0.0, 0.5, 0.5).amplitudes(ranges).shape == (4, 5, 3)


@pytest.mark.parametrize(
    ("channel", "field"),
    [
        (Channel(0.0), "sound_speed"),
        (Channel(float("nan")), "sound_speed"),
        (Channel(343.0, -1.0), "attenuation"),
        (Channel(343.0, 0.0, -0.1), "floor_height"),
        (Channel(343.0, 0.0, 0.5, 1.5), "floor_reflectivity"),
        (Channel(343.0, 0.0, 0.5, float("nan")), "floor_reflectivity"),
    ],
)
def test_impossible_channel_is_refused(channel, field):
    with pytest.raises(MalformedMessageError, match=field):
        channel.validate()
