"""What a transducer can hear of a scene: the point targets in its cone that nothing hides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usmap_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from usmap_ros.numerics.geometry import Pose, at_height
from usmap_ros.simulation.occlusion import (
    NO_OWNER,
    cross,
    hidden_by_discs,
    hidden_by_walls,
    point_segment_distances,
)
from usmap_ros.simulation.scene import Discs, Scene
from usmap_ros.simulation.surfaces import WallSegments

#: What is nearer is inside the transducer, where sound does not spread as from a point.
_NEAREST_M = 0.01


@dataclass(frozen=True)
class View:
    """Where a sounding starts, and which way, how wide and how far it goes."""

    #: Of the transducer; the beam axis is its x axis.
    pose: Pose
    half_angle_rad: float
    #: How far it can hear.
    reach_m: float

    @property
    def position_m(self) -> FloatArray:
        """Of the transducer in the plane, shape (2,)."""
        return self.pose.position_m[:2]


@dataclass(frozen=True)
class Targets:
    """Point targets in view."""

    #: (n, 3) array: x, y, z of each; upright things answer from the transducer's height.
    positions_m: FloatArray
    #: (n,) array: distance from the transducer.
    ranges_m: FloatArray
    #: (n,) array: off the beam axis, as `Pose.polar` has them.
    bearings_rad: FloatArray
    #: (n,) array: of each as a point target.
    reflectivities: FloatArray
    #: (n,) bool array: whether it stands on the floor and reaches up to the transducer.
    upright: BoolArray


@dataclass(frozen=True)
class _Candidates:
    """Points that would answer if nothing hid them, and the disc or wall each belongs to.

    Their positions are in the plane; their heights are NaN where they are that of the transducer.
    """

    positions_m: FloatArray
    reflectivities: FloatArray
    discs: IntArray
    walls: IntArray
    heights_m: FloatArray

    @classmethod
    def upright(
        cls, positions_m: FloatArray, reflectivities: FloatArray, discs: IntArray, walls: IntArray
    ) -> _Candidates:
        """Points of what reaches up to the transducer."""
        heights_m = np.full(len(positions_m), np.nan)
        return cls(positions_m, reflectivities, discs, walls, heights_m)

    def in_space(self, view: View) -> FloatArray:
        """x, y, z of each."""
        height_m = view.pose.position_m[2]
        return at_height(
            self.positions_m, np.where(np.isnan(self.heights_m), height_m, self.heights_m)
        )

    @classmethod
    def joined(cls, parts: list[_Candidates]) -> _Candidates:
        return cls(
            np.concatenate([part.positions_m for part in parts]),
            np.concatenate([part.reflectivities for part in parts]),
            np.concatenate([part.discs for part in parts]),
            np.concatenate([part.walls for part in parts]),
            np.concatenate([part.heights_m for part in parts]),
        )

    def where(self, kept: BoolArray) -> _Candidates:
        return _Candidates(
            self.positions_m[kept],
            self.reflectivities[kept],
            self.discs[kept],
            self.walls[kept],
            self.heights_m[kept],
        )


def targets_in_view(scene: Scene, view: View, time_s: float) -> Targets:
    """Everything of `scene` that answers a sounding.

    Parameters
    ----------
    scene : Scene
        Discs, walls and facets that return sound.
    view : View
        Where the sounding starts, and its cone.
    time_s : float
        After the scene's start; moving objects stand still while a ping lasts.
    """
    discs = scene.discs_at(time_s)
    near = _walls_near(scene.walls, view)
    candidates = _Candidates.joined(
        [
            _disc_fronts(discs, view),
            _mirror_points(scene.walls, near, view),
            _rough_points(scene, near, view),
            _floating_points(scene, view),
            *_edge_points(scene),
        ]
    )
    candidates = candidates.where(_in_cone(candidates, view))
    candidates = candidates.where(~_behind_walls(candidates, scene.walls, near, view))
    hidden = hidden_by_discs(
        view.position_m, candidates.positions_m, discs.centers_m, discs.radii_m, candidates.discs
    )
    candidates = candidates.where(~hidden)
    positions_m = candidates.in_space(view)
    ranges, bearings = view.pose.polar(positions_m)
    upright = np.isnan(candidates.heights_m)
    return Targets(positions_m, ranges, bearings, candidates.reflectivities, upright)


def _in_cone(candidates: _Candidates, view: View) -> BoolArray:
    ranges, bearings = view.pose.polar(candidates.in_space(view))
    inside: BoolArray = (ranges <= view.reach_m) & (ranges >= _NEAREST_M)
    inside &= np.abs(bearings) <= view.half_angle_rad
    return inside & (candidates.reflectivities > 0.0)


def _walls_near(walls: WallSegments, view: View) -> IntArray:
    """Walls that can answer or hide anything: within reach, in the cone, not turned away.

    A one-sided wall that is turned away belongs to a body whose front hides what it would.
    """
    distances = point_segment_distances(view.position_m, walls.starts_m, walls.ends_m)
    near = np.flatnonzero(distances <= view.reach_m)
    near = near[_faces(walls, near, view)]
    # Seen from above, a cone that points up or down is wider than it is.
    if view.half_angle_rad >= np.pi / 2.0 or view.pose.is_tilted:
        return near
    # Up to 90° the cone is where two half planes overlap: a wall is outside of it if both of its
    # ends are beyond the same edge.
    for sign in (1.0, -1.0):
        edge_rad = view.pose.yaw_rad + sign * view.half_angle_rad
        edge = np.array([np.cos(edge_rad), np.sin(edge_rad)])
        beyond_start = sign * cross(edge, walls.starts_m[near] - view.position_m) > 0.0
        beyond_end = sign * cross(edge, walls.ends_m[near] - view.position_m) > 0.0
        near = near[~(beyond_start & beyond_end)]
    return near


def _disc_fronts(discs: Discs, view: View) -> _Candidates:
    """The point of every disc that is nearest; a disc around the transducer has none."""
    offsets = view.position_m - discs.centers_m
    distances = np.hypot(offsets[:, 0], offsets[:, 1])
    outside = distances > discs.radii_m
    ratio = np.divide(discs.radii_m, distances, out=np.zeros_like(distances), where=outside)
    fronts = discs.centers_m + ratio[:, np.newaxis] * offsets
    reflectivities = np.where(outside, discs.reflectivities, 0.0)
    return _Candidates.upright(fronts, reflectivities, np.arange(len(discs)), _nobody(len(discs)))


def _mirror_points(walls: WallSegments, near: IntArray, view: View) -> _Candidates:
    """The foot of the perpendicular on every wall that has one.

    A plane answers like the transducer's mirror image at twice the distance r, with amplitude
    R / (2 r).  A point target of reflectivity s gives s / r², hence s = R r / 2.
    """
    starts, along = walls.starts_m[near], (walls.ends_m - walls.starts_m)[near]
    fraction = np.sum((view.position_m - starts) * along, axis=-1) / np.sum(along**2, axis=-1)
    feet = starts + fraction[:, np.newaxis] * along
    ranges = np.hypot(*(view.position_m - feet).T)
    answers = (fraction >= 0.0) & (fraction <= 1.0)
    reflectivities = np.where(answers, walls.specular_reflectivity[near] * ranges / 2.0, 0.0)
    return _Candidates.upright(feet, reflectivities, _nobody(len(near)), near)


def _rough_points(scene: Scene, near: IntArray, view: View) -> _Candidates:
    """Scatterers of the walls, weaker the more obliquely they are struck (Lambert's law).

    The intensity that Lambert's law sends back to where it came from goes with the squared
    cosine of the angle of incidence, the amplitude with the cosine.
    """
    scatterers, walls = scene.scatterers, scene.walls
    is_near = np.zeros(len(walls), dtype=bool)
    is_near[near] = True
    kept = np.flatnonzero(is_near[scatterers.walls])
    positions, owners = scatterers.positions_m[kept], scatterers.walls[kept]
    offsets = view.position_m - positions
    ranges = np.maximum(np.hypot(offsets[:, 0], offsets[:, 1]), _NEAREST_M)
    # Walls that are near do not turn away: the sign only tells the sides of a two-sided one.
    cosine = np.abs(np.sum(offsets * walls.normals[owners], axis=-1)) / ranges
    reflectivities = scatterers.reflectivities[kept] * cosine
    return _Candidates.upright(positions, reflectivities, _nobody(len(kept)), owners)


def _edge_points(scene: Scene) -> list[_Candidates]:
    """Ends of the walls that diffract."""
    edges = scene.edges
    if not len(edges.walls):
        return []
    nobody = _nobody(len(edges.walls))
    return [_Candidates.upright(edges.positions_m, edges.reflectivities, nobody, edges.walls)]


def _floating_points(scene: Scene, view: View) -> _Candidates:
    """Balls and facets, each where it is nearest."""
    points_m, reflectivities = scene.reflectors.answers(view.pose.position_m)
    nobody = _nobody(len(points_m))
    return _Candidates(points_m[:, :2], reflectivities, nobody, nobody, points_m[:, 2])


def _faces(walls: WallSegments, near: IntArray, view: View) -> BoolArray:
    """Whether the transducer is on a side of the wall that can be seen."""
    side = np.sum((view.position_m - walls.starts_m[near]) * walls.normals[near], axis=-1)
    facing: BoolArray = (side > 0.0) | ~walls.one_sided[near]
    return facing


def _behind_walls(
    candidates: _Candidates, walls: WallSegments, near: IntArray, view: View
) -> BoolArray:
    # Owners count all walls, the test counts those within reach; index -1 is the last entry.
    owner_within_reach = np.full(len(walls) + 1, NO_OWNER)
    owner_within_reach[near] = np.arange(len(near))
    return hidden_by_walls(
        view.position_m,
        candidates.positions_m,
        walls.starts_m[near],
        walls.ends_m[near],
        owner_within_reach[candidates.walls],
    )


def _nobody(count: int) -> IntArray:
    return np.full(count, NO_OWNER, dtype=np.int64)
