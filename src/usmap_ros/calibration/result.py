"""What calibration found, with how well it is known."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from usmap_ros.acoustics.propagation import Channel, FloorModel
from usmap_ros.calibration.pulse import MeasuredPulse
from usmap_ros.calibration.ringing import Ringing
from usmap_ros.parameters import CorrectionParameters, RingingParameters
from usmap_ros.pings.preparation.prepare import corrected_channel

#: What is estimated, by the names of `CorrectionParameters`.
QUANTITIES = (
    "gain", "range_offset_m", "sound_speed_m_s", "floor_height_m", "floor_reflectivity"
)  # fmt: skip


@dataclass(frozen=True)
class Estimate:
    """One quantity."""

    #: Best value and its standard deviation; NaN where there is nothing to go by.
    value: float
    std: float
    #: Why the recording does not tell it well enough to be used; empty if it does.
    why_unknown: str = ""

    @property
    def is_known(self) -> bool:
        """Whether it is known well enough to be used."""
        return not self.why_unknown


@dataclass(frozen=True)
class Calibration:
    """What a recording says of its sensors and of the air."""

    #: True sound speed.
    sound_speed_m_s: Estimate
    #: By how much ranges come out too long: latency, and what else delays an echo.
    range_offset_m: Estimate
    #: Of the transducers above the floor, and its amplitude reflectivity.  A height of 0 means that
    #: there is none although messages state one.
    floor_height_m: Estimate
    floor_reflectivity: Estimate
    #: Amplitude in the samples of an echo of which the truth is 1; std is that of its natural
    #: logarithm.
    gain: Estimate
    #: What it was found from.
    pings: int
    echoes: int
    objects: int
    #: How the floor returns sound, if one is heard.
    floor_model: FloorModel = FloorModel.IMAGE
    #: The pulse as it is received; None: too few echoes were loud, or it was given.
    pulse: MeasuredPulse | None = None
    #: What the transducer hears of itself in every ping; None: nothing, or it cannot be told.
    ringing: Ringing | None = None
    #: Sound speed that traces state.
    stated_speed_m_s: float = 343.2
    #: What could not be done that was asked for.
    remarks: tuple[str, ...] = ()

    @property
    def tells_something(self) -> bool:
        """Whether there is anything that could be set right."""
        is_pulse_known = self.pulse is not None and self.pulse.is_known
        return (
            is_pulse_known
            or self.ringing is not None
            or any(estimate.is_known for estimate in self.estimates().values())
        )

    def estimates(self) -> dict[str, Estimate]:
        """All quantities, by the names of `CorrectionParameters`."""
        return {name: getattr(self, name) for name in QUANTITIES}

    def correction(self) -> CorrectionParameters:
        """Parameters that set right what the recording tells; the rest stays as stated."""
        known: dict[str, Any] = {
            name: one.value for name, one in self.estimates().items() if one.is_known
        }
        if self.floor_height_m.is_known:
            known["floor_model"] = self.floor_model.value
        return CorrectionParameters(**known)

    def reconstruction(self) -> dict[str, Any]:
        """Contents of the group ``reconstruction`` of a parameter file: all that was found."""
        known = self.correction().model_dump(exclude_unset=True)
        if known.get("floor_model") == FloorModel.IMAGE.value:
            del known["floor_model"]
        content: dict[str, Any] = {"correction": known}
        if self.pulse is not None and self.pulse.is_known:
            content["model_error"] = float(f"{self.pulse.model_error:.3g}")
            content["pulse"] = self.pulse.parameters.model_dump(exclude_unset=True)
        if self.ringing is not None:
            content["ringing"] = self._corrected_ringing(self.ringing).model_dump()
        return content

    def _corrected_ringing(self, ringing: Ringing) -> RingingParameters:
        """Where, and how loud, it is in traces that are set right."""
        known = self.correction()
        speed = known.sound_speed_m_s / self.stated_speed_m_s if known.sound_speed_m_s else 1.0
        return RingingParameters(
            ranges_m=[
                float(f"{one:.4g}") for one in speed * ringing.ranges_m - known.range_offset_m
            ],
            amplitudes=[float(f"{one:.4g}") for one in ringing.amplitudes / known.gain],
        )

    def channel(self, stated: Channel) -> Channel:
        """`stated`, set right as far as the recording tells."""
        return corrected_channel(stated, self.correction())


def decibels(factor: float) -> float:
    """An amplitude's factor in dB."""
    return float(20.0 * np.log10(factor))
