"""Beam patterns: how much of an echo comes back from off the axis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usmap_ros import bounds
from usmap_ros.errors import MalformedMessageError
from usmap_ros.numerics.arrays import FloatArray

#: Half of the 80° cone of Sanchez & Andersson (DSCC 2018-9140).
PAPER_HALF_ANGLE_RAD = float(np.deg2rad(40.0))

_SENSCOMP_600_ANGLES_DEG = (0.0, 2.5, 5.0, 7.5, 10.0, 12.5, 15.0, 17.5, 20.0, 22.5, 25.0)
_SENSCOMP_600_ONE_WAY_DB = (0.0, -0.6, -2.6, -6.2, -12.5, -25.0, -21.0, -18.0, -19.5, -26.0, -40.0)


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

    @classmethod
    def linear(cls, half_angle_rad: float = PAPER_HALF_ANGLE_RAD) -> BeamPattern:
        """Gain that falls linearly from 1 on axis to 0 at the edge of the cone.

        The simple pattern of Sanchez & Andersson (DSCC 2018-9140), figure 2a; 40° is theirs.
        """
        return cls(np.array([0.0, half_angle_rad]), np.array([1.0, 0.0]))

    @classmethod
    def circular_piston(
        cls, radius_m: float, wavelength_m: float, cut_rad: float | None = None, count: int = 17
    ) -> BeamPattern:
        """Far field of a circular piston in a rigid baffle, there and back.

        One way the amplitude is 2 J₁(x) / x with x = k a sin θ (Kinsler, Frey, Coppens & Sanders,
        Fundamentals of Acoustics, 4th ed., section 7.4); two ways it is the square.

        Parameters
        ----------
        radius_m : float
            Radius a of the piston.
        wavelength_m : float
            Of the carrier; k = 2π / wavelength.
        cut_rad : float, optional
            Half-angle of the cone; None: the first null, or 90° where there is none.
        count : int
            Angles in the table.
        """
        # Here, because traces bring their beam as a table, and it takes long to load.
        from scipy.special import j1, jn_zeros

        size = 2.0 * np.pi * radius_m / wavelength_m
        if cut_rad is None:
            cut_rad = float(np.arcsin(min(1.0, jn_zeros(1, 1)[0] / size)))
        angles = np.linspace(0.0, cut_rad, count)
        x = size * np.sin(angles[1:])
        one_way = np.concatenate([[1.0], 2.0 * j1(x) / x])
        return cls(angles, one_way**2)

    @classmethod
    def senscomp_600(cls) -> BeamPattern:
        """A transducer like the SensComp 600 at 50 kHz.

        Its data sheet gives a typical beam of 15° between the -6 dB points, one way.  The table
        is the one-way pattern in decibels: the main lobe of a piston of the same aperture (38 mm
        across, which has those points) and its first side lobe, the nulls filled in as they
        are in measured patterns.  Replace it by a measurement of your own where you have one.
        """
        one_way_db = np.array(_SENSCOMP_600_ONE_WAY_DB)
        gains = 10.0 ** (2.0 * one_way_db / 20.0)
        gains[-1] = 0.0
        return cls(np.deg2rad(_SENSCOMP_600_ANGLES_DEG), gains)

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
        bounds.check_count("transducer.beam_angles", len(self.angles_rad), bounds.MAX_BEAM_ANGLES)
        if not (np.all(np.isfinite(self.angles_rad)) and np.all(np.isfinite(self.gains))):
            raise MalformedMessageError("transducer.beam_angles", "or beam_gains is not finite")
        if self.angles_rad[0] != 0.0 or np.any(np.diff(self.angles_rad) <= 0.0):
            raise MalformedMessageError("transducer.beam_angles", "does not ascend from 0")
        if self.angles_rad[-1] > np.pi:
            raise MalformedMessageError("transducer.beam_angles", "goes beyond π")
        if np.any(self.gains < 0.0) or not np.any(self.gains > 0.0):
            raise MalformedMessageError("transducer.beam_gains", "must be 0 or more, and not all 0")
        bounds.check_all("transducer.beam_gains", self.gains, bounds.BEAM_GAIN)
