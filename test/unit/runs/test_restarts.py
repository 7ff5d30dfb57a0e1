"""Robots whose odometry begins anew."""

from dataclasses import replace

import numpy as np
import pytest
from pings_among_poles import Ping, cone

from usmap_ros.mapping.common_frame import CommonFrame
from usmap_ros.numerics.geometry import Pose
from usmap_ros.runs.restarts import Restarts, first_name
from usmap_ros.runs.set_apart import SetApart, in_one_frame

SECOND_NS = 10**9


def way(
    places_m: list[float], variances_m2: list[float] | None = None, frame_id: str = "robot1/odom"
) -> list[Ping]:
    """A ping each second from places along x."""
    made = []
    for number, x_m in enumerate(places_m):
        known = np.eye(3) * (variances_m2[number] if variances_m2 else 0.0)
        pose = Pose.planar(x_m, 0.0, 0.0, planar_covariance=known)
        one = cone(pose, (), number * SECOND_NS + 1, frame_id=frame_id)
        made.append(("/robot1/echo", one))
    return made


def frames(pings: list[Ping]) -> list[str]:
    restarts = Restarts()
    return [restarts.renamed(ping)[1].frame_id for ping in pings]


def test_who_drives_on_stays_who_it_is() -> None:
    pings, restarts = way([0.0, 1.0, 2.5, 4.0], [0.0, 0.01, 0.02, 0.03]), Restarts()
    assert all(restarts.renamed(ping) is ping for ping in pings)


def test_odometry_that_is_set_back_is_another_robots() -> None:
    pings, restarts = way([0.0, 2.0, 4.0, 6.0, 0.0, 1.0]), Restarts()
    named = [restarts.renamed(ping)[1] for ping in pings]
    assert [one.frame_id for one in named] == ["robot1/odom"] * 4 + ["robot1/odom#2"] * 2
    assert [one.child_frame_id for one in named][3:5] == ["robot1/sonar", "robot1#2/sonar"]
    assert first_name(named[-1].frame_id) == "robot1/odom"


def test_a_covariance_that_is_set_back_tells_it_near_the_start_too() -> None:
    pings = way([0.0, 1.0, 0.3, 0.0], [1e-6, 0.01, 0.02, 1e-6])
    assert frames(pings) == ["robot1/odom"] * 3 + ["robot1/odom#2"]


def test_every_restart_counts() -> None:
    assert frames(way([0.0, 9.0, 0.0]))[1:] == ["robot1/odom#2", "robot1/odom#3"]


def test_a_robot_that_is_out_of_order_does_not_become_hundreds() -> None:
    assert len(set(frames(way([9.0 * (number % 2) for number in range(100)])))) == 10


def test_a_gap_leaves_time_to_drive() -> None:
    pings = way([0.0, 1.0])
    late = replace(pings[1][1], stamp_ns=10 * SECOND_NS, pose=Pose.planar(20.0, 0.0, 0.0))
    assert frames([pings[0], ("/robot1/echo", late)]) == ["robot1/odom"] * 2


@pytest.mark.parametrize("frame_id", ["map", "world"])
def test_frames_that_robots_share_are_believed(frame_id: str) -> None:
    assert set(frames(way([0.0, 9.0, 0.0], frame_id=frame_id))) == {frame_id}


def test_all_transducers_of_a_robot_begin_anew_once() -> None:
    restarts, found = Restarts(), []
    for topic, one in way([0.0, 9.0, 9.5]):
        for side in ("left", "right"):
            named = replace(one, child_frame_id=f"robot1/{side}")
            found.append(restarts.renamed((f"{topic}/{side}", named))[1].frame_id)
    assert found == ["robot1/odom"] * 2 + ["robot1/odom#2"] * 4


def test_robots_do_not_meddle_with_each_other() -> None:
    restarts = Restarts()
    for topic, one in way([0.0, 9.0]):
        restarts.renamed((topic, one))
    other = replace(way([50.0])[0][1], frame_id="robot2/odom", child_frame_id="robot2/sonar")
    ping = ("/robot2/echo", other)
    assert restarts.renamed(ping) is ping


def test_a_user_learns_why_a_later_life_is_not_in_the_map() -> None:
    restarts, apart = Restarts(), SetApart()
    pings = [restarts.renamed(ping) for ping in way([0.0, 1.0, 2.0, 9.0])]
    assert len(list(in_one_frame(pings, CommonFrame(), apart))) == 3
    assert "its odometry jumped" in apart.causes()["/robot1/echo"]
