"""Three robots among poles, and what is said of robots by what they heard."""

from functools import cache

from usmap_ros.mapping.robot_check.consistency import Consistency
from usmap_ros.mapping.robot_check.finding import Finding
from usmap_ros.parameters import MappingParameters, ReconstructionParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.reconstruction.reconstructor import reconstruct
from usmap_ros.simulation import Scenario, simulate


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
    """Judge the robots by their pings."""
    consistency = Consistency(MappingParameters())
    for topic, cone in pings:
        consistency.add(topic, cone)
    return consistency.findings()
