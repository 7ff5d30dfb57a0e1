"""Sound that comes back by way of walls alone, from one to the next: image sources.

Between facing walls a pulse goes to and fro; in an inner corner it comes back from wherever it is
sent.  A path over walls A, B, … is as long as the straight line from the listener to the image of
the image of … the sender; Allen & Berkley, "Image method for efficiently simulating small-room
acoustics", J. Acoust. Soc. Am. 65 (1979) 943-950.
"""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from usmap_ros.acoustics.propagation import Channel
from usmap_ros.numerics.arrays import FloatArray, IntArray
from usmap_ros.numerics.geometry import at_height
from usmap_ros.simulation.occlusion import (
    NO_OWNER,
    hidden_by_discs,
    hidden_by_walls,
    point_segment_distances,
)
from usmap_ros.simulation.scene import Discs, Scene
from usmap_ros.simulation.wall_paths import PathEnd

#: Cosine between the normals of walls that meet at a right angle, and how near their ends are.
_RIGHT_ANGLE, _SAME_PLACE_M = 0.02, 1e-3


def bounced_paths(
    scene: Scene, discs: Discs, sender: PathEnd, listener: PathEnd, channel: Channel, reach_m: float
) -> tuple[FloatArray, FloatArray]:
    """Lengths and amplitudes of paths that touch two walls or more, and nothing else, (paths,).

    Parameters
    ----------
    scene : Scene
        Its walls are the mirrors; up to `Scene.wall_bounces` of them are touched.
    discs : Discs
        What may be in the way.
    sender, listener : PathEnd
        Pose and beam of who sends and of who listens.
    channel : Channel
        Gives spreading and absorption.
    reach_m : float
        Half the length of the longest path that can still be heard.
    """
    start_m, end_m = sender.pose.position_m[:2], listener.pose.position_m[:2]
    walls = scene.walls
    distances = point_segment_distances(end_m, walls.starts_m, walls.ends_m)
    reflects = (distances <= reach_m) & (walls.specular_reflectivity > 0.0)
    chains = _chains(np.flatnonzero(reflects), scene.wall_bounces)
    found = [(chain, _turns(scene, chain, start_m, end_m)) for chain in chains]
    lengths_m, amplitudes = [], []
    for chain, turns_m in found:
        if turns_m is None:
            continue
        length_m = float(np.linalg.norm(np.diff(turns_m, axis=0), axis=1).sum())
        if length_m > 2.0 * reach_m or not _is_clear(scene, discs, turns_m, chain):
            continue
        height_m = listener.pose.position_m[2]
        _, leaving = sender.pose.polar(at_height(turns_m[1:2], height_m))
        _, coming = listener.pose.polar(at_height(turns_m[-2:-1], height_m))
        beams = np.sqrt(sender.beam.gain(leaving) * listener.beam.gain(coming))[0]
        strength = np.prod(walls.specular_reflectivity[np.array(chain)])
        lengths_m.append(length_m)
        amplitudes.append(beams * strength * float(channel.leg_gain(np.array(length_m))))
    return np.array(lengths_m), np.array(amplitudes)


def _turns(
    scene: Scene, chain: tuple[int, ...], start_m: FloatArray, end_m: FloatArray
) -> FloatArray | None:
    """Where a path over a chain of walls turns, its ends included; None if there is none."""
    if len(chain) == 2 and (corner_m := _right_corner(scene, *chain)) is not None:
        # Whichever wall comes first, the image is the same: it is seen through either in part, and
        # counts once.
        is_first = chain[0] < chain[1]
        inside = all(_is_inside(scene, chain, corner_m, place_m) for place_m in (start_m, end_m))
        return np.array([start_m, corner_m, corner_m, end_m]) if is_first and inside else None
    return _mirrored_turns(scene, chain, start_m, end_m)


def _right_corner(scene: Scene, first: int, second: int) -> FloatArray | None:
    """Where two walls meet at a right angle; None if they do not."""
    walls = scene.walls
    if abs(walls.normals[first] @ walls.normals[second]) > _RIGHT_ANGLE:
        return None
    for one_m in (walls.starts_m[first], walls.ends_m[first]):
        for other_m in (walls.starts_m[second], walls.ends_m[second]):
            if np.linalg.norm(one_m - other_m) < _SAME_PLACE_M:
                return np.asarray(one_m)
    return None


def _is_inside(
    scene: Scene, chain: tuple[int, ...], corner_m: FloatArray, place_m: FloatArray
) -> bool:
    """Whether a place is between the two walls of a corner, and sees their fronts."""
    for wall in chain:
        first_m, last_m = scene.walls.starts_m[wall], scene.walls.ends_m[wall]
        far_m = last_m if np.linalg.norm(first_m - corner_m) < _SAME_PLACE_M else first_m
        if (far_m - corner_m) @ (place_m - corner_m) <= 0.0:
            return False
        if scene.walls.one_sided[wall] and (place_m - first_m) @ scene.walls.normals[wall] < 0.0:
            return False
    return True


def _chains(walls: IntArray, most: int) -> Iterator[tuple[int, ...]]:
    """Sequences of two to `most` walls, none twice in a row."""
    chains: list[tuple[int, ...]] = [(int(wall),) for wall in walls]
    for _ in range(most - 1):
        chains = [(*chain, int(wall)) for chain in chains for wall in walls if wall != chain[-1]]
        yield from chains


def _mirrored_turns(
    scene: Scene, chain: tuple[int, ...], start_m: FloatArray, end_m: FloatArray
) -> FloatArray | None:
    """Where the straight way from the listener to the last image is folded back; see `_turns`."""
    images_m = [start_m]
    for wall in chain:
        normal = scene.walls.normals[wall]
        side = (images_m[-1] - scene.walls.starts_m[wall]) @ normal
        images_m.append(images_m[-1] - 2.0 * side * normal)
    turns_m, here_m = [end_m], end_m
    # Backwards from the listener: towards each image the path meets the wall that made it.
    for wall, image_m in zip(reversed(chain), reversed(images_m), strict=False):
        met_m = _crossing(scene, wall, here_m, image_m)
        if met_m is None:
            return None
        turns_m.append(met_m)
        here_m = met_m
    turns_m.append(start_m)
    path_m = np.array(turns_m[::-1])
    # A mirror leaves both neighbours of the point where it is met on one side of it.
    for number, wall in enumerate(chain, start=1):
        sides = (path_m[[number - 1, number + 1]] - scene.walls.starts_m[wall]) @ (
            scene.walls.normals[wall]
        )
        is_hidden_side = scene.walls.one_sided[wall] and sides[0] < 0.0
        if sides[0] * sides[1] <= 0.0 or is_hidden_side:
            return None
    return path_m


def _crossing(scene: Scene, wall: int, from_m: FloatArray, to_m: FloatArray) -> FloatArray | None:
    """Where the way between two points meets a wall; None if it does not."""
    first_m, last_m = scene.walls.starts_m[wall], scene.walls.ends_m[wall]
    normal = scene.walls.normals[wall]
    before, behind = (from_m - first_m) @ normal, (to_m - first_m) @ normal
    if before * behind >= 0.0:
        return None
    met_m: FloatArray = from_m + before / (before - behind) * (to_m - from_m)
    along = last_m - first_m
    share = (met_m - first_m) @ along / (along @ along)
    return met_m if 0.0 <= share <= 1.0 else None


def _is_clear(scene: Scene, discs: Discs, turns_m: FloatArray, chain: tuple[int, ...]) -> bool:
    """Whether nothing but the walls of the chain is on any stretch of a path."""
    walls, nobody = scene.walls, np.array([NO_OWNER])
    for number, (from_m, to_m) in enumerate(pairwise(turns_m)):
        target_m = to_m[np.newaxis]
        # Both walls of a corner end where the path turns.
        touched = chain if len(chain) == 2 else chain[max(0, number - 1) : number + 1]
        others = np.setdiff1d(np.arange(len(walls)), touched)
        ends = (walls.starts_m[others], walls.ends_m[others])
        if hidden_by_walls(from_m, target_m, *ends, nobody)[0]:
            return False
        if hidden_by_discs(from_m, target_m, discs.centers_m, discs.radii_m, nobody)[0]:
            return False
    return True
