"""Robots whose odometry begins anew: what they say then has nothing to do with what they said."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from usmap_ros.localisation.pose_kind import is_own_frame, robot_of
from usmap_ros.mapping.far_off import Ping

#: Between a robot's name, or its frame's, and the number of its restarts.
MARK = "#"
#: No robot goes so far between two pings: m, and m/s.
_JUMP_M, _FASTEST_M_S = 0.5, 3.0
#: Odometry never gets surer: a variance of places (m²) that falls to such a share of itself was set
#: back, unless it was as small as this.
_FALLEN, _SMALL_M2 = 0.25, 1e-4

#: Who has begun anew so often is out of order, and told apart no further.
_MOST_LIVES = 10


@dataclass(frozen=True)
class _Last:
    stamp_ns: int
    x_m: float
    y_m: float
    variance_m2: float


class Restarts:
    """Tells pings from before and after a restart apart, for robots in frames of their own.

    A robot that was switched on again counts from zero.  It is another robot then, ``robot1#2``,
    in a frame of its own, until it is joined.
    """

    def __init__(self) -> None:
        # By robot, and by transducer.
        self._last: dict[str, dict[str, _Last]] = {}
        self._lives: dict[str, int] = {}

    def renamed(self, ping: Ping) -> Ping:
        """A ping, in the order of stamps, with the names of its robot's present life."""
        topic, cone = ping
        if not is_own_frame(cone.frame_id):
            return ping
        x_m, y_m, _ = map(float, cone.pose.position_m)
        variance_m2 = float(cone.pose.covariance[0, 0] + cone.pose.covariance[1, 1])
        now, robot = _Last(cone.stamp_ns, x_m, y_m, variance_m2), robot_of(topic, cone)
        lasts = self._last.setdefault(robot, {})
        last = lasts.get(topic)
        is_counted = self._lives.get(robot, 1) < _MOST_LIVES
        if last is not None and is_counted and _is_anew(last, now):
            self._lives[robot] = self._lives.get(robot, 1) + 1
            # What its other transducers say next is of the new life, too.
            lasts.clear()
        lasts[topic] = now
        life = self._lives.get(robot, 1)
        if life == 1:
            return ping
        return of_life(ping, f"{robot.strip('/')}{MARK}{life}", f"{cone.frame_id}{MARK}{life}")


def of_life(ping: Ping, name: str, frame_id: str) -> Ping:
    """A ping under the name of a robot's later life, in a frame of that one's own."""
    topic, cone = ping
    transducer = cone.child_frame_id.rpartition("/")[2]
    return topic, replace(cone, frame_id=frame_id, child_frame_id=f"{name}/{transducer}")


def first_name(name: str) -> str:
    """Name of a robot, or of its frame, before any restart: what it calls itself."""
    return name.partition(MARK)[0]


def _is_anew(last: _Last, now: _Last) -> bool:
    """Whether no odometry goes from one ping to the next."""
    seconds = max(now.stamp_ns - last.stamp_ns, 0) / 1e9
    way_m = math.hypot(now.x_m - last.x_m, now.y_m - last.y_m)
    has_fallen = last.variance_m2 > _SMALL_M2 and now.variance_m2 < _FALLEN * last.variance_m2
    return has_fallen or way_m > _JUMP_M + _FASTEST_M_S * seconds
