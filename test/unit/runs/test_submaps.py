"""Pieces of robots' ways, mapped each by itself."""

from dataclasses import replace

import numpy as np
import pytest
from pings_among_poles import Ping, circle, cone, heard, poles

from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import PipelineParameters
from usmap_ros.runs.submaps import brought_in_line, pieces_of_ways

#: A frame that is not quite where it is taken to be.
OFF = Pose.planar(0.12, 0.08, 0.03)


def going_round(robot: str, count: int = 60) -> list[Ping]:
    """Pings among poles, from where they were heard, as uncertain as odometry makes them."""
    made = []
    for number, real in enumerate(circle(count)):
        known = np.diag([0.01, 0.01, 0.001]) * (1.0 + 0.01 * number)
        pose = Pose.planar(*map(float, real), planar_covariance=known)
        ranges_m = heard(Pose.planar(*real), poles())
        names = {"child_frame_id": f"{robot}/sonar"}
        made.append((f"/{robot}/echo", cone(pose, ranges_m, 250_000_000 * number + 1, **names)))
    return made


def gap_m(pings: list[Ping]) -> float:
    """How far one of two robots that go the same way is from the other (RMS)."""
    places_m = np.array([one.pose.position_m[:2] for _, one in pings]).reshape(2, -1, 2)
    return float(np.sqrt(np.mean(np.sum((places_m[1] - places_m[0]) ** 2, axis=1))))


@pytest.mark.parametrize(("count", "pieces"), [(20, [20]), (160, [80, 80])])
def test_a_way_is_cut_into_pieces(count: int, pieces: list[int]) -> None:
    (way,) = pieces_of_ways(going_round("robot1", count), PipelineParameters())
    assert [len(piece.rows) for piece in way] == pieces
    np.testing.assert_array_equal(np.concatenate([piece.rows for piece in way]), np.arange(count))


def test_pieces_that_show_the_same_bring_ways_in_line() -> None:
    one, other = going_round("robot1"), going_round("robot2")
    (first,), (second,) = (pieces_of_ways(each, PipelineParameters()) for each in (one, other))
    there = [
        (
            topic,
            replace(ping, pose=replace(OFF.compose(ping.pose), covariance=ping.pose.covariance)),
        )
        for topic, ping in other
    ]
    behind = [piece._replace(rows=piece.rows + len(one)) for piece in second]
    change = np.array([0.12, 0.08, 0.03])
    told = one + there
    done = brought_in_line(told, told, [(first, np.zeros(3)), (behind, change)])
    assert gap_m(told) > 0.1
    assert gap_m(done) < 0.5 * gap_m(told)
