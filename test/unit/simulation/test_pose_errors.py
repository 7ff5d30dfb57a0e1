"""Errors of poses: each ping's own, or a bias that wanders."""

import numpy as np
import pytest

from usmap_ros.simulation import Scenario, simulate
from usmap_ros.simulation.robot import PoseErrors

SEED = np.random.SeedSequence(5)


def test_without_memory_each_error_is_new() -> None:
    errors = PoseErrors(SEED, 0.0)
    drawn = np.array([errors.at(0.1 * ping) for ping in range(4000)])
    assert drawn.std(axis=0) == pytest.approx(1.0, abs=0.05)
    assert abs(np.corrcoef(drawn[:-1, 0], drawn[1:, 0])[0, 1]) < 0.05


def test_a_bias_wanders_and_is_forgotten_in_its_time() -> None:
    errors = PoseErrors(SEED, 2.0)
    drawn = np.array([errors.at(0.1 * ping) for ping in range(40_000)])
    assert drawn.std(axis=0) == pytest.approx(1.0, abs=0.1)
    for seconds in (0.1, 2.0):
        lag = round(seconds / 0.1)
        memory = np.mean(drawn[:-lag] * drawn[lag:])
        assert memory == pytest.approx(np.exp(-seconds / 2.0), abs=0.1)


def test_a_clock_that_is_set_back_leaves_the_error_as_it_is() -> None:
    errors = PoseErrors(SEED, 2.0)
    before = errors.at(10.0)
    np.testing.assert_array_equal(errors.at(3.0), before)
    assert not np.array_equal(errors.at(4.0), before)


def reported(wander_s: float) -> list[tuple[str, np.ndarray]]:
    """Where two transducers of a robot that stands still say that they are."""
    content = {
        "duration_s": 2.0,
        "world": {"area_m": [0.0, 4.0, 0.0, 4.0], "points": [{"x_m": 3.0, "y_m": 2.0}]},
        "robots": [
            {
                "name": "robot1",
                "motion": {"kind": "waypoints", "waypoints_m": [[1.0, 2.0]]},
                "pose_error": {"position_std_m": 0.1, "wander_s": wander_s},
                "transducers": [{"name": "left"}, {"name": "right"}],
            }
        ],
    }
    traces = simulate(Scenario.from_mapping(content, "still.yaml"))
    return [(topic, trace.pose.position_m) for topic, trace in traces]


def test_a_wandering_bias_is_the_robots_and_not_each_transducers() -> None:
    def apart_m(wander_s: float) -> float:
        pings = reported(wander_s)
        left, right = (np.array([at for t, at in pings if name in t]) for name in ("left", "right"))
        return float(np.median(np.linalg.norm(left - right, axis=1)))

    assert apart_m(0.0) > 0.05
    assert apart_m(100.0) < 0.02


@pytest.mark.parametrize("drifts", [{}, {"odometry": {}}])
def test_a_pose_may_be_that_of_some_time_before(drifts: dict[str, dict[str, float]]) -> None:
    def places_m(late_s: float) -> np.ndarray:
        robot = {
            "name": "robot1",
            "motion": {
                "kind": "waypoints", "waypoints_m": [[0.5, 1.0], [3.5, 1.0]], "speed_m_s": 0.5
            },
            "pose_error": {"late_s": late_s},
            **drifts,
        }  # fmt: skip
        content = {
            "duration_s": 3.0,
            "world": {"area_m": [0.0, 4.0, 0.0, 4.0], "points": [{"x_m": 3.0, "y_m": 2.0}]},
            "robots": [robot],
        }
        traces = simulate(Scenario.from_mapping(content, "late.yaml"))
        return np.array([trace.pose.position_m[:2] for _, trace in traces])

    right, late = places_m(0.0), places_m(0.2)
    # It pings ten times a second, and was nowhere before it began.
    np.testing.assert_allclose(late[2:], right[:-2], atol=0.02)
    np.testing.assert_allclose(late[0], right[0], atol=0.02)
    assert np.ptp(right, axis=0).max() > 0.5
