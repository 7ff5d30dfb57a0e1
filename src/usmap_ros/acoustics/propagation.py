"""How sound travels from the transducer to a point and back.

One model serves simulator and reconstruction alike; each may be given a `Channel` of its own.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, replace

import numpy as np

from usmap_ros import bounds
from usmap_ros.numerics.arrays import FloatArray


class FloorModel(enum.Enum):
    """How a floor returns sound."""

    #: By way of the object's mirror image below the floor, as of a small object at some height.
    IMAGE = "image"
    #: By the corner between the floor and an object that stands on it, as of a pole or a wall.
    CORNER = "corner"


@dataclass(frozen=True)
class Channel:
    """What the sound travels through.

    Parameters
    ----------
    sound_speed_m_s : float
        Speed of sound.
    attenuation_db_m : float
        Absorption per metre of path, dB of amplitude.
    floor_height_m : float
        Of the transducer above a reflecting floor; 0: no floor echo.
    floor_reflectivity : float
        Amplitude reflectivity of the floor, 0 to 1.
    object_rise_m : float
        Height of the objects above the transducer, on which their way over the floor depends;
        upright ones answer from its height.
    floor_model : FloorModel
        How the floor returns sound; messages have no field for it.
    """

    sound_speed_m_s: float
    attenuation_db_m: float = 0.0
    floor_height_m: float = 0.0
    floor_reflectivity: float = 0.0
    object_rise_m: float = 0.0
    floor_model: FloorModel = FloorModel.IMAGE

    @property
    def has_corners(self) -> bool:
        """Whether objects return sound by their corners with the floor."""
        return self.has_floor and self.floor_model is FloorModel.CORNER

    @property
    def with_image(self) -> Channel:
        """The same with a floor in which objects are mirrored."""
        return replace(self, floor_model=FloorModel.IMAGE)

    @property
    def has_floor(self) -> bool:
        """Whether the floor returns any sound."""
        return self.floor_height_m > 0.0 and self.floor_reflectivity > 0.0

    def delays_s(self, range_m: FloatArray) -> FloatArray:
        """Delay of every path to points at `range_m`, shape (..., paths).

        Without a floor there is one path.  With one there are three delays: direct;
        direct there and over the floor back, or the reverse; over the floor both ways.  They are
        the four paths of figure 6 in Sanchez & Andersson (DSCC 2018-9140), two of one length.

        A floor with corners adds one delay only: sound that meets floor and object, in either
        order, comes back as from the object's foot, √(r² + h²) away.  What meets the floor twice
        would have to go through it.
        """
        if self.has_corners:
            direct_m, corner_m = self._corner_legs_m(range_m)
            return np.stack([2.0 * direct_m, 2.0 * corner_m], axis=-1) / self.sound_speed_m_s
        direct_m, via_floor_m = self._legs_m(range_m)
        lengths_m = [2.0 * direct_m]
        if self.has_floor:
            lengths_m += [direct_m + via_floor_m, 2.0 * via_floor_m]
        return np.stack(lengths_m, axis=-1) / self.sound_speed_m_s

    def amplitudes(self, range_m: FloatArray) -> FloatArray:
        """Amplitude of every path of `delays_s`: spreading, absorption and reflection.

        Either leg spreads as a spherical wave, I ∝ 1/r² (Sanchez & Andersson, section 3), so that
        amplitudes fall with the product of the legs.
        """
        if self.has_corners:
            direct_m, corner_m = self._corner_legs_m(range_m)
            # Floor first and object first have one length.
            by_corner = 2.0 * self.floor_reflectivity * self.leg_gain(corner_m) ** 2
            return np.stack([self.leg_gain(direct_m) ** 2, by_corner], axis=-1)
        direct_m, via_floor_m = self._legs_m(range_m)
        direct, via_floor = self.leg_gain(direct_m), self.leg_gain(via_floor_m)
        reflected = self.floor_reflectivity * via_floor
        amplitudes = [direct**2]
        if self.has_floor:
            # Transducer-floor-object-transducer and its reverse have one length: they add up.
            amplitudes += [2.0 * direct * reflected, reflected**2]
        return np.stack(amplitudes, axis=-1)

    def legs(self, range_m: FloatArray, rise_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Ways between a transducer and points: straight, and over the floor if there is one.

        Parameters
        ----------
        range_m : (...) array
            Distance of the points.
        rise_m : (...) array
            Their height above the transducer.

        Returns
        -------
        lengths_m, gains : (..., legs) arrays
            Length, and amplitude gain by spreading, absorption and reflection.
        """
        direct_m, via_floor_m = self._legs_m(range_m, rise_m)
        lengths_m, gains = [direct_m], [self.leg_gain(direct_m)]
        if self.has_floor:
            lengths_m.append(via_floor_m)
            gains.append(self.floor_reflectivity * self.leg_gain(via_floor_m))
        return np.stack(lengths_m, axis=-1), np.stack(gains, axis=-1)

    def leg_gain(self, leg_m: FloatArray) -> FloatArray:
        """Amplitude gain of one leg: spreading and absorption."""
        return 10.0 ** (-self.attenuation_db_m * leg_m / 20.0) / leg_m

    def _corner_legs_m(self, range_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distance of points, and that of the corners below them."""
        direct_m = np.asarray(range_m, dtype=float)
        return direct_m, np.sqrt(direct_m**2 + self.floor_detour_m2)

    def _legs_m(
        self, range_m: FloatArray, rise_m: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Length of the direct leg, and of the one over the floor, to the transducer's image.

        Horizontally a point is as far from the transducer as from its image below the floor, and
        vertically by h - H against h + H: the squares differ by 4 h H, H being its own height.
        """
        direct_m = np.asarray(range_m, dtype=float)
        detour_m2 = self.floor_detour_m2 if rise_m is None else self._floor_detour_m2(rise_m)
        return direct_m, np.sqrt(direct_m**2 + detour_m2)

    @property
    def floor_detour_m2(self) -> float:
        """What a leg over the floor has, squared, beyond the square of the straight one."""
        if self.has_corners:
            return self.floor_height_m**2
        return float(self._floor_detour_m2(self.object_rise_m))

    @property
    def floor_legs(self) -> int:
        """How many more legs over the floor each path has than the one before it."""
        return 2 if self.has_corners else 1

    def _floor_detour_m2(self, rise_m: FloatArray | float) -> FloatArray:
        object_height_m = np.maximum(self.floor_height_m + rise_m, 0.0)
        return 4.0 * self.floor_height_m * object_height_m

    def validate(self) -> None:
        """Raise `MalformedMessageError` unless sound can travel through it."""
        bounds.check("sound_speed", self.sound_speed_m_s, bounds.SOUND_SPEED)
        bounds.check("attenuation", self.attenuation_db_m, bounds.ATTENUATION)
        bounds.check("floor_height", self.floor_height_m, bounds.FLOOR_HEIGHT)
        bounds.check("floor_reflectivity", self.floor_reflectivity, bounds.FLOOR_REFLECTIVITY)
