"""Legs between a transducer and points: straight, over the floor, and by way of walls.

Sound goes to a point by any leg and comes back by any leg, so that the echo of an ideal object is
the sum over all pairs of legs (Sanchez & Andersson, DSCC 2018-9140, section 4, for the floor).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.images import Mirrors, mirrored_legs
from usmap_ros.acoustics.propagation import Channel
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.geometry import Pose, at_height

#: What is nearer to a point of its surface is inside the object.
_NEAREST_M = 1e-3


@dataclass(frozen=True)
class Legs:
    """Ways between one transducer and points."""

    #: (points, legs) array: how long each is.
    lengths_m: FloatArray
    #: (points, legs) array: amplitude gain: the transducer's towards the leg, spreading, absorption
    #: and reflection; 0 where a point has no such leg.
    gains: FloatArray

    def paths(self, back: Legs) -> tuple[FloatArray, FloatArray]:
        """Lengths and gains of going there by any of these legs, and `back` by any of those.

        Returns
        -------
        lengths_m, gains : (points, paths) arrays
            Of every pair of legs.
        """
        lengths_m = self.lengths_m[:, :, np.newaxis] + back.lengths_m[:, np.newaxis]
        gains = self.gains[:, :, np.newaxis] * back.gains[:, np.newaxis]
        shape = (len(gains), self.gains.shape[1] * back.gains.shape[1])
        return lengths_m.reshape(shape), gains.reshape(shape)

    def but(self, hidden: BoolArray) -> Legs:
        """These legs, silent to points, shape (points,), that are hidden."""
        return Legs(self.lengths_m, np.where(hidden[:, np.newaxis], 0.0, self.gains))

    def beside(self, others: Legs) -> Legs:
        """These legs and others to the same points."""
        return Legs(
            np.concatenate([self.lengths_m, others.lengths_m], axis=1),
            np.concatenate([self.gains, others.gains], axis=1),
        )


def straight_legs(
    pose: Pose,
    beam: BeamPattern,
    channel: Channel,
    points_m: FloatArray,
    radius_m: float | FloatArray = 0.0,
) -> Legs:
    """Legs that go straight to points, and those over the floor where there is one.

    Parameters
    ----------
    pose : Pose
        Of the transducer.
    beam : BeamPattern
        Its gain both ways; one way it is the root of that.
    channel : Channel
        Gives spreading, absorption and the floor.
    points_m : (n, 3) array
        Where the objects are.
    radius_m : float or (n,) array
        Of the objects, which answer from the nearest point of their surface.
    """
    ranges_m, bearings_rad = pose.polar(points_m)
    ranges_m = np.maximum(ranges_m - radius_m, _NEAREST_M)
    lengths_m, gains = channel.legs(ranges_m, points_m[:, 2] - pose.position_m[2])
    return Legs(lengths_m, np.sqrt(beam.gain(bearings_rad))[:, np.newaxis] * gains)


def wall_legs(
    pose: Pose,
    beam: BeamPattern,
    channel: Channel,
    points_m: FloatArray,
    mirrors: Mirrors,
    radius_m: float | FloatArray = 0.0,
) -> Legs:
    """Legs by way of each wall, with one reflection; see `straight_legs`."""
    mirrored = mirrored_legs(pose.position_m[:2], points_m[:, :2], mirrors)
    shape = mirrored.exists.shape
    # In the order of `shape`, as the images are.
    heights_m = np.repeat(points_m[:, 2], shape[1])
    images_m = at_height(mirrored.images_m.reshape(-1, 2), heights_m)
    lengths_m, bearings_rad = (values.reshape(shape) for values in pose.polar(images_m))
    lengths_m = np.maximum(lengths_m - np.reshape(radius_m, (-1, 1)), _NEAREST_M)
    gains = np.sqrt(beam.gain(bearings_rad)) * channel.leg_gain(lengths_m)
    return Legs(lengths_m, np.where(mirrored.exists, mirrors.reflectivities * gains, 0.0))
