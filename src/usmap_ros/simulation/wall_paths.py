"""Sound that reaches an object by way of a wall: image sources of first order.

What stands in the open is heard straight; beside a wall it is heard by way of the wall as well:
there by the wall and straight back, the reverse, and by a wall both ways.
"""

from dataclasses import dataclass

import numpy as np

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.images import Mirrors, mirrored_legs
from usmap_ros.acoustics.legs import Legs, straight_legs, wall_legs
from usmap_ros.acoustics.propagation import Channel
from usmap_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from usmap_ros.numerics.geometry import Pose, at_height
from usmap_ros.simulation.occlusion import NO_OWNER, hidden_by_discs, hidden_by_walls
from usmap_ros.simulation.scene import Discs, Scene


@dataclass(frozen=True)
class PathEnd:
    """One end of a path: a transducer that sends or listens."""

    pose: Pose
    beam: BeamPattern


def paths_by_walls(
    scene: Scene, sender: PathEnd, listener: PathEnd, channel: Channel, time_s: float
) -> tuple[FloatArray, FloatArray]:
    """Lengths and amplitudes of all paths over an object that touch a wall, shape (paths,).

    Walls' own roughness is not heard by way of other walls, and facets answer as if from
    straight ahead of where the listener is.

    Parameters
    ----------
    scene : Scene
        Its discs, balls and facets are the objects, its walls the mirrors.
    sender, listener : PathEnd
        Pose and beam of who sends and of who listens.
    channel : Channel
        Between them and the objects.
    time_s : float
        After the scene's start.
    """
    discs = scene.discs_at(time_s)
    height_m = listener.pose.position_m[2]
    _, floating = scene.reflectors.answers(listener.pose.position_m)
    centers_m = scene.reflectors.centers_m.copy()
    centers_m[np.isnan(centers_m[:, 2]), 2] = height_m
    points_m = np.concatenate([at_height(discs.centers_m, height_m), centers_m])
    radii_m = np.concatenate([discs.radii_m, scene.reflectors.radii_m])
    owners = np.full(len(points_m), NO_OWNER)
    owners[: len(discs)] = np.arange(len(discs))
    objects = _Objects(points_m, radii_m, owners)
    there = _legs(scene, discs, sender, channel, objects)
    back = there if sender is listener else _legs(scene, discs, listener, channel, objects)
    lengths_m, gains = there.paths(back)
    straight = 2 if channel.has_floor else 1
    by_wall = np.arange(there.gains.shape[1]) >= straight
    touches = (by_wall[:, np.newaxis] | by_wall).ravel()
    reflectivities = np.concatenate([discs.reflectivities, floating])
    amplitudes = (reflectivities[:, np.newaxis] * gains)[:, touches].ravel()
    heard = amplitudes > 0.0
    return lengths_m[:, touches].ravel()[heard], amplitudes[heard]


@dataclass(frozen=True)
class _Objects:
    """Centres (n, 3) and radii (n,) of objects, and which disc each is."""

    points_m: FloatArray
    radii_m: FloatArray
    owners: IntArray


def _legs(scene: Scene, discs: Discs, end: PathEnd, channel: Channel, objects: _Objects) -> Legs:
    """Straight legs to the objects and those by way of walls, silent where something is between."""
    walls = scene.walls
    mirrors = Mirrors(walls.starts_m, walls.ends_m, walls.specular_reflectivity)
    points_m, radii_m = objects.points_m, objects.radii_m
    straight = straight_legs(end.pose, end.beam, channel, points_m, radii_m)
    position_m, places_m = end.pose.position_m[:2], points_m[:, :2]
    nobody = np.full(len(places_m), NO_OWNER)
    hidden = hidden_by_walls(position_m, places_m, walls.starts_m, walls.ends_m, nobody)
    hidden |= hidden_by_discs(position_m, places_m, discs.centers_m, discs.radii_m, objects.owners)
    bounced = wall_legs(end.pose, end.beam, channel, points_m, mirrors, radii_m)
    clear = _clear_of_others(scene, discs, position_m, objects, bounced.gains > 0.0, mirrors)
    return straight.but(hidden).beside(Legs(bounced.lengths_m, bounced.gains * clear))


def _clear_of_others(
    scene: Scene,
    discs: Discs,
    position_m: FloatArray,
    objects: _Objects,
    wanted: BoolArray,
    mirrors: Mirrors,
) -> BoolArray:
    """Whether nothing but the wall itself is on either stretch of each leg that is wanted."""
    clear = np.zeros(wanted.shape, dtype=bool)
    places_m = objects.points_m[:, :2]
    touches_m = mirrored_legs(position_m, places_m, mirrors).touches_m
    side = np.sum((position_m - mirrors.starts_m) * mirrors.normals, axis=-1)
    can_reflect = (side > 0.0) | ~scene.walls.one_sided
    ends = (scene.walls.starts_m, scene.walls.ends_m)
    for number in np.flatnonzero(wanted.any(axis=1)):
        walls = np.flatnonzero(wanted[number] & can_reflect)
        spots_m = touches_m[number, walls]
        own = np.full(len(walls), objects.owners[number])
        blocked = np.zeros(len(walls), dtype=bool)
        for origin_m in (position_m, places_m[number]):
            blocked |= hidden_by_walls(origin_m, spots_m, *ends, walls)
            blocked |= hidden_by_discs(origin_m, spots_m, discs.centers_m, discs.radii_m, own)
        clear[number, walls] = ~blocked
    return clear
