"""Robots that are carried off while they are on: noticed by what they hear."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from usmap_ros.localisation.pose_kind import PoseKind
from usmap_ros.mapping.far_off import Ping
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import PipelineParameters
from usmap_ros.runs.carried_off import moments, with_lives
from usmap_ros.runs.correction import correct_poses
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.simulation import Scenario, simulate, true_paths

FILE = Path(__file__).parents[3] / "config" / "scenarios" / "carried_off.yaml"
Carried = tuple[list[Ping], list[Pose]]


@pytest.fixture(scope="module")
def carried() -> Carried:
    """Give pings of a robot that is carried off, and its true poses."""
    scenario, pipeline = Scenario.from_mapping(yaml.safe_load(FILE.read_text()), FILE), Pipeline()
    pings = [(topic, pipeline.reconstruct(trace)) for topic, trace in simulate(scenario)]
    (path,) = true_paths(scenario).values()
    return pings, [Pose(*place) for place in zip(path.positions_m, path.orientations, strict=True)]


def test_a_robot_that_is_left_alone_goes_on(carried: Carried) -> None:
    there = [(topic, replace(one, pose=pose)) for (topic, one), pose in zip(*carried, strict=True)]
    assert moments(there, PipelineParameters()) == []


def test_a_robot_whose_heading_drifts_goes_on(carried: Carried) -> None:
    pings, true = carried
    # Twice to both sides by 10 degrees about the origin: no block agrees with the next one.
    errors_rad = 0.1745 * np.sin(np.linspace(0.0, 4.0 * np.pi, len(pings), endpoint=False))
    there = [
        (topic, replace(one, pose=Pose.planar(0.0, 0.0, float(error)).compose(pose)))
        for (topic, one), pose, error in zip(pings, true, errors_rad, strict=True)
    ]
    assert moments(there, PipelineParameters()) == []


def test_a_robot_whose_first_block_is_off_goes_on(carried: Carried) -> None:
    pings, true = carried
    # Only as it sets out: nothing tells that it was there for long.
    off = Pose.planar(0.8, 0.8, -0.4)
    there = [
        (topic, replace(one, pose=off.compose(pose) if number < 100 else pose))
        for number, ((topic, one), pose) in enumerate(zip(pings, true, strict=True))
    ]
    assert moments(there, PipelineParameters()) == []


def test_poses_that_are_absolute_cannot_be_lost(carried: Carried) -> None:
    pings, _ = carried
    kinds = {"robot1": PoseKind.ABSOLUTE}
    done, lost = with_lives(pings, pings, kinds, PipelineParameters())
    assert done == pings
    assert not lost


def off_m(found: list[Ping], true: list[Pose]) -> float:
    """How far places are off at most."""
    pairs = zip(found, true, strict=True)
    return max(
        float(np.hypot(*(one.pose.position_m - real.position_m)[:2])) for (_, one), real in pairs
    )


@pytest.mark.slow
def test_it_is_never_joined_wrongly(carried: Carried) -> None:
    pings, true = carried
    corrected = correct_poses(pings, PipelineParameters())
    begin = [one.child_frame_id for _, one in corrected.pings].index("robot1#2/sonar")
    assert abs(begin - 200) < 15
    # In between it is in somebody's hands.
    assert off_m(corrected.pings[:190], true[:190]) < 0.3
    if corrected.robots["robot1#2"].state == "joined":
        assert off_m(corrected.pings[215:], true[215:]) < 0.3
    else:
        assert {one.frame_id for _, one in corrected.pings[begin:]} == {"robot1/odom#2"}


@pytest.mark.slow
def test_it_is_lost_until_then_and_does_not_smear_the_map(
    carried: Carried, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("usmap_ros.runs.frame_matches.match_maps", lambda one, other: None)
    # As many as it takes to be sure that it was carried off.
    corrected = correct_poses(carried[0][:400], PipelineParameters())
    assert {robot: one.state for robot, one in corrected.robots.items()} == {
        "robot1": "alone", "robot1#2": "lost",
    }  # fmt: skip
    frames = [one.frame_id for _, one in corrected.pings]
    begin = frames.index("robot1/odom#2")
    assert abs(begin - 200) < 15
    assert set(frames[begin:]) == {"robot1/odom#2"}
    assert off_m(corrected.pings[:190], carried[1][:190]) < 0.3
