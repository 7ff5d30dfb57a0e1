"""Whether who is accused by landmarks is there by the others' map."""

import math
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from robots_among_poles import cones, findings

from usmap_ros.mapping.joint.leave_one_out import LeaveOneOutMap
from usmap_ros.mapping.robot_check import consistency
from usmap_ros.mapping.robot_check.confirmation import corrected, is_there
from usmap_ros.mapping.robot_check.displacement import Displacement
from usmap_ros.mapping.robot_check.finding import Finding
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

ACCUSED, TURNED_RAD = "/robot2/echo", 0.35
TURNED = Displacement("turned", (TURNED_RAD,), 100.0, 50.0).finding()
MOVED = Displacement("moved", (0.9, 0.5), 100.0, 3.0).finding()


@cache
def robots() -> dict[str, list[EchoCone]]:
    """Give what each of three robots among poles heard."""
    found: dict[str, list[EchoCone]] = {}
    for topic, cone in cones(11):
        found.setdefault(topic, []).append(cone)
    return found


@cache
def others() -> LeaveOneOutMap:
    """Give the map of all but one."""
    own = {topic: heard for topic, heard in robots().items() if topic != ACCUSED}
    return LeaveOneOutMap(own, MappingParameters())


def turned(cone: EchoCone, by_rad: float) -> EchoCone:
    """Say that a ping looked elsewhere."""
    x_m, y_m = cone.pose.position_m[:2]
    return replace(cone, pose=Pose.planar(x_m, y_m, cone.pose.yaw_rad + by_rad))


@pytest.mark.parametrize("accused", [TURNED, MOVED])
def test_who_is_right_is_there_whatever_it_is_accused_of(accused: Finding) -> None:
    assert is_there(robots()[ACCUSED], others(), accused)


def test_who_faces_a_little_elsewhere_fits_better_without_that() -> None:
    """Of beams that are 60° wide most still hear what is expected."""
    liar = [turned(cone, TURNED_RAD) for cone in robots()[ACCUSED]]

    assert is_there(liar, others(), MOVED)
    assert not is_there(liar, others(), TURNED)


def test_who_faces_away_is_not_there() -> None:
    liar = [turned(cone, math.pi) for cone in robots()[ACCUSED]]

    assert not is_there(liar, others(), MOVED)


def test_where_nobody_else_was_nothing_is_said() -> None:
    liar = [
        replace(cone, pose=Pose.planar(50.0, 50.0, cone.pose.yaw_rad)) for cone in robots()[ACCUSED]
    ]

    assert not is_there(liar, others(), TURNED)
    assert not is_there(liar, LeaveOneOutMap({}, MappingParameters()), TURNED)


@pytest.mark.parametrize("way", ["displaced", "shifted"])
def test_landmarks_accuse_nobody_whom_the_others_map_bears_out(
    way: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where walls reverberated, a healthy robot of two faced elsewhere by a few of them."""
    accused = {ACCUSED: TURNED if way == "displaced" else MOVED}
    monkeypatch.setattr(consistency, way, lambda _: accused)

    assert [topic for topic, finding in findings(cones(11)).items() if finding.is_suspect] == []


def test_who_may_be_moved_if_another_is_not_is_told_so_still(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Nobody is left out for that, and so nothing has to be confirmed."""
    told = Finding("contradicted", {}, "contradicted: it is 0.9 m off; or another is misplaced")
    monkeypatch.setattr(consistency, "shifted", lambda _: {ACCUSED: told})

    assert findings(cones(11))[ACCUSED] == told


def test_what_is_wrong_is_taken_off() -> None:
    right = robots()[ACCUSED]
    liar = [turned(cone, TURNED_RAD) for cone in right]
    for cone, own in zip(corrected(liar, TURNED), right, strict=True):
        assert cone.pose.yaw_rad == pytest.approx(own.pose.yaw_rad)
        assert cone.pose.position_m == pytest.approx(own.pose.position_m)

    away = [cone.pose.position_m[:2] - [0.9, 0.5] for cone in right]
    for cone, there_m in zip(corrected(right, MOVED), away, strict=True):
        assert cone.pose.position_m[:2] == pytest.approx(there_m)

    scaled = Displacement("scaled", (0.05,), 100.0, 50.0).finding()
    longer = [replace(cone, ranges_m=cone.ranges_m * np.float32(1.05)) for cone in right]
    for cone, own in zip(corrected(longer, scaled), right, strict=True):
        assert cone.ranges_m == pytest.approx(own.ranges_m, rel=1e-5)

    step_s = 1e-9 * (right[1].stamp_ns - right[0].stamp_ns)
    late = Displacement("late", (step_s,), 100.0, 50.0).finding()
    told = [replace(cone, pose=before.pose) for before, cone in pairwise(right)]
    for cone, own in zip(corrected(told, late)[:-1], right[1:], strict=False):
        assert cone.pose.position_m[:2] == pytest.approx(own.pose.position_m[:2], abs=1e-6)
