"""Robots that are carried off while they are on: noticed by what they hear."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from usmap_ros.localisation.pose_kind import PoseKind
from usmap_ros.localisation.refine import Refinement, refine_poses
from usmap_ros.mapping.far_off import Ping
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import PipelineParameters
from usmap_ros.runs.carried_off import moments, with_lives
from usmap_ros.runs.correction import correct_poses
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.runs.submaps import way_of
from usmap_ros.simulation import Scenario, simulate, true_paths

#: Pings that it takes to be sure that a robot was carried off: four blocks.
ENOUGH = 400
FILE = Path(__file__).parents[3] / "config" / "scenarios" / "carried_off.yaml"
Carried = tuple[list[Ping], list[Pose]]


@pytest.fixture(scope="module")
def carried() -> Carried:
    """Give pings of a robot that is carried off, and its true poses."""
    scenario, pipeline = Scenario.from_mapping(yaml.safe_load(FILE.read_text()), FILE), Pipeline()
    pings = [(topic, pipeline.reconstruct(trace)) for topic, trace in simulate(scenario)]
    (path,) = true_paths(scenario).values()
    return pings, [Pose(*place) for place in zip(path.positions_m, path.orientations, strict=True)]


@pytest.fixture(scope="module")
def there(carried: Carried) -> list[Ping]:
    """Give enough of those pings where they truly came from: nobody has carried it off."""
    pairs = zip(*(part[:ENOUGH] for part in carried), strict=True)
    return [(topic, replace(one, pose=pose)) for (topic, one), pose in pairs]


def begins(pings: list[Ping]) -> list[int]:
    """Before which pings a robot was carried off."""
    return moments(pings, way_of(pings, range(len(pings)), PipelineParameters()))


def test_a_robot_that_is_left_alone_goes_on(there: list[Ping]) -> None:
    assert begins(there) == []


def test_a_robot_whose_heading_drifts_goes_on(there: list[Ping]) -> None:
    # Twice to both sides by 10 degrees about the origin: no block agrees with the next one.
    errors_rad = 0.1745 * np.sin(np.linspace(0.0, 4.0 * np.pi, ENOUGH, endpoint=False))
    turned = [
        (topic, replace(one, pose=Pose.planar(0.0, 0.0, float(error)).compose(one.pose)))
        for (topic, one), error in zip(there, errors_rad, strict=True)
    ]
    assert begins(turned) == []


def test_a_robot_whose_first_block_is_off_goes_on(there: list[Ping]) -> None:
    # Only as it sets out: nothing tells that it was there for long.
    off = Pose.planar(0.8, 0.8, -0.4)
    first = [(topic, replace(one, pose=off.compose(one.pose))) for topic, one in there[:100]]
    assert begins([*first, *there[100:]]) == []


@pytest.fixture(scope="module")
def searches() -> dict[tuple[str, ...], Refinement]:
    """Give a place for poses that were searched for, by the frames of the pings' sensors."""
    return {}


@pytest.fixture
def searched_once(
    monkeypatch: pytest.MonkeyPatch, searches: dict[tuple[str, ...], Refinement]
) -> None:
    """Let whoever corrects the same pings go on from the same poses: to find them takes long."""

    def remembered(pings: list[Ping], **of: Any) -> Refinement:
        names = tuple(one.child_frame_id for _, one in pings)
        if names not in searches:
            searches[names] = refine_poses(pings, **of)
        return searches[names]

    monkeypatch.setattr("usmap_ros.runs.correction.refine_poses", remembered)


def test_poses_that_are_absolute_cannot_be_lost(carried: Carried) -> None:
    pings, _ = carried
    kinds = {"robot1": PoseKind.ABSOLUTE}
    done, lost, _ = with_lives(pings, pings, kinds, PipelineParameters())
    assert done == pings
    assert not lost


def off_m(found: list[Ping], true: list[Pose]) -> float:
    """How far places are off at most."""
    pairs = zip(found, true, strict=True)
    return max(
        float(np.hypot(*(one.pose.position_m - real.position_m)[:2])) for (_, one), real in pairs
    )


@pytest.mark.slow
@pytest.mark.usefixtures("searched_once")
def test_it_is_never_joined_wrongly(carried: Carried) -> None:
    pings, true = (part[:ENOUGH] for part in carried)
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
@pytest.mark.usefixtures("searched_once")
def test_it_is_lost_until_then_and_does_not_smear_the_map(
    carried: Carried, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("usmap_ros.runs.frame_matches.match_maps", lambda one, other: None)
    corrected = correct_poses(carried[0][:ENOUGH], PipelineParameters())
    assert {robot: one.state for robot, one in corrected.robots.items()} == {
        "robot1": "alone", "robot1#2": "lost",
    }  # fmt: skip
    frames = [one.frame_id for _, one in corrected.pings]
    begin = frames.index("robot1/odom#2")
    assert abs(begin - 200) < 15
    assert set(frames[begin:]) == {"robot1/odom#2"}
    assert off_m(corrected.pings[:190], carried[1][:190]) < 0.3
