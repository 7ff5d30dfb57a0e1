"""The air: how fast sound is in it, and how much of it gets lost.

References
----------
.. [1] ISO 9613-1:1993, Acoustics - Attenuation of sound during propagation outdoors - Part 1:
   Calculation of the absorption of sound by the atmosphere.
.. [2] O. Cramer, "The variation of the specific heat ratio and the speed of sound in air with
   temperature, pressure, humidity, and CO2 concentration", J. Acoust. Soc. Am. 93 (1993)
   2510-2516.
"""

import math
from dataclasses import dataclass

from usmap_ros.acoustics.propagation import Channel
from usmap_ros.errors import UsmapError

ZERO_CELSIUS_K = 273.15
_REFERENCE_PRESSURE_PA = 101_325.0
_REFERENCE_TEMPERATURE_K = 293.15
_TRIPLE_POINT_K = 273.16
#: Mole fraction of carbon dioxide in today's air.
_CARBON_DIOXIDE_FRACTION = 420e-6
#: Within these both sources hold, or are off by less than 0.1 % where they were not measured.
MIN_TEMPERATURE_C, MAX_TEMPERATURE_C = -20.0, 50.0
MIN_PRESSURE_PA, MAX_PRESSURE_PA = 60_000.0, 110_000.0


@dataclass(frozen=True)
class Air:
    """Still air.

    Raises `UsmapError` if the air is outside of what the sources describe.
    """

    temperature_c: float = 20.0
    #: 0 to 1.
    relative_humidity: float = 0.5
    pressure_pa: float = _REFERENCE_PRESSURE_PA

    def __post_init__(self) -> None:
        if not MIN_TEMPERATURE_C <= self.temperature_c <= MAX_TEMPERATURE_C:
            raise UsmapError(
                f"temperature: is {self.temperature_c:g} °C,"
                f" must be {MIN_TEMPERATURE_C:g} to {MAX_TEMPERATURE_C:g}"
            )
        if not 0.0 <= self.relative_humidity <= 1.0:
            raise UsmapError(f"relative humidity: is {self.relative_humidity:g}, must be 0 to 1")
        if not MIN_PRESSURE_PA <= self.pressure_pa <= MAX_PRESSURE_PA:
            raise UsmapError(
                f"pressure: is {self.pressure_pa:g} Pa,"
                f" must be {MIN_PRESSURE_PA:g} to {MAX_PRESSURE_PA:g}"
            )

    @property
    def temperature_k(self) -> float:
        """Absolute temperature."""
        return self.temperature_c + ZERO_CELSIUS_K

    def sound_speed_m_s(self) -> float:
        """Speed of sound at low frequency, by the approximate polynomial of [2]_.

        Above the relaxation frequencies of oxygen and nitrogen it is higher by up to 0.1 m/s.
        """
        t, p, xc = self.temperature_c, self.pressure_pa, _CARBON_DIOXIDE_FRACTION
        xw = self._water_vapour_fraction()
        return (
            331.5024
            + 0.603055 * t
            - 0.000528 * t**2
            + (51.471935 + 0.1495874 * t - 0.000782 * t**2) * xw
            + (-1.82e-7 + 3.73e-8 * t - 2.93e-10 * t**2) * p
            + (-85.20931 - 0.228525 * t + 5.91e-5 * t**2) * xc
            - 2.835149 * xw**2
            - 2.15e-13 * p**2
            + 29.179762 * xc**2
            + 0.000486 * xw * p * xc
        )

    def attenuation_db_m(self, frequency_hz: float) -> float:
        """Absorption of a pure tone, dB per metre of path; [1]_, equations 3 to 5.

        Within 10 % at 50 kHz for a molar concentration of water vapour of 0.05 to 5 %, where the
        ratio of frequency to pressure is below 10 Hz/Pa.
        """
        pressure = self.pressure_pa / _REFERENCE_PRESSURE_PA
        temperature = self.temperature_k / _REFERENCE_TEMPERATURE_K
        oxygen_hz, nitrogen_hz = self._relaxation_frequencies_hz()
        classical = 1.84e-11 / pressure * math.sqrt(temperature)
        oxygen = 0.01275 * math.exp(-2239.1 / self.temperature_k)
        oxygen /= oxygen_hz + frequency_hz**2 / oxygen_hz
        nitrogen = 0.1068 * math.exp(-3352.0 / self.temperature_k)
        nitrogen /= nitrogen_hz + frequency_hz**2 / nitrogen_hz
        relaxation = (oxygen + nitrogen) / math.sqrt(temperature) ** 5
        return 8.686 * frequency_hz**2 * (classical + relaxation)

    def channel(
        self, frequency_hz: float, floor_height_m: float = 0.0, floor_reflectivity: float = 0.0
    ) -> Channel:
        """What a pulse of carrier `frequency_hz` (0: none) travels through."""
        return Channel(
            self.sound_speed_m_s(),
            self.attenuation_db_m(frequency_hz),
            floor_height_m,
            floor_reflectivity,
        )

    def _relaxation_frequencies_hz(self) -> tuple[float, float]:
        """Of oxygen and nitrogen; [1]_, equations 3 and 4, humidity after annex B."""
        pressure = self.pressure_pa / _REFERENCE_PRESSURE_PA
        temperature = self.temperature_k / _REFERENCE_TEMPERATURE_K
        exponent = -6.8346 * (_TRIPLE_POINT_K / self.temperature_k) ** 1.261 + 4.6151
        # Molar concentration of water vapour, per cent.
        h = 100.0 * self.relative_humidity * 10.0**exponent / pressure
        oxygen = pressure * (24.0 + 4.04e4 * h * (0.02 + h) / (0.391 + h))
        slowing = math.exp(-4.170 * (temperature ** (-1.0 / 3.0) - 1.0))
        nitrogen = pressure / math.sqrt(temperature) * (9.0 + 280.0 * h * slowing)
        return oxygen, nitrogen

    def _water_vapour_fraction(self) -> float:
        """Mole fraction, from the saturation pressure and the enhancement factor of [2]_."""
        t, kelvin = self.temperature_c, self.temperature_k
        enhancement = 1.00062 + 3.14e-8 * self.pressure_pa + 5.6e-7 * t**2
        saturation_pa = math.exp(
            1.2811805e-5 * kelvin**2 - 1.9509874e-2 * kelvin + 34.04926034 - 6.3536311e3 / kelvin
        )
        return self.relative_humidity * enhancement * saturation_pa / self.pressure_pa
