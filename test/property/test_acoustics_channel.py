"""What holds for every channel and every beam."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.medium import Air
from usmap_ros.acoustics.propagation import Channel

ranges = st.floats(0.05, 50.0)
channels = st.builds(
    Channel,
    st.floats(100.0, 2000.0),
    st.floats(0.0, 3.0),
    st.floats(0.05, 5.0),
    st.floats(0.01, 1.0),
)


@given(channels, ranges)
def test_detours_take_longer_and_are_weaker(channel, range_m):
    delays = channel.delays_s(np.array(range_m))
    assert np.all(np.diff(delays) > 0.0)
    direct, mixed, floor = channel.amplitudes(np.array(range_m))
    assert mixed <= 2.0 * direct
    assert floor <= direct
    # Two reflections by two paths, or one path of each kind: (x + y)² = x² + 2xy + y².
    np.testing.assert_allclose(np.sqrt(direct) + np.sqrt(floor), np.sqrt(direct + mixed + floor))


@given(channels, ranges, st.floats(1.01, 10.0))
def test_farther_is_later_and_weaker(channel, range_m, factor):
    near, far = np.array(range_m), np.array(range_m * factor)
    assert np.all(channel.delays_s(far) > channel.delays_s(near))
    assert np.all(channel.amplitudes(far) < channel.amplitudes(near))


@given(st.floats(0.001, 0.05), st.floats(0.003, 0.02), st.floats(-np.pi, np.pi))
def test_beams_are_symmetric_and_loudest_on_axis(radius_m, wavelength_m, bearing_rad):
    beam = BeamPattern.circular_piston(radius_m, wavelength_m)
    beam.validate()
    gain = beam.gain(np.array(bearing_rad))
    assert gain == beam.gain(np.array(-bearing_rad))
    assert 0.0 <= gain <= 1.0


@given(st.floats(-20.0, 50.0), st.floats(0.0, 1.0), st.floats(60e3, 110e3), st.floats(10.0, 200e3))
def test_all_air_carries_sound(temperature_c, humidity, pressure_pa, frequency_hz):
    air = Air(temperature_c, humidity, pressure_pa)
    assert 310.0 < air.sound_speed_m_s() < 375.0
    absorbed = air.attenuation_db_m(frequency_hz)
    # Higher tones are absorbed more, whatever the weather.
    assert 0.0 < absorbed < air.attenuation_db_m(1.1 * frequency_hz)
    air.channel(frequency_hz).validate()
