"""What is wrong with a robot's poses, or its ranges, is told by what would make them fit."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from usmap_ros.mapping.joint.leave_one_out import LeaveOneOutMap, kept_pings
from usmap_ros.mapping.robot_check.displacement import Explanation, Way, sure_explanation
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import MappingParameters, ReconstructionParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.reconstruction.reconstructor import reconstruct
from usmap_ros.simulation import Scenario, simulate

ODD = "/robot2/echo"
Cones = dict[str, list[EchoCone]]


@pytest.fixture(scope="module")
def cones() -> Cones:
    """Give the pings of three robots among poles that all of them hear."""
    motion = {"kind": "random_walk", "speed_m_s": 1.5, "clearance_m": 0.2}
    content = {
        "description": "poles",
        "seed": 11,
        "duration_s": 5.0,
        "world": {
            "area_m": [0.0, 5.0, 0.0, 5.0],
            "random_poles": {"count": 14, "separation_m": 0.5, "reflectivity_spread": 0.35},
        },
        "robots": [{"name": f"robot{number}", "motion": motion} for number in (1, 2, 3)],
    }
    found: Cones = {}
    for topic, trace in simulate(Scenario.from_mapping(content, "poles")):
        cone = reconstruct(trace, ReconstructionParameters()).cone
        found.setdefault(topic, []).append(cone)
    return found


@pytest.fixture(scope="module")
def others(cones: Cones) -> LeaveOneOutMap:
    """Give the map that two of them make."""
    rest = {topic: own for topic, own in cones.items() if topic != ODD}
    return LeaveOneOutMap(rest, MappingParameters())


def explained(own: list[EchoCone], others: LeaveOneOutMap) -> Explanation | None:
    kept = kept_pings({ODD: own}, MappingParameters())
    stamps_s = np.array([cone.stamp_ns for cone, _ in kept.cones()]) * 1e-9
    way = Way(own, kept.pings(), stamps_s)
    return sure_explanation(way, partial(others.levels, way.pings.rows, without=[ODD]))


def at(cone: EchoCone, x_m: float = 0.0, y_m: float = 0.0, turned_rad: float = 0.0) -> EchoCone:
    """Say that a ping came from elsewhere."""
    there_m = cone.pose.position_m[:2] + np.array([x_m, y_m])
    return replace(cone, pose=Pose.planar(*there_m, cone.pose.yaw_rad + turned_rad))


def late(cones: list[EchoCone]) -> list[EchoCone]:
    """Give pings with the poses of a second before."""
    stamps_ns = np.array([cone.stamp_ns for cone in cones])
    before = np.maximum(np.searchsorted(stamps_ns, stamps_ns - 1e9), 0)
    return [replace(cone, pose=cones[i].pose) for cone, i in zip(cones, before, strict=True)]


def stretched(cone: EchoCone) -> EchoCone:
    return replace(cone, ranges_m=cone.ranges_m / np.float32(0.95))


def test_an_honest_robot_is_where_it_says(cones: Cones, others: LeaveOneOutMap) -> None:
    assert explained(cones[ODD], others) is None


@pytest.mark.parametrize(
    ("change", "kind", "x"),
    [
        (lambda own: [at(cone, turned_rad=-1.4) for cone in own], "turned", 1.4),
        (lambda own: [stretched(cone) for cone in own], "scaled", 0.95),
        (late, "late", 1.0),
        (lambda own: [at(cone, 0.8, -0.6) for cone in own], "moved", -0.8),
    ],
)
def test_what_is_wrong_with_it_is_told(
    cones: Cones,
    others: LeaveOneOutMap,
    change: Callable[[list[EchoCone]], list[EchoCone]],
    kind: str,
    x: float,
) -> None:
    found = explained(change(cones[ODD]), others)
    assert found is not None
    assert found.by.kind == kind
    assert found.by.x == pytest.approx(x, abs=0.01 if kind != "turned" else 0.2)


def test_where_nothing_is_to_be_heard_nothing_is_told(cones: Cones, others: LeaveOneOutMap) -> None:
    far = [at(cone, 100.0) for cone in cones[ODD]]
    assert explained(far, others) is None
