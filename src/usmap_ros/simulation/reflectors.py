"""Small reflectors that float: balls at a height of their own, and facets that face somewhere.

They hide nothing.  A ball is heard from every side, from the nearest point of its surface; a rigid
one of radius a, large against the wavelength, returns as much as a point target of reflectivity
a / 2 (Kinsler, Frey, Coppens & Sanders, Fundamentals of Acoustics, 4th ed., section 15.8).  A
facet is a mirror of its own size, and therefore has a lobe: what it returns falls off with the
angle ψ between its normal and the direction to the transducer, as exp(−½ (ψ / lobe)²).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usmap_ros.numerics.arrays import FloatArray

#: Lobe of what returns sound alike in all directions.
EVERYWHERE = np.inf


@dataclass(frozen=True)
class Reflectors:
    """Balls and facets."""

    #: (n, 3) array: x, y, z in the world frame; z NaN: at the height of whoever listens.
    centers_m: FloatArray
    #: (n,) array: of balls; 0 of facets.
    radii_m: FloatArray
    #: (n,) array: as point targets, of a facet from straight ahead.
    reflectivities: FloatArray
    #: (n, 3) array: unit vectors that facets face along; of balls they mean nothing.
    normals: FloatArray
    #: (n,) array: angles off the normal at which exp(−½) of the amplitude is left; `EVERYWHERE` of
    #: balls.
    lobes_rad: FloatArray

    @classmethod
    def none(cls) -> Reflectors:
        """No reflectors."""
        nothing = np.zeros(0)
        return cls(np.zeros((0, 3)), nothing, nothing, np.zeros((0, 3)), nothing)

    def __len__(self) -> int:
        return len(self.centers_m)

    def answers(self, position_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Where sound from a position is returned, and as by a point target of what strength.

        Parameters
        ----------
        position_m : (3,) array
            Of the transducer.

        Returns
        -------
        points_m : (n, 3) array
            The nearest point of each.
        reflectivities : (n,) array
            0 of facets that are turned away, and of balls about the transducer.
        """
        centers_m = self.centers_m.copy()
        floating = np.isnan(centers_m[:, 2])
        centers_m[floating, 2] = position_m[2]
        towards = position_m - centers_m
        distances = np.linalg.norm(towards, axis=-1)
        outside = distances > self.radii_m
        share = np.divide(self.radii_m, distances, out=np.zeros(len(self)), where=outside)
        points_m = centers_m + share[:, np.newaxis] * towards
        reflectivities = np.where(outside, self.reflectivities, 0.0)
        return points_m, reflectivities * self._lobe_gains(towards, distances)

    def _lobe_gains(self, towards: FloatArray, distances: FloatArray) -> FloatArray:
        ahead = np.sum(towards * self.normals, axis=-1) / np.maximum(distances, 1e-12)
        off_normal = np.arccos(np.clip(ahead, -1.0, 1.0))
        gains = np.exp(-0.5 * (off_normal / self.lobes_rad) ** 2)
        turned_away = (ahead <= 0.0) & np.isfinite(self.lobes_rad)
        return np.where(turned_away, 0.0, gains)
