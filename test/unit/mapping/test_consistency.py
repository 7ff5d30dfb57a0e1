"""Robots that lie are named, and honest ones are not."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from usmap_ros.cone import EchoCone
from usmap_ros.geometry import Pose
from usmap_ros.mapping.consistency import Consistency, Finding, is_of
from usmap_ros.mapping.superposition.fusion import SuperpositionFusion
from usmap_ros.parameters import MappingParameters, ReconstructionParameters
from usmap_ros.reconstruction.reconstructor import reconstruct
from usmap_ros.simulation import Scenario, simulate
from usmap_ros.trace import EchoTrace

LIAR = "/robot2/echo"


@cache
def traces(seed: int) -> list[tuple[str, EchoTrace]]:
    """Give the pings of three robots among poles."""
    motion = {"kind": "random_walk", "speed_m_s": 1.5, "clearance_m": 0.2}
    content = {
        "description": "poles",
        "seed": seed,
        "duration_s": 5.0,
        "world": {
            "area_m": [0.0, 5.0, 0.0, 5.0],
            "random_poles": {"count": 14, "separation_m": 0.5, "reflectivity_spread": 0.35},
        },
        "medium": {"sound_speed_m_s": 343.0, "attenuation_db_m": 0.0},
        "robots": [{"name": f"robot{number}", "motion": motion} for number in (1, 2, 3)],
    }
    return list(simulate(Scenario.from_mapping(content, "poles")))


@cache
def cones(seed: int) -> list[tuple[str, EchoCone]]:
    """Give the same as cones."""
    return [
        (topic, reconstruct(trace, ReconstructionParameters()).cone)
        for topic, trace in traces(seed)
    ]


def findings(pings: list[tuple[str, EchoCone]]) -> dict[str, Finding]:
    """Map pings, and judge the robots."""
    parameters = MappingParameters()
    fusion, consistency = SuperpositionFusion(parameters), Consistency(parameters)
    for topic, cone in pings:
        fusion.fuse(cone)
        consistency.add(topic, cone)
    return consistency.findings(fusion.expected_by_others)


def of_samples(seed: int, factor: float, noise: float) -> list[tuple[str, EchoCone]]:
    """Give cones of which the liar's samples are scaled, and have further noise."""
    rng = np.random.default_rng(seed)
    changed = []
    for (topic, trace), (_, cone) in zip(traces(seed), cones(seed), strict=True):
        heard = cone
        if topic == LIAR:
            more = noise * trace.noise_std * rng.standard_normal(len(trace.samples))
            samples = (factor * trace.samples + more).astype(np.float32)
            heard = reconstruct(replace(trace, samples=samples), ReconstructionParameters()).cone
        changed.append((topic, heard))
    return changed


def displaced(cone: EchoCone, turned_rad: float) -> EchoCone:
    """Say that a ping came from elsewhere."""
    x_m, y_m = cone.pose.position_m[:2]
    pose = Pose.planar(x_m + 0.2, y_m - 0.25, cone.pose.yaw_rad + turned_rad)
    return replace(cone, pose=pose)


def named(found: dict[str, Finding]) -> dict[str, str]:
    """Verdicts on those that are suspected."""
    return {topic: finding.verdict for topic, finding in found.items() if finding.is_suspect}


@pytest.mark.parametrize("seed", [11, 12])
def test_honest_robots_are_not_suspected(seed: int) -> None:
    """And there is something to go by."""
    found = findings(cones(seed))

    assert named(found) == {}
    assert any(finding.verdict == "healthy" for finding in found.values())


@pytest.mark.slow
@pytest.mark.parametrize(("factor", "noise", "verdict"), [(0.05, 0.0, "deaf")])
def test_one_that_hears_too_little_or_too_much_is_named(
    factor: float, noise: float, verdict: str
) -> None:
    assert named(findings(of_samples(11, factor, noise))) == {LIAR: verdict}


def test_one_that_repeats_itself_while_it_moves_is_named() -> None:
    first = next(cone for topic, cone in cones(11) if topic == LIAR and len(cone.ranges_m))
    pings = [
        (topic, replace(first, stamp_ns=cone.stamp_ns, pose=cone.pose) if topic == LIAR else cone)
        for topic, cone in cones(11)
    ]

    assert named(findings(pings)) == {LIAR: "stuck"}


@pytest.mark.parametrize("turned_rad", [0.0, 0.35])
def test_one_that_is_elsewhere_is_named(turned_rad: float) -> None:
    pings = [
        (topic, displaced(cone, turned_rad) if topic == LIAR else cone) for topic, cone in cones(11)
    ]

    found = findings(pings)

    assert named(found) == {LIAR: "misplaced"}
    assert found[LIAR].summary()["evidence"]["fit"] < 0.5
    assert "misplaced" in found[LIAR].reason


def test_of_two_that_contradict_each_other_both_are_named() -> None:
    pings = [
        (topic, displaced(cone, 0.0) if topic == LIAR else cone)
        for topic, cone in cones(11)
        if topic != "/robot3/echo"
    ]

    verdicts = named(findings(pings))

    assert set(verdicts.values()) <= {"misplaced"}
    assert len(verdicts) in (0, 2)


def test_a_robot_alone_is_not_judged() -> None:
    found = findings([(topic, cone) for topic, cone in cones(11) if topic == LIAR])

    assert {finding.verdict for finding in found.values()} == {"unknown"}


def test_names_stand_for_topics_and_robots() -> None:
    assert is_of("/robot2/left/echo", ["robot2"])
    assert is_of("/robot2/left/echo", ["/robot2/left/echo"])
    assert is_of("/robot2/left/echo", ["robot1", "/robot2/left"])
    assert not is_of("/robot21/echo", ["robot2"])
    assert not is_of("/robot2/echo", ["", "/"])
