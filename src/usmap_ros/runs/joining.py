"""Robots that state no relation between their frames: joined as soon as their maps tell it.

Each frame's map stands alone until it lies over another's in one way only; then the pings of frames
that are linked so are refined together, and their map is compared with the rest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from usmap_ros.grids import OccupancyMap
from usmap_ros.localisation.pose_kind import PoseKind, is_own_frame, robot_of
from usmap_ros.localisation.refine import refine_poses
from usmap_ros.mapping.far_off import Ping
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import PipelineParameters
from usmap_ros.runs.frame_matches import FrameMatches, JoinedRobots
from usmap_ros.runs.moved_pings import moved, moved_by
from usmap_ros.runs.submaps import Way

#: The frame of robots that share none, once they are joined (REP 105).
WORLD = "map"
#: How far poses that a user states may be off: x, y (m) and yaw (rad), standard deviations.
_STATED = np.array([0.02, 0.02, 0.01])


@dataclass(frozen=True)
class Joining:
    """Pings of robots, those in one frame whose frames relate."""

    #: List of (topic, EchoCone): all pings, in the order they came in.
    pings: list[Ping]
    #: The frame of each robot.
    frames: dict[str, str]
    #: That of an earlier map, if there is one.
    earlier_frame_id: str = ""

    def state(self, robot: str) -> str:
        """``joined`` with others or an earlier map, or ``alone`` in its frame."""
        frame_id = self.frames[robot]
        is_shared = list(self.frames.values()).count(frame_id) > 1
        return "joined" if is_shared or frame_id == self.earlier_frame_id else "alone"


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
    return [
        moved((topic, cone), change, np.zeros(2), frame_id)
        if is_own_frame(cone.frame_id) and (change := changes.get(robot_of(topic, cone).strip("/")))
        else (topic, cone)
        for topic, cone in pings
    ]


def join_robots(
    told: Sequence[Ping],
    refined: Sequence[Ping],
    kinds: Mapping[str, PoseKind],
    parameters: PipelineParameters,
    world: str = WORLD,
    earlier: OccupancyMap | None = None,
    ways: Mapping[str, Way] | None = None,
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
    ways : mapping of str to list of Piece, optional
        What ways of some robots show, by `refined`.
    """
    base, current = list(told), list(refined)
    frames = _frames_of(base, ways or {})
    if earlier is not None:
        frames.setdefault(earlier.frame_id, JoinedRobots([], set())).earlier = earlier
    matches = FrameMatches(frames, base, current, kinds, parameters)
    # Frames whose pings are not refined together yet.  That may bend all of them alike, so that who
    # is left fits them no more: it is first compared with what each frame was found to be.
    waiting: set[str] = set()
    while (made := matches.links(looks_again=not waiting)) or waiting:
        looked_at = matches.refined_by(made)
        for link in made:
            target, source = frames[link.target], frames.pop(link.source)
            for row in source.rows:
                base[row], current[row] = moved_by(base[row], link), moved_by(current[row], link)
            rows, robots = target.rows + source.rows, target.robots | source.robots
            for row, ping in zip(rows, looked_at or (), strict=looked_at is not None):
                current[row] = ping
            frames[link.target] = JoinedRobots(sorted(rows), robots, target.earlier)
        changed = {name for link in made for name in (link.target, link.source)}
        if not made:
            for name in sorted(waiting):
                rows = frames[name].rows
                told_here, before = [base[row] for row in rows], [current[row] for row in rows]
                together = refine_poses(told_here, kinds=kinds, before=before).pings
                for row, ping in zip(rows, together, strict=True):
                    current[row] = ping
            changed, waiting = waiting, set()
        elif looked_at is None:
            waiting = (waiting | changed) & set(frames)
        matches.forget(changed)
    _name(frames, current, world)
    return Joining(
        current,
        {robot: name for name, frame in frames.items() for robot in frame.robots},
        earlier.frame_id if earlier is not None else "",
    )


def _frames_of(pings: Sequence[Ping], ways: Mapping[str, Way]) -> dict[str, JoinedRobots]:
    frames: dict[str, JoinedRobots] = {}
    for row, (topic, cone) in enumerate(pings):
        frame = frames.setdefault(cone.frame_id, JoinedRobots([], set()))
        frame.rows.append(row)
        frame.robots.add(robot_of(topic, cone))
    for frame in frames.values():
        if frame.robots <= ways.keys():
            frame.ways = [_within(ways[robot], frame.rows) for robot in sorted(frame.robots)]
    return dict(sorted(frames.items()))


def _within(way: Way, rows: Sequence[int]) -> Way:
    """A way by where its pings are among some."""
    return [piece._replace(rows=np.searchsorted(rows, piece.rows)) for piece in way]


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
