"""Landmarks that have a place of their own: lines of walls, and points such as poles.

Whatever a wall is made of, what comes back first comes from the foot of the perpendicular, if the
beam holds it: with unit normal n at distance d from the origin, from range d - n·p to a robot at
p.  A point answers from where it is, whichever way a robot looks at it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from usmap_ros.localisation.echo_table import TrackEchoes
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.geometry import wrapped

#: Share of the half angle within which what answers must be.
WITHIN = 0.95


class Landmarks(NamedTuple):
    """Lines of walls, and points."""

    #: (n,) array: direction of each line's normal, from robots towards the wall.
    normals_rad: FloatArray
    #: (n,) array: from the origin along it.
    distances_m: FloatArray
    #: (k, 2) array: x, y of points.
    points_m: FloatArray = np.zeros((0, 2))

    @property
    def total(self) -> int:
        """How many there are of both."""
        return len(self.normals_rad) + len(self.points_m)

    def normals(self) -> FloatArray:
        """Unit normals, (2, n)."""
        return np.stack([np.cos(self.normals_rad), np.sin(self.normals_rad)])

    def of(self, wanted: BoolArray) -> Landmarks:
        """Some of them: lines come first."""
        lines, points = np.split(wanted, [len(self.normals_rad)])
        return Landmarks(self.normals_rad[lines], self.distances_m[lines], self.points_m[points])


class LandmarkViews(NamedTuple):
    """How pings would hear landmarks, (pings, landmarks) each."""

    #: Whether the ping may hear the landmark at all.
    faced: BoolArray
    #: Distance to the point, or along the perpendicular.
    far_m: FloatArray
    #: Unit vector that way.
    toward_x: FloatArray
    toward_y: FloatArray
    #: From the perpendicular to where a wall is heard from, positive to the left.
    aslant_rad: FloatArray
    #: Where that is along the wall.
    along_m: FloatArray


def view_landmarks(landmarks: Landmarks, echoes: TrackEchoes, poses: FloatArray) -> LandmarkViews:
    """Where pings would hear landmarks: walls at a perpendicular's foot, or at the beam's edge."""
    half_rad, most_rad = np.zeros((2, len(poses), 1))
    half_rad[echoes.ping, 0], most_rad[echoes.ping, 0] = echoes.half_angle_rad, echoes.aslant_rad
    off_rad = wrapped(landmarks.normals_rad - poses[:, 2, np.newaxis])
    beyond_rad = np.maximum(np.abs(off_rad) - WITHIN * half_rad, 0.0)
    normals = landmarks.normals()
    far_m = np.maximum(landmarks.distances_m - poses[:, :2] @ normals, 0.0)
    faced = (beyond_rad <= most_rad) & (half_rad > 0.0)
    aslant_rad = -np.sign(off_rad) * beyond_rad * faced
    along_m = poses[:, :2] @ np.stack([-normals[1], normals[0]]) + far_m * np.tan(aslant_rad)
    toward = landmarks.points_m.T[:, np.newaxis] - poses[:, :2].T[:, :, np.newaxis]
    apart_m = np.hypot(*toward)
    toward /= np.maximum(apart_m, 1e-9)
    aside_rad = wrapped(np.arctan2(toward[1], toward[0]) - poses[:, 2, np.newaxis])
    nothing = np.zeros_like(apart_m)
    return LandmarkViews(
        np.hstack([faced, np.abs(aside_rad) < WITHIN * half_rad]),
        np.hstack([far_m, apart_m]),
        np.hstack([np.broadcast_to(normals[0], faced.shape), toward[0]]),
        np.hstack([np.broadcast_to(normals[1], faced.shape), toward[1]]),
        np.hstack([aslant_rad, nothing]),
        np.hstack([along_m, np.arctan2(toward[1], toward[0])]),
    )
