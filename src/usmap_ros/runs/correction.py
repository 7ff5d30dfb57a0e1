"""Poses that a map is made with, from those that were told: offline and live alike."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

from usmap_ros.grids import OccupancyMap
from usmap_ros.localisation.pose_kind import PoseKind, is_own_frame
from usmap_ros.localisation.refine import kinds_of, refine_poses
from usmap_ros.mapping.far_off import Ping
from usmap_ros.parameters import PipelineParameters
from usmap_ros.runs.carried_off import with_lives
from usmap_ros.runs.corrected import Corrected, RobotPoses
from usmap_ros.runs.joining import WORLD, join_robots, with_starts


def correct_poses(
    pings: Sequence[Ping],
    parameters: PipelineParameters,
    frame_id: str = "",
    known: Mapping[str, PoseKind] | None = None,
    earlier: OccupancyMap | None = None,
) -> Corrected:
    """Refine poses that drift, and join robots that state no relation between their frames.

    Parameters
    ----------
    pings : sequence of (topic, EchoCone)
        Of all robots, as told.
    parameters : PipelineParameters
        ``poses`` says what is wanted; the others are of the maps that robots are joined by.
    frame_id : str
        The map's frame; empty: the one that robots share, or `joining.WORLD`.
    known : mapping of str to PoseKind, optional
        What is known of the poses of some robots.
    earlier : OccupancyMap, optional
        What was mapped before, to which robots in frames of their own are joined.
    """
    wanted, world = parameters.poses, frame_id or _shared_frame(pings) or WORLD
    kinds = kinds_of(pings, insists=wanted.use == "refined")
    kinds |= {robot: kind for robot, kind in (known or {}).items() if robot in kinds}
    told = with_starts(pings, wanted.starts(), world)
    if wanted.use == "told":
        return Corrected(told)
    refined = refine_poses(told, kinds=kinds)
    told, lost, ways = with_lives(told, refined.pings, kinds, parameters)
    if lost:
        kinds, ways = kinds | dict.fromkeys(lost, PoseKind.ODOMETRY_FROM_ANYWHERE), {}
        refined = refine_poses(told, kinds=kinds)
    joining = join_robots(told, refined.pings, kinds, parameters, world, earlier, ways)
    return Corrected(
        joining.pings,
        {
            robot: RobotPoses(
                kind,
                joining.frames[robot],
                "lost"
                if robot in lost and joining.state(robot) == "alone"
                else joining.state(robot),
                refined.corrections_m.get(robot, 0.0),
                refined.stds_m[robot],
            )
            for robot, kind in kinds.items()
        },
    )


def _shared_frame(pings: Sequence[Ping]) -> str:
    """The frame of most pings that are in no robot's own; empty if there are none."""
    frames = Counter(cone.frame_id for _, cone in pings if not is_own_frame(cone.frame_id))
    return frames.most_common(1)[0][0] if frames else ""
