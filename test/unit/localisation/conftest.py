"""Robots among poles whose odometry drifts, and what becomes of it."""

import pytest

from usmap_ros.localisation import Refinement, refine_poses
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.trajectory import Trajectory
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.simulation import Scenario, simulate, true_paths

Ping = tuple[str, EchoCone]


@pytest.fixture(scope="session")
def drifting() -> tuple[list[Ping], dict[str, Trajectory]]:
    """Give pings of three robots whose odometry drifts, and where they really were."""
    wander = {"kind": "random_walk", "speed_m_s": 0.6}
    content = {
        "seed": 6,
        "duration_s": 15.0,
        "world": {
            "area_m": [0.0, 8.0, 0.0, 8.0],
            "random_poles": {"count": 24, "separation_m": 0.5},
        },
        "robots": [
            {"name": f"robot{number}", "motion": wander, "odometry": {}} for number in (1, 2, 3)
        ],
    }
    scenario, pipeline = Scenario.from_mapping(content, "drifting"), Pipeline()
    pings = [(topic, pipeline.reconstruct(trace)) for topic, trace in simulate(scenario)]
    return pings, true_paths(scenario)


@pytest.fixture(scope="session")
def refined(drifting: tuple[list[Ping], dict[str, Trajectory]]) -> Refinement:
    """Give the same pings with corrected poses."""
    return refine_poses(drifting[0])
