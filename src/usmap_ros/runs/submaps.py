"""Pieces of robots' ways that are mapped each by itself, and ways brought in line by them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.errors import MalformedMessageError
from usmap_ros.grids import OccupancyMap
from usmap_ros.localisation.planar import compose, told_poses
from usmap_ros.localisation.pose_kind import robot_of
from usmap_ros.localisation.submap import Submap
from usmap_ros.localisation.submap_graph import PlacedSubmap, edges_between, in_line
from usmap_ros.localisation.tracks import Track
from usmap_ros.mapping.far_off import FarOff, Ping
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import PipelineParameters
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.runs.set_apart import SetApart, in_one_place

#: Pings of a piece, which odometry hardly bends; pieces of a robot, beyond which they are longer.
OF_PIECE, _MOST_PIECES = 100, 20
#: Pings from knot to knot of the graph that pieces are brought in line by.
_EVERY = 50
_ORIGIN = np.zeros(3)


class Piece(NamedTuple):
    """A piece of a robot's way."""

    #: (n,) int array: which pings, in the order of their stamps.
    rows: NDArray[np.intp]
    #: What they show.
    submap: Submap
    #: (3,) array: where the frame in which they are mapped lies in that of the way, if it is bent:
    #: x, y (m) and yaw (rad).
    change: FloatArray = _ORIGIN


#: A robot's way, piece by piece.
Way = list[Piece]


def pieces_of_ways(pings: Sequence[Ping], parameters: PipelineParameters) -> list[Way]:
    """What each piece of each robot's way shows.

    Parameters
    ----------
    pings : sequence of (topic, EchoCone)
        Of robots in one frame.
    parameters : PipelineParameters
        Of the maps.
    """
    rows: dict[str, list[int]] = {}
    for row, ping in enumerate(pings):
        rows.setdefault(robot_of(*ping), []).append(row)
    return [way_of(pings, own, parameters) for own in rows.values()]


def way_of(pings: Sequence[Ping], rows: Iterable[int], parameters: PipelineParameters) -> Way:
    """What each piece of one robot's way shows.

    Parameters
    ----------
    pings : sequence of (topic, EchoCone)
        Of any robots.
    rows : iterable of int
        Which of them are its.
    parameters : PipelineParameters
        Of the maps.
    """
    own = np.array(sorted(rows, key=lambda row: pings[row][1].stamp_ns))
    count = min(max(1, round(len(own) / OF_PIECE)), _MOST_PIECES)
    return [
        Piece(part, Submap.of(map_of([pings[row] for row in part], parameters)))
        for part in np.array_split(own, count)
    ]


def brought_in_line(
    told: Sequence[Ping], refined: Sequence[Ping], ways: Iterable[tuple[Way, FloatArray]]
) -> list[Ping]:
    """Pings with poses by which pieces of ways lie over each other, as far as odometry allows.

    Parameters
    ----------
    told, refined : sequences of (topic, EchoCone)
        The same pings in one frame, with poses as they were told, and as each robot's were refined.
    ways : iterable of (list of Piece, (3,) array)
        Their pieces, with the frame in which these are mapped in that of the pings: x, y (m) and
        yaw (rad).
    """
    tracks: list[Track] = []
    placed: list[PlacedSubmap] = []
    for way, change in ways:
        rows, gone = np.concatenate([piece.rows for piece in way]), 0
        for piece in way:
            middle = gone + len(piece.rows) // 2
            there = compose(change, piece.change)
            placed.append(PlacedSubmap(piece.submap, there, len(tracks), middle))
            gone += len(piece.rows)
        poses, _ = told_poses([refined[row][1] for row in rows])
        _, known = told_poses([told[row][1] for row in rows])
        names = [told[row][1].child_frame_id for row in rows]
        _, transducers = np.unique(names, return_inverse=True)
        tracks.append(Track(rows, poses, known, transducers, _EVERY))
    done = list(refined)
    for track, poses in zip(tracks, in_line(tracks, edges_between(tracks, placed)), strict=True):
        for row, (x_m, y_m, yaw_rad) in zip(track.rows, poses.tolist(), strict=True):
            topic, cone = refined[row]
            done[row] = topic, replace(cone, pose=Pose.planar(x_m, y_m, yaw_rad))
    return done


def map_of(
    pings: Iterable[Ping], parameters: PipelineParameters, earlier: OccupancyMap | None = None
) -> OccupancyMap:
    """The map of some pings of one frame.

    Parameters
    ----------
    pings : iterable of (topic, EchoCone)
        In any order.
    parameters : PipelineParameters
        Of the map.
    earlier : OccupancyMap, optional
        What was mapped before.
    """
    pipeline, far = Pipeline(parameters), FarOff(parameters.mapping)
    if earlier is not None:
        pipeline.resume(earlier)
        far.cover(earlier.geometry)
    # What is far from all else would make the map too large, whatever it says.
    for topic, cone in in_one_place(pings, far, SetApart()):
        # Whoever makes the map says what is wrong with a ping.
        with suppress(MalformedMessageError):
            pipeline.fuse(cone, topic)
    return pipeline.occupancy_map()
