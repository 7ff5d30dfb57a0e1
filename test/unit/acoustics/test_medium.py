"""The air, against published tables."""

import pytest

from usmap_ros.acoustics.medium import Air
from usmap_ros.errors import UsmapError

# dB/km at the octave bands from 63 Hz to 8 kHz: ISO 9613-2:1996, table 2, which rounds values of
# ISO 9613-1 at the exact midband frequencies 1000 * 10**(0.3 k).
ABSORPTION_DB_KM = [
    (10, 0.7, [0.1, 0.4, 1.0, 1.9, 3.7, 9.7, 32.8, 117]),
    (20, 0.7, [0.1, 0.3, 1.1, 2.8, 5.0, 9.0, 22.9, 76.6]),
    (30, 0.7, [0.1, 0.3, 1.0, 3.1, 7.4, 12.7, 23.1, 59.3]),
    (15, 0.2, [0.3, 0.6, 1.2, 2.7, 8.2, 28.2, 88.8, 202]),
    (15, 0.5, [0.1, 0.5, 1.2, 2.2, 4.2, 10.8, 36.2, 129]),
    (15, 0.8, [0.1, 0.3, 1.1, 2.4, 4.1, 8.3, 23.7, 82.8]),
]


@pytest.mark.parametrize(("temperature_c", "humidity", "expected"), ABSORPTION_DB_KM)
def test_absorption_is_that_of_the_standard(temperature_c, humidity, expected):
    air = Air(temperature_c, humidity)
    for band, value in enumerate(expected, start=-4):
        computed = 1000.0 * air.attenuation_db_m(1000.0 * 10.0 ** (0.3 * band))
        # Half a unit of the last printed digit, and a little: 9613-1 prints 4.15, 9613-2 4.1.
        assert computed == pytest.approx(value, abs=0.052 if value < 100.0 else 0.52)


@pytest.mark.parametrize(
    ("temperature_c", "expected_m_s"),
    # Dry air at 101.325 kPa, as physics handbooks print it.
    [(0.0, 331.5), (10.0, 337.5), (20.0, 343.4), (30.0, 349.2)],
)
def test_sound_speed_in_dry_air(temperature_c, expected_m_s):
    assert Air(temperature_c, 0.0).sound_speed_m_s() == pytest.approx(expected_m_s, abs=0.1)


@pytest.mark.parametrize("temperature_c", [-20.0, 0.0, 25.0, 50.0])
def test_sound_speed_follows_the_ideal_gas(temperature_c):
    ideal = 331.45 * ((temperature_c + 273.15) / 273.15) ** 0.5
    assert Air(temperature_c, 0.0).sound_speed_m_s() == pytest.approx(ideal, rel=1e-3)


def test_humid_air_is_faster():
    # Water vapour is lighter than air: about 0.36 % at saturation and 20 °C.
    dry, humid = Air(20.0, 0.0).sound_speed_m_s(), Air(20.0, 1.0).sound_speed_m_s()
    assert (humid - dry) / dry == pytest.approx(0.0036, abs=0.0003)


def test_channel_takes_on_the_air_and_the_floor():
    air = Air(25.0, 0.4)
    channel = air.channel(50_000.0, floor_height_m=0.5, floor_reflectivity=0.6)
    assert channel.sound_speed_m_s == air.sound_speed_m_s()
    assert channel.attenuation_db_m == air.attenuation_db_m(50_000.0)
    assert (channel.floor_height_m, channel.floor_reflectivity) == (0.5, 0.6)
    channel.validate()


def test_without_carrier_nothing_is_absorbed():
    assert Air().channel(0.0).attenuation_db_m == 0.0


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"temperature_c": 80.0}, "temperature"),
        ({"temperature_c": float("nan")}, "temperature"),
        ({"relative_humidity": 1.2}, "humidity"),
        ({"pressure_pa": 0.0}, "pressure"),
    ],
)
def test_impossible_air_is_refused(arguments, named):
    with pytest.raises(UsmapError, match=named):
        Air(**arguments)
