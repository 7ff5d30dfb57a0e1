"""Robots that state no relation between their frames: joined as soon as their maps tell it.

Each frame's map stands alone until it lies over another's in one way only; then the pings of frames
that are linked so are refined together, and their map is compared with the rest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from usmap_ros.errors import MalformedMessageError, MapSizeError
from usmap_ros.grids import OccupancyMap
from usmap_ros.localisation.linked_frames import Link, links
from usmap_ros.localisation.map_match import Match, match_maps
from usmap_ros.localisation.pose_kind import PoseKind, is_own_frame, robot_of
from usmap_ros.localisation.refine import refine_poses
from usmap_ros.mapping.far_off import FarOff, Ping
from usmap_ros.numerics.geometry import Pose, on_base
from usmap_ros.parameters import PipelineParameters
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.runs.set_apart import SetApart, in_one_place

#: The frame of robots that share none, once they are joined (REP 105).
WORLD = "map"
#: Of fewer pings nobody asks what they show.
_LEAST_PINGS = 20
#: How far a match may be off: x, y (m) and yaw (rad), standard deviations.
_OFF = np.array([0.1, 0.1, 0.03])
#: The same of poses that a user states.
_STATED = np.array([0.02, 0.02, 0.01])


@dataclass
class JoinedRobots:
    """Robots whose frames are one.

    Parameters
    ----------
    rows : list of int
        Which pings are theirs.
    robots : set of str
        Who they are.
    earlier : OccupancyMap or None
        What was known there before.
    map : OccupancyMap or None
        What they make of it; None: it is not worked out.
    """

    rows: list[int]
    robots: set[str]
    earlier: OccupancyMap | None = None
    map: OccupancyMap | None = None


@dataclass(frozen=True)
class Joining:
    """Pings of robots, those in one frame whose frames relate.

    Parameters
    ----------
    pings : list of (topic, EchoCone)
        All pings, in the order they came in.
    frames : dict
        The frame of each robot.
    earlier_frame_id : str
        That of an earlier map, if there is one.
    """

    pings: list[Ping]
    frames: dict[str, str]
    earlier_frame_id: str = ""

    def state(self, robot: str) -> str:
        """``joined`` with others or an earlier map, or ``alone`` in its frame."""
        frame_id = self.frames[robot]
        is_shared = list(self.frames.values()).count(frame_id) > 1
        return "joined" if is_shared or frame_id == self.earlier_frame_id else "alone"


def moved(ping: Ping, change: Pose, about_m: np.ndarray, frame_id: str) -> Ping:
    """A ping in another frame.

    Parameters
    ----------
    ping : (topic, EchoCone)
        What was heard.
    change : Pose
        Of its frame in the other one; its covariance is that at `about_m`.
    about_m : (2,) array
        In the ping's frame.
    frame_id : str
        The other frame.
    """
    topic, cone = ping
    centre = Pose.planar(float(about_m[0]), float(about_m[1]), 0.0)
    base = replace(change.compose(centre), covariance=change.covariance)
    pose = change.compose(cone.pose)
    lever = on_base(base, centre.inverse().compose(cone.pose)).covariance
    pose = Pose(pose.position_m, pose.orientation, pose.covariance + lever)
    return topic, replace(cone, frame_id=frame_id, pose=pose)


def with_starts(
    pings: Sequence[Ping], starts: Mapping[str, tuple[float, float, float]], frame_id: str
) -> list[Ping]:
    """Pings of robots in their own frames, in that of the map where their starts are known.

    Parameters
    ----------
    pings : sequence of (topic, EchoCone)
        Of all robots.
    starts : mapping of str to (x, y, yaw)
        Poses of the frames of odometry in the map's, m and rad.
    frame_id : str
        The map's.
    """
    changes = {
        robot: Pose.planar(*start, planar_covariance=np.diag(_STATED**2))
        for robot, start in starts.items()
    }
    done = []
    for topic, cone in pings:
        change = changes.get(robot_of(topic, cone).strip("/"))
        is_known = change is not None and is_own_frame(cone.frame_id)
        done.append(
            moved((topic, cone), change, np.zeros(2), frame_id)
            if change is not None and is_known
            else (topic, cone)
        )
    return done


def join_robots(
    told: Sequence[Ping],
    refined: Sequence[Ping],
    kinds: Mapping[str, PoseKind],
    parameters: PipelineParameters,
    world: str = WORLD,
    earlier: OccupancyMap | None = None,
) -> Joining:
    """Bring robots into one frame whose maps lie over each other in one way only.

    Nobody moves an earlier map: robots in frames of their own are joined to it.

    Parameters
    ----------
    told, refined : sequences of (topic, EchoCone)
        The same pings with poses as they were told, and as each frame's were refined.
    kinds : mapping of str to PoseKind
        What the poses of each robot are.
    parameters : PipelineParameters
        Of the maps.
    world : str
        What the frame is called that robots share who had none in common.
    earlier : OccupancyMap, optional
        What was mapped before.
    """
    base, current = list(told), list(refined)
    frames = _frames_of(base)
    if earlier is not None:
        frames.setdefault(earlier.frame_id, JoinedRobots([], set())).earlier = earlier
    matches: dict[tuple[str, str], Match | None] = {}
    while made := _links(frames, matches, current, parameters):
        for link in made:
            x_m, y_m, yaw_rad = map(float, link.change)
            change = Pose.planar(x_m, y_m, yaw_rad, planar_covariance=np.diag(_OFF**2))
            target, source = frames[link.target], frames.pop(link.source)
            for row in source.rows:
                base[row] = moved(base[row], change, link.about_m, link.target)
            rows, robots = sorted(target.rows + source.rows), target.robots | source.robots
            frames[link.target] = replace(target, rows=rows, robots=robots, map=None)
        changed = {name for link in made for name in (link.target, link.source)}
        for name in sorted(changed & set(frames)):
            rows = frames[name].rows
            together = refine_poses([base[row] for row in rows], kinds=kinds).pings
            for row, ping in zip(rows, together, strict=True):
                current[row] = ping
        matches = {pair: one for pair, one in matches.items() if not changed & set(pair)}
    _name(frames, current, world)
    return Joining(
        current,
        {robot: name for name, frame in frames.items() for robot in frame.robots},
        earlier.frame_id if earlier is not None else "",
    )


def _frames_of(pings: Sequence[Ping]) -> dict[str, JoinedRobots]:
    frames: dict[str, JoinedRobots] = {}
    for row, (topic, cone) in enumerate(pings):
        frame = frames.setdefault(cone.frame_id, JoinedRobots([], set()))
        frame.rows.append(row)
        frame.robots.add(robot_of(topic, cone))
    return dict(sorted(frames.items()))


def _links(
    frames: Mapping[str, JoinedRobots],
    matches: dict[tuple[str, str], Match | None],
    pings: Sequence[Ping],
    parameters: PipelineParameters,
) -> list[Link]:
    """How frames lie in others of which it is sure how they relate."""
    # Of frames that several robots share, nobody asks how they relate.
    enough = [
        name
        for name, frame in frames.items()
        if frame.earlier is not None or len(frame.rows) >= _LEAST_PINGS
    ]
    ranked = sorted(
        enough,
        key=lambda name: (
            frames[name].earlier is None,
            is_own_frame(name),
            -len(frames[name].rows),
        ),
    )
    sure: dict[tuple[str, str], Match] = {}
    for pair in combinations(ranked, 2):
        if not is_own_frame(pair[1]):
            continue
        if pair not in matches:
            matches[pair] = _match(frames[pair[0]], frames[pair[1]], pings, parameters)
        match = matches[pair]
        if match and match.is_sure:
            sure[pair] = match
    return links(sure, ranked, is_own_frame)


def _match(
    one: JoinedRobots, other: JoinedRobots, pings: Sequence[Ping], parameters: PipelineParameters
) -> Match | None:
    # A robot that has lost itself makes a map that is too large, and joins nobody.
    with suppress(MapSizeError):
        return match_maps(*(_map_of(each, pings, parameters) for each in (one, other)))
    return None


def _map_of(
    frame: JoinedRobots, pings: Sequence[Ping], parameters: PipelineParameters
) -> OccupancyMap:
    if frame.map is None:
        pipeline, far = Pipeline(parameters), FarOff(parameters.mapping)
        if frame.earlier is not None:
            pipeline.resume(frame.earlier)
            far.cover(frame.earlier.geometry)
        # What is far from all else would make the map too large, whatever it says.
        for topic, cone in in_one_place((pings[row] for row in frame.rows), far, SetApart()):
            # Whoever makes the map says what is wrong with a ping.
            with suppress(MalformedMessageError):
                pipeline.fuse(cone, topic)
        frame.map = pipeline.occupancy_map()
    return frame.map


def _name(frames: dict[str, JoinedRobots], pings: list[Ping], world: str) -> None:
    """Call the frame that most robots came to share by no robot's name."""
    joined = [one for one in frames if is_own_frame(one) and len(frames[one].robots) > 1]
    has_earlier = any(frame.earlier is not None for frame in frames.values())
    if not joined or world in frames or has_earlier:
        return
    most = max(joined, key=lambda name: len(frames[name].rows))
    frames[world] = frames.pop(most)
    for row in frames[world].rows:
        topic, cone = pings[row]
        pings[row] = topic, replace(cone, frame_id=world)
