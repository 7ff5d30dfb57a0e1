"""Poses that are all told too late, or too early: as they are where localisation takes its time.

Who is told at the time of a ping where it was a tenth of a second before is at the wrong place by
as much as it has moved since, and looks elsewhere by as much as it has turned.
"""

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from usmap_ros.mapping.focus import (
    LEAST_PINGS,
    Arcs,
    Ping,
    arcs_of,
    contradicts_one,
    is_sure,
    meetings,
)
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.geometry import Pose, wrapped
from usmap_ros.pings.cone import EchoCone

#: What is tried, s: first, of which nothing else being better nothing is wrong; then, of which the
#: greatest and the least are no answers; and around the best one.
AT_FIRST_S = (0.0, -0.05, 0.05)
DELAYS_S = [round(0.04 * step, 2) for step in range(-10, 11)]
CLOSER_S = (-0.03, -0.02, -0.01, 0.01, 0.02, 0.03)
#: A delay, s, below which maps are as good; and how many times as much as other errors it must
#: gain, for poses that are off by chance gain more than those that are right.
LEAST_DELAY_S, TIMES = 0.04, 1.5
#: Between pings that are farther apart, s, or as no robot is fast, m/s, nobody knows where it was;
#: and so many times as far as between the last two it goes on as it went.
MOST_GAP_S, FASTEST_M_S, MOST_AHEAD = 1.0, 10.0, 4.0


class PoseTracks:
    """Where transducers were at any time, by the poses that their pings state.

    Parameters
    ----------
    pings : iterable of (cone, source)
        In any order.
    """

    def __init__(self, pings: Iterable[Ping]) -> None:
        rows: defaultdict[tuple[str, str], list[tuple[float, ...]]] = defaultdict(list)
        for cone, source in pings:
            rows[source, cone.child_frame_id].append(_row(cone))
        self._tracks = {key: _smooth(np.array(sorted(own))) for key, own in rows.items()}

    def later(self, cone: EchoCone, source: str, by_s: float) -> FloatArray:
        """Place (x and y, m) and heading (rad), some time after a ping, as far as that is known.

        Parameters
        ----------
        cone, source
            The ping, which may be newer than all others.
        by_s : float
            How much later.
        """
        own = np.array(_row(cone))
        track, wanted_s = self._tracks.get((source, cone.child_frame_id)), own[0] + by_s
        if track is None or len(track) < 2:
            return own[1:]
        if own[0] > track[-1, 0]:
            track = _smooth(np.vstack([track[-1], own]))
        place = min(max(int(np.searchsorted(track[:, 0], wanted_s)), 1), len(track) - 1)
        before, behind = track[place - 1], track[place]
        gap_s = behind[0] - before[0]
        ahead_s = max(wanted_s - behind[0], before[0] - wanted_s)
        way_m = float(np.hypot(*(behind - before)[1:3]))
        is_known = gap_s <= MOST_GAP_S and way_m < FASTEST_M_S * gap_s
        if not is_known or ahead_s > MOST_AHEAD * gap_s:
            return own[1:]
        found: FloatArray = before + (wanted_s - before[0]) / gap_s * (behind - before)
        return found[1:]


def pose_delay_s(chosen: list[Ping], tracks: PoseTracks) -> float:
    """By how much all poses are told too late, s, if that is sure.

    Parameters
    ----------
    chosen : list of (cone, source)
        By `usmap_ros.mapping.focus.from_several_places`, of sensors that report more than the first
        thing.
    tracks : PoseTracks
        Of all pings.
    """
    if len(chosen) < LEAST_PINGS:
        return 0.0
    told = arcs_of([cone for cone, _ in chosen])

    def tried(delays_s: Iterable[float]) -> dict[float, FloatArray]:
        return meetings({by_s: _later(told, chosen, tracks, by_s) for by_s in delays_s})

    met = tried(AT_FIRST_S)
    if max(met, key=lambda by_s: met[by_s].sum()) == 0.0:
        return 0.0
    met |= tried(by_s for by_s in DELAYS_S if by_s not in met)
    middle_s = max(met, key=lambda by_s: met[by_s].sum())
    closer = {round(middle_s + by_s, 2) for by_s in CLOSER_S}
    # Between poses that are off by chance there is less of it: as much as the other way.
    met |= tried((closer | {-by_s for by_s in closer} | {-middle_s}) - met.keys())
    best_s = max(met, key=lambda by_s: met[by_s].sum())
    if not LEAST_DELAY_S <= abs(best_s) < DELAYS_S[-1]:
        return 0.0
    instead = max((0.0, -best_s), key=lambda by_s: met[by_s].sum())
    if not is_sure(met[best_s] - met[instead], told, TIMES):
        return 0.0
    is_of_all = not contradicts_one(chosen, lambda pings, arcs: _later(arcs, pings, tracks, best_s))
    return best_s if is_of_all else 0.0


def with_pose(cone: EchoCone, place: FloatArray) -> EchoCone:
    """A cone from another place and heading, otherwise as it was.

    Parameters
    ----------
    cone : EchoCone
        What was heard.
    place : (3,) array
        By `PoseTracks.later`.
    """
    x_m, y_m, yaw_rad = place.tolist()
    about = Pose.planar(0.0, 0.0, float(wrapped(np.array(yaw_rad - cone.pose.yaw_rad))))
    pose = replace(about.compose(cone.pose), covariance=cone.pose.covariance)
    position_m = np.array([x_m, y_m, float(cone.pose.position_m[2])])
    return replace(cone, pose=replace(pose, position_m=position_m))


def _later(told: Arcs, pings: list[Ping], tracks: PoseTracks, by_s: float) -> Arcs:
    """Arcs from where robots are said to be some time after their pings."""
    if not by_s:
        return told
    places = np.array([tracks.later(cone, source, by_s) for cone, source in pings])
    x_m, y_m, yaw_rad = np.ascontiguousarray(places.T)
    return told._replace(x_m=x_m, y_m=y_m, yaw_rad=yaw_rad)


def _row(cone: EchoCone) -> tuple[float, float, float, float]:
    x_m, y_m = cone.pose.position_m[:2].tolist()
    return 1e-9 * cone.stamp_ns, float(x_m), float(y_m), cone.pose.yaw_rad


def _smooth(track: FloatArray) -> FloatArray:
    """A track whose headings go on beyond half a turn."""
    track[:, 3] = np.unwrap(track[:, 3])
    return track
