"""What calibration found, with how well it is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usmap_ros.acoustics.propagation import Channel
from usmap_ros.correction import corrected_channel
from usmap_ros.parameters import CorrectionParameters


@dataclass(frozen=True)
class Estimate:
    """One quantity.

    Parameters
    ----------
    value, std : float
        Best value and its standard deviation; NaN where there is nothing to go by.
    untold : str
        Why the recording does not tell it well enough to be used; empty if it does.
    """

    value: float
    std: float
    untold: str = ""

    @property
    def is_told(self) -> bool:
        """Whether it is known well enough to be used."""
        return not self.untold


@dataclass(frozen=True)
class Target:
    """An object of which is known where it stands.

    Parameters
    ----------
    x_m, y_m : float
        Position of its centre in the world frame.
    reflectivity : float, optional
        As a point target; None: not known.
    radius_m : float
        Distance of its surface from there.
    """

    x_m: float
    y_m: float
    reflectivity: float | None = None
    radius_m: float = 0.0


@dataclass(frozen=True)
class Calibration:
    """What a recording says of its sensors and of the air.

    Parameters
    ----------
    sound_speed_m_s : Estimate
        True sound speed.
    range_offset_m : Estimate
        By how much ranges come out too long: latency, and what else delays an echo.
    floor_height_m, floor_reflectivity : Estimate
        Of the transducers above the floor, and its amplitude reflectivity.  A height of 0 means
        that there is none although messages state one.
    gain : Estimate
        Amplitude in the samples of an echo of which the truth is 1; std is that of its natural
        logarithm.
    pings, echoes, objects : int
        What it was found from.
    """

    sound_speed_m_s: Estimate
    range_offset_m: Estimate
    floor_height_m: Estimate
    floor_reflectivity: Estimate
    gain: Estimate
    pings: int
    echoes: int
    objects: int

    def estimates(self) -> dict[str, Estimate]:
        """All quantities, by the names of `CorrectionParameters`."""
        return {name: getattr(self, name) for name in CorrectionParameters.model_fields}

    def correction(self) -> CorrectionParameters:
        """Parameters that set right what the recording tells; the rest stays as stated."""
        told = {name: one.value for name, one in self.estimates().items() if one.is_told}
        return CorrectionParameters(**told)

    def channel(self, stated: Channel) -> Channel:
        """`stated`, set right as far as the recording tells."""
        return corrected_channel(stated, self.correction())


def decibels(factor: float) -> float:
    """An amplitude's factor in dB."""
    return float(20.0 * np.log10(factor))
