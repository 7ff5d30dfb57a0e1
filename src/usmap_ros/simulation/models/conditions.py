"""The medium section of a scenario, and what its messages state instead."""

from __future__ import annotations

from dataclasses import replace

from usmap_ros.acoustics.medium import Air
from usmap_ros.acoustics.propagation import Channel
from usmap_ros.parameters import ParameterGroup, quantity


class MediumModel(ParameterGroup):
    """The air and the floor."""

    temperature_c: float = quantity(20.0, "Of the air.", "°C", ge=-20.0, le=50.0)
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

    def channel(self, carrier_hz: float, height_m: float) -> Channel:
        """What a transducer at `height_m` above the floor sounds through."""
        air = Air(self.temperature_c, self.relative_humidity, self.pressure_pa)
        floor_height_m = height_m if self.floor_reflectivity > 0.0 else 0.0
        channel = air.channel(carrier_hz, floor_height_m, self.floor_reflectivity)
        stated = self.model_dump(include={"sound_speed_m_s", "attenuation_db_m"}, exclude_none=True)
        return replace(channel, **stated)


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
        return replace(true, **stated)
