"""The medium section of a scenario, and what its messages state instead."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from pydantic import model_validator

from usmap_ros.acoustics.medium import Air
from usmap_ros.acoustics.propagation import Channel, FloorModel
from usmap_ros.parameters import ParameterGroup, quantity

_USUAL_C = 20.0


class MediumModel(ParameterGroup):
    """The air and the floor."""

    temperature_c: float | None = quantity(
        None, "Of the air; None: 20 °C. Not beside sound_speed_m_s.", "°C", ge=-20.0, le=50.0
    )
    relative_humidity: float = quantity(0.5, "0 to 1.", ge=0.0, le=1.0)
    pressure_pa: float = quantity(101_325.0, "Of the air.", "Pa", ge=60_000.0, le=110_000.0)
    sound_speed_m_s: float | None = quantity(
        None, "None: from temperature, humidity and pressure.", "m/s", gt=0.0, le=10_000.0
    )
    attenuation_db_m: float | None = quantity(
        None, "None: ISO 9613-1 at the carrier.", "dB/m", ge=0.0, le=1000.0
    )
    floor_reflectivity: float = quantity(
        0.0, "Amplitude reflectivity of the floor; its height is that of the mount.", ge=0.0, le=1.0
    )

    floor_model: Literal["image", "corner"] = quantity(
        "image",
        "How the floor returns sound: by an object's mirror image below it, as in the paper, or by"
        " the corner between it and upright objects.",
    )
    temperature_drift_c_s: float = quantity(
        0.0,
        "How fast the air warms up; messages go on stating the sound speed of the start.",
        "°C/s",
        ge=-1.0,
        le=1.0,
    )

    @model_validator(mode="after")
    def _speed_is_given_once(self) -> MediumModel:
        if self.sound_speed_m_s is not None and self.temperature_c is not None:
            raise ValueError("sound_speed_m_s: follows from temperature_c, which is given as well")
        return self

    @property
    def _air(self) -> Air:
        temperature_c = _USUAL_C if self.temperature_c is None else self.temperature_c
        return Air(temperature_c, self.relative_humidity, self.pressure_pa)

    @property
    def drift_m_s2(self) -> float:
        """How fast the speed of sound changes: it goes with the root of the temperature."""
        air = self._air
        speed_m_s = self.sound_speed_m_s or air.sound_speed_m_s()
        return 0.5 * speed_m_s * self.temperature_drift_c_s / air.temperature_k

    def channel(self, carrier_hz: float, height_m: float) -> Channel:
        """What a transducer at `height_m` above the floor sounds through."""
        floor_height_m = height_m if self.floor_reflectivity > 0.0 else 0.0
        channel = self._air.channel(carrier_hz, floor_height_m, self.floor_reflectivity)
        stated = self.model_dump(include={"sound_speed_m_s", "attenuation_db_m"}, exclude_none=True)
        return replace(channel, floor_model=FloorModel(self.floor_model), **stated)


class StatedModel(ParameterGroup):
    """What the messages say, where it is not the truth."""

    sound_speed_m_s: float | None = quantity(None, "None: the truth.", "m/s", gt=0.0, le=10_000.0)
    attenuation_db_m: float | None = quantity(None, "None: the truth.", "dB/m", ge=0.0, le=1000.0)
    floor_height_m: float | None = quantity(None, "None: the truth.", "m", ge=0.0, le=1000.0)
    floor_reflectivity: float | None = quantity(None, "None: the truth.", ge=0.0, le=1.0)
    noise_std: float | None = quantity(
        None, "In units of the samples; 0: unknown; None: the truth.", ge=0.0, le=1e9
    )

    def channel(self, true: Channel) -> Channel:
        """The channel that the messages state."""
        stated = self.model_dump(exclude={"noise_std"}, exclude_none=True)
        return replace(true.with_image, **stated)
