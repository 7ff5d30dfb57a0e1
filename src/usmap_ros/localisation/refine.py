"""Poses of drifting robots, corrected by what all of them hear.

Odometry and echoes are weighed together, for all pings of a recording at once: a pose graph with
landmarks whose correspondences are found on the way, from coarse to fine.  Where no echo says
otherwise, odometry stands.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from usmap_ros.localisation.echo_table import tabulate
from usmap_ros.localisation.found import FoundPoses
from usmap_ros.localisation.motion_model import smoothed
from usmap_ros.localisation.noisy_poses import settle
from usmap_ros.localisation.planar import told_poses
from usmap_ros.localisation.pose_kind import PoseKind, pose_kind, robot_of
from usmap_ros.localisation.search import search
from usmap_ros.localisation.smoother import Smoother
from usmap_ros.localisation.tracks import Track
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.geometry import PLANAR_AXES, Pose, wrapped
from usmap_ros.pings.clutter import clutter_of, without_clutter
from usmap_ros.pings.cone import EchoCone

#: A ping, with the topic that it came on.
Ping = tuple[str, EchoCone]
#: Pings from knot to knot, and knots of all robots together, beyond which they are farther apart.
_EVERY, _MOST_KNOTS = 8, 1200
#: Pings at the most whose chance errors are corrected together: memory grows with how many there
#: are and with the landmarks that they hear.
_MOST_TOGETHER = 4000
_PLANE = np.ix_(PLANAR_AXES, PLANAR_AXES)


@dataclass(frozen=True)
class Refinement:
    """What became of the poses of a recording."""

    #: List of (topic, EchoCone): all pings, in the order they came in, with poses that are
    #: corrected.  What these state is how far they are off against what all pings hear.
    pings: list[Ping]
    #: (pings, 3, 3) array: covariances of their poses (x, y, yaw) in the frame.
    covariances: FloatArray
    #: What the poses of each robot are.
    kinds: dict[str, PoseKind]
    #: Root mean square of how far the places of each robot's pings were moved.
    corrections_m: dict[str, float]
    #: How far these may still be off in the frame, root mean square.
    stds_m: dict[str, float]


def refine_poses(
    pings: Sequence[Ping],
    *,
    insists: bool = False,
    kinds: Mapping[str, PoseKind] | None = None,
    before: Sequence[Ping] | None = None,
) -> Refinement:
    """Correct the poses of robots that drift.

    Parameters
    ----------
    pings : sequence of (topic, EchoCone)
        Of a recording, of any number of robots.
    insists : bool
        Take poses that seem to be absolute for odometry as well, of which no covariance says how
        far it drifts.
    kinds : mapping of str to PoseKind, optional
        What the poses of each robot are, if `kinds_of` would not see it any more.
    before : sequence of (topic, EchoCone), optional
        The same pings with poses that were found already, as by each robot alone.

    Returns
    -------
    Refinement
        Robots whose poses are absolute keep them, or each is corrected by itself if they are off
        by chance; they help to correct the others.
    """
    rows = _rows_by_robot(pings)
    found = dict(kinds) if kinds is not None else kinds_of(pings, insists=insists)
    refined, corrections_m = list(pings), dict[str, float]()
    _, known = told_poses([cone for _, cone in pings])
    for robots in _by_frame(pings, rows):
        if any(found[robot] is PoseKind.NOISY for robot in robots):
            steady = {one: rows[one] for one in robots if not found[one].drifts}
            corrections_m |= _settle_frame(refined, known, steady, found)
        if any(found[robot].drifts for robot in robots):
            here = {one: rows[one] for one in robots}
            moved_m = _refine_frame(refined, known, here, found, before)
            corrections_m |= {one: far_m for one, far_m in moved_m.items() if found[one].drifts}
    stds_m = {
        robot: float(np.sqrt(np.trace(known[own, :2, :2], axis1=1, axis2=2).mean()))
        for robot, own in rows.items()
    }
    return Refinement(
        refined, known, {robot: found[robot] for robot in rows}, corrections_m, stds_m
    )


def kinds_of(pings: Sequence[Ping], *, insists: bool = False) -> dict[str, PoseKind]:
    """What the poses of each robot are; parameters are those of `refine_poses`."""
    found = {
        robot: pose_kind([pings[row][1] for row in own])
        for robot, own in _rows_by_robot(pings).items()
    }
    if insists:
        steady = [robot for robot, kind in found.items() if not kind.drifts]
        found |= dict.fromkeys(steady, PoseKind.INSISTED)
    return found


def _rows_by_robot(pings: Sequence[Ping]) -> dict[str, NDArray[np.intp]]:
    """Which pings are whose, each robot's in the order of their stamps."""
    rows: dict[str, list[int]] = {}
    for row, (topic, cone) in enumerate(pings):
        rows.setdefault(robot_of(topic, cone), []).append(row)
    return {
        robot: np.array(sorted(own, key=lambda row: pings[row][1].stamp_ns))
        for robot, own in sorted(rows.items())
    }


def _by_frame(pings: Sequence[Ping], rows: dict[str, NDArray[np.intp]]) -> list[list[str]]:
    """Robots whose poses are in the same frame."""
    frames: dict[str, list[str]] = {}
    for robot, own in rows.items():
        frames.setdefault(pings[own[0]][1].frame_id, []).append(robot)
    return list(frames.values())


def _refine_frame(
    pings: list[Ping],
    covariances: FloatArray,
    rows: dict[str, NDArray[np.intp]],
    kinds: dict[str, PoseKind],
    before: Sequence[Ping] | None,
) -> dict[str, float]:
    """Correct poses in one frame, and covariances, in place; how far each robot's were moved."""
    every = max(_EVERY, -(-sum(map(len, rows.values())) // _MOST_KNOTS))
    all_rows = np.concatenate(list(rows.values()))
    cones = [pings[row][1] for row in all_rows]
    told, known = told_poses(cones)
    _, transducers = np.unique([one.child_frame_id for one in cones], return_inverse=True)
    tracks, first = [], 0
    for robot, own in rows.items():
        here = np.arange(first, first + len(own))
        is_fixed = not kinds[robot].drifts
        is_stated = kinds[robot] is not PoseKind.INSISTED
        tracks.append(
            Track(here, told[here], known[here], transducers[here], every, is_fixed, is_stated)
        )
        first += len(own)
    half_rad = np.array([one.transducer.beam.half_angle_rad for one in cones])
    looks = np.concatenate([track.looks(half_rad[track.rows]) for track in tracks])
    clutter = clutter_of(cones)
    things = [without_clutter(cone, clutter) for cone in cones]
    poses = told_poses([before[row][1] for row in all_rows])[0] if before is not None else None
    found = search(Smoother(tracks, tabulate(things, looks)), poses)
    if found is None:
        return dict.fromkeys(rows, 0.0)
    return _put(pings, covariances, rows, told, found)


def _settle_frame(
    pings: list[Ping],
    covariances: FloatArray,
    rows: dict[str, NDArray[np.intp]],
    kinds: dict[str, PoseKind],
) -> dict[str, float]:
    """The same with poses that are off by chance: by how robots move, then each by itself."""
    all_rows = np.concatenate(list(rows.values()))
    cones = [pings[row][1] for row in all_rows]
    told, stated = told_poses(cones)
    poses, known = told.copy(), stated.copy()
    robot_names = np.repeat(list(rows), [len(own) for own in rows.values()])
    is_noisy = np.array([kinds[name] is PoseKind.NOISY for name in robot_names])
    stamps_ns = np.array([one.stamp_ns for one in cones])
    for own in _tracks(robot_names, cones):
        if is_noisy[own[0]]:
            stamps_s = 1e-9 * (stamps_ns[own] - stamps_ns[own[0]])
            poses[own], known[own] = smoothed(stamps_s, told[own], stated[own])
    found = FoundPoses(poses.copy(), known.copy(), known.copy())
    in_time = np.argsort(stamps_ns, kind="stable")
    for together in np.array_split(in_time, -(-len(cones) // _MOST_TOGETHER)):
        settled = settle([cones[row] for row in together], poses[together], known[together])
        if settled is not None:
            own = together[is_noisy[together]]
            found.poses[own] = settled.poses[is_noisy[together]]
            found.covariances[own] = settled.covariances[is_noisy[together]]
            found.to_landmarks[own] = settled.to_landmarks[is_noisy[together]]
    found.covariances[~is_noisy] = np.nan
    return _put(pings, covariances, rows, told, found)


def _tracks(robot_names: NDArray[np.str_], cones: Sequence[EchoCone]) -> list[NDArray[np.intp]]:
    """Rows of the pings of each transducer, in their order."""
    names = [f"{robot} {one.child_frame_id}" for robot, one in zip(robot_names, cones, strict=True)]
    _, track = np.unique(names, return_inverse=True)
    return [np.flatnonzero(track == number) for number in range(track.max() + 1)]


def _put(
    pings: list[Ping],
    covariances: FloatArray,
    rows: dict[str, NDArray[np.intp]],
    told: FloatArray,
    found: FoundPoses,
) -> dict[str, float]:
    """Let pings of some robots, one behind the other, have their poses; how far these moved."""
    moved_m, first, corrections_m = np.hypot(*(found.poses - told)[:, :2].T), 0, {}
    for robot, own in rows.items():
        for place, row in enumerate(own, first):
            if np.isfinite(found.covariances[place]).all():
                topic, cone = pings[row]
                pose = _corrected(cone.pose, told[place], found, place)
                pings[row] = topic, replace(cone, pose=pose)
                covariances[row] = found.covariances[place]
        corrections_m[robot] = float(np.sqrt(np.mean(moved_m[first : first + len(own)] ** 2)))
        first += len(own)
    return corrections_m


def _corrected(pose: Pose, told: FloatArray, found: FoundPoses, place: int) -> Pose:
    """A pose turned and shifted in the plane, with its covariance against what pings hear."""
    change = found.poses[place] - told
    turn = Pose.planar(0.0, 0.0, float(wrapped(change[2])))
    covariance = pose.covariance.copy()
    covariance[_PLANE] = found.to_landmarks[place]
    position_m = pose.position_m + np.array([change[0], change[1], 0.0])
    return Pose(position_m, turn.compose(pose).orientation, covariance)
