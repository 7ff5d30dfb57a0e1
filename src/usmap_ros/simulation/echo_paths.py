"""All ways by which a pulse gets from a transducer to the one that listens."""

from dataclasses import dataclass, replace

import numpy as np

from usmap_ros.acoustics.legs import straight_legs
from usmap_ros.acoustics.propagation import Channel
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.geometry import Pose
from usmap_ros.simulation.bounces import bounced_paths
from usmap_ros.simulation.occlusion import NO_OWNER, hidden_by_discs, hidden_by_walls
from usmap_ros.simulation.scene import Scene
from usmap_ros.simulation.view import Targets, View, targets_in_view
from usmap_ros.simulation.wall_paths import PathEnd, paths_by_walls


@dataclass(frozen=True)
class Sounding:
    """A pulse that is sent and listened for."""

    #: Pose and beam of who sends and of who listens.
    sender: PathEnd
    listener: PathEnd
    #: Cone about the listener's axis, and range, within which things can answer.
    half_angle_rad: float
    reach_m: float
    channel: Channel
    #: Of the emission, after the scene's start.
    time_s: float
    #: (3,) array: of the listener while the sound is under way; None: it stands still.
    velocity_m_s: FloatArray | None = None


def echo_paths(scene: Scene, sounding: Sounding) -> tuple[FloatArray, FloatArray]:
    """Lengths and amplitudes of all paths over something that answers, shape (paths,)."""
    sender, listener, channel = sounding.sender, sounding.listener, sounding.channel
    # What is nearest to the two of them together is nearest to the middle between them.
    middle_m = 0.5 * (listener.pose.position_m + sender.pose.position_m)
    view = View(
        replace(listener.pose, position_m=middle_m), sounding.half_angle_rad, sounding.reach_m
    )
    targets = targets_in_view(scene, view, sounding.time_s)
    parts = [_over_targets(targets, sounding)]
    if scene.wall_paths:
        # Walls are not combined with corners.
        flat = replace(channel, floor_height_m=0.0) if channel.has_corners else channel
        parts.append(paths_by_walls(scene, sender, listener, flat, sounding.time_s))
    if scene.wall_bounces > 1:
        discs = scene.discs_at(sounding.time_s)
        parts.append(bounced_paths(scene, discs, sender, listener, channel, sounding.reach_m))
    if len(parts) == 1:
        return parts[0]
    lengths_m, amplitudes = (np.concatenate(column) for column in zip(*parts, strict=True))
    return lengths_m, amplitudes


def _over_targets(targets: Targets, sounding: Sounding) -> tuple[FloatArray, FloatArray]:
    """Paths over point targets, straight and by the floor."""
    channel, points_m = sounding.channel, targets.positions_m
    strengths = targets.reflectivities[:, np.newaxis]
    if not channel.has_corners:
        lengths_m, gains = _there_and_back(sounding, channel, points_m)
        return lengths_m.ravel(), (strengths * gains).ravel()
    # What stands upright returns sound by the corner between it and the floor; what floats does
    # by way of its image.
    bare = replace(channel, floor_height_m=0.0)
    upright, floating = targets.upright, ~targets.upright
    feet_m = points_m[upright] - [0.0, 0.0, channel.floor_height_m]
    twice = 2.0 * channel.floor_reflectivity
    parts = [
        (*_there_and_back(sounding, bare, points_m[upright]), strengths[upright]),
        (*_there_and_back(sounding, bare, feet_m), twice * strengths[upright]),
        (*_there_and_back(sounding, channel.with_image, points_m[floating]), strengths[floating]),
    ]
    return (
        np.concatenate([lengths_m.ravel() for lengths_m, _, _ in parts]),
        np.concatenate([(strength * gains).ravel() for _, gains, strength in parts]),
    )


def _there_and_back(
    sounding: Sounding, channel: Channel, points_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Lengths and gains, (points, paths), of all pairs of legs to points and back."""
    sender, listener = sounding.sender, sounding.listener
    there = straight_legs(sender.pose, sender.beam, channel, points_m)
    if sounding.velocity_m_s is not None:
        # By the time at which an echo is back, the listener has moved on.
        apart_m = np.linalg.norm(points_m - listener.pose.position_m, axis=1)
        passed_s = 2.0 * apart_m / channel.sound_speed_m_s
        points_m = points_m - passed_s[:, np.newaxis] * sounding.velocity_m_s
    return there.paths(straight_legs(listener.pose, listener.beam, channel, points_m))


def direct_path(
    scene: Scene, sender: PathEnd, listener: PathEnd, channel: Channel, time_s: float
) -> tuple[FloatArray, FloatArray]:
    """Length and amplitude of the straight way from one transducer to another, shape (0 or 1,).

    In units in which an ideal point target at 1 m gives 1: of two transducers that face each other
    1 m apart, too, one hears the other with 1.
    """
    places_m = listener.pose.position_m[np.newaxis, :2]
    origin_m, nobody = sender.pose.position_m[:2], np.array([NO_OWNER])
    discs, walls = scene.discs_at(time_s), scene.walls
    hidden = hidden_by_walls(origin_m, places_m, walls.starts_m, walls.ends_m, nobody)
    hidden |= hidden_by_discs(origin_m, places_m, discs.centers_m, discs.radii_m, nobody)
    if hidden[0]:
        return np.zeros(0), np.zeros(0)
    length_m, towards_listener = _seen(sender.pose, listener.pose)
    _, towards_sender = _seen(listener.pose, sender.pose)
    gain = np.sqrt(sender.beam.gain(towards_listener) * listener.beam.gain(towards_sender))
    return length_m, gain * channel.leg_gain(length_m)


def _seen(pose: Pose, other: Pose) -> tuple[FloatArray, FloatArray]:
    """Distance, at least a centimetre, and bearing of another pose, shape (1,) each."""
    ranges_m, bearings_rad = pose.polar(other.position_m[np.newaxis])
    return np.maximum(ranges_m, 0.01), bearings_rad
