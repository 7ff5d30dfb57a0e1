"""Beam patterns: how much of an echo comes back from off the axis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usmap_ros.errors import MalformedMessageError

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class BeamPattern:
    """Two-way amplitude gain as a piecewise linear function of the angle off axis.

    Parameters
    ----------
    angles_rad : (n,) array
        Ascending from 0; the last one is the half-angle of the cone.
    gains : (n,) array
        Amplitude gain at those angles, 1 on axis.
    """

    angles_rad: FloatArray
    gains: FloatArray

    @property
    def half_angle_rad(self) -> float:
        """Angle off axis beyond which nothing is heard."""
        return float(self.angles_rad[-1])

    def gain(self, bearing_rad: FloatArray) -> FloatArray:
        """Amplitude gain G(θ) at bearings of either sign; 0 outside the cone."""
        off_axis = np.abs(bearing_rad)
        return np.interp(off_axis, self.angles_rad, self.gains, right=0.0)

    def validate(self) -> None:
        """Raise `MalformedMessageError` unless angles and gains form a pattern."""
        if len(self.angles_rad) < 2 or len(self.angles_rad) != len(self.gains):
            raise MalformedMessageError(
                "transducer.beam_angles",
                f"has {len(self.angles_rad)} entries and beam_gains {len(self.gains)},"
                " need two or more of each and as many of both",
            )
        if not (np.all(np.isfinite(self.angles_rad)) and np.all(np.isfinite(self.gains))):
            raise MalformedMessageError("transducer.beam_angles", "or beam_gains is not finite")
        if self.angles_rad[0] != 0.0 or np.any(np.diff(self.angles_rad) <= 0.0):
            raise MalformedMessageError("transducer.beam_angles", "does not ascend from 0")
        if self.angles_rad[-1] > np.pi:
            raise MalformedMessageError("transducer.beam_angles", "goes beyond π")
        if np.any(self.gains < 0.0) or not np.any(self.gains > 0.0):
            raise MalformedMessageError("transducer.beam_gains", "must be 0 or more, and not all 0")
