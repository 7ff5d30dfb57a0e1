"""What is wrong with a robot's poses is told by what would make them fit."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from usmap_ros.mapping.robot_check.explanations import Comparison, Explanation, displaced
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import ReconstructionParameters
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


def explained(own: list[EchoCone], cones: Cones) -> Explanation:
    """Find what would make the pings of all three fit best."""
    others = [cone for topic, theirs in cones.items() if topic != ODD for cone in theirs]
    return max(Comparison(own, others).explanations(lambda: None), key=lambda one: one.gain)


def at(cone: EchoCone, x_m: float = 0.0, y_m: float = 0.0, turned_rad: float = 0.0) -> EchoCone:
    """Say that a ping came from elsewhere."""
    there_m = cone.pose.position_m[:2] + np.array([x_m, y_m])
    return replace(cone, pose=Pose.planar(*there_m, cone.pose.yaw_rad + turned_rad))


def late(cones: list[EchoCone]) -> list[EchoCone]:
    """Give pings with the poses of a second before."""
    stamps_ns = np.array([cone.stamp_ns for cone in cones])
    before = np.maximum(np.searchsorted(stamps_ns, stamps_ns - 1e9), 0)
    return [replace(cone, pose=cones[i].pose) for cone, i in zip(cones, before, strict=True)]


def test_an_honest_robot_is_where_it_says(cones: Cones) -> None:
    assert not explained(cones[ODD], cones).is_sure


@pytest.mark.parametrize(
    ("change", "kind", "x"),
    [
        (lambda own: [at(cone, turned_rad=-1.4) for cone in own], "turned", 1.4),
        (lambda own: [at(cone, turned_rad=0.35) for cone in own], "turned", -0.35),
        (late, "late", 1.0),
        (lambda own: [at(cone, 0.8, -0.6) for cone in own], "moved", -0.8),
    ],
)
def test_what_is_wrong_with_it_is_told(
    cones: Cones, change: Callable[[list[EchoCone]], list[EchoCone]], kind: str, x: float
) -> None:
    found = explained(change(cones[ODD]), cones)
    assert found.is_sure
    assert found.by.kind == kind
    assert found.by.x == pytest.approx(x, abs=0.2)


def test_where_nothing_is_to_be_heard_nothing_is_told(cones: Cones) -> None:
    far = [at(cone, 100.0) for cone in cones[ODD]]
    assert not explained(far, cones).is_sure


@pytest.mark.parametrize("turned_rad", [0.0, 1.4])
def test_a_parked_robot_is_not_judged(cones: Cones, turned_rad: float) -> None:
    """What it says over and over again is said once."""
    parked = [replace(cone, pose=cones[ODD][0].pose) for cone in cones[ODD]]
    turned = [at(cone, turned_rad=turned_rad) for cone in parked]
    assert displaced(cones | {ODD: turned}, lambda: None) == {}


def test_a_way_across_a_continent_takes_no_more_memory(cones: Cones) -> None:
    """Only where it was of late is looked at."""
    own = [at(cone, 1e5 * (index < 20)) for index, cone in enumerate(cones[ODD])]
    assert not explained(own, cones).is_sure
