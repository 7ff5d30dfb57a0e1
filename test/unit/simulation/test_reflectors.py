"""Balls off the plane and facets that face somewhere."""

import numpy as np
import pytest

from usmap_ros.errors import ConfigurationError
from usmap_ros.simulation import Scenario, simulate
from usmap_ros.simulation.reflectors import EVERYWHERE, Reflectors

PULSE_S = 0.00032
BALL = {"balls": [{"x_m": 2, "y_m": 0, "z_m": 1.5, "reflectivity": 1}]}
#: Gain of the beam falls linearly to 0 at this angle.
EDGE_RAD = 0.6981317


def reflectors(center, radius=0.0, normal=(1.0, 0.0, 0.0), lobe=EVERYWHERE):
    return Reflectors(
        np.array([center], float),
        np.array([radius]),
        np.array([2.0]),
        np.array([normal], float),
        np.array([lobe]),
    )


def heard(world, *, mount=None, **medium):
    """Peak of the envelope, and range of the peak, of one ping at a world."""
    receiver = {"encoding": "envelope", "sample_rate_hz": 500e3, "noise_std": 0.0}
    robot = {
        "name": "robot",
        "motion": {"kind": "random_walk", "start": [0.0, 0.0, 0.0], "speed_m_s": 0.0},
        "transducers": [{"mount": {"z_m": 1.0, **(mount or {})}, "receiver": receiver}],
    }
    scenario = Scenario.from_mapping(
        {
            "duration_s": 0.1,
            "world": {"area_m": [-1, 5, -3, 3], **world},
            "medium": {"sound_speed_m_s": 343.0, "attenuation_db_m": 0.0, **medium},
            "robots": [robot],
        },
        "scenario",
    )
    ((_, trace),) = simulate(scenario)
    peak = int(np.argmax(trace.samples))
    return trace.samples[peak], 0.5 * 343.0 * (trace.sample_times_s()[peak] - 0.5 * PULSE_S)


def test_a_ball_answers_from_its_nearest_point():
    points, strengths = reflectors((3.0, 0.0, 5.0), radius=1.0).answers(np.array([0.0, 0.0, 1.0]))

    np.testing.assert_allclose(np.linalg.norm(points - [0.0, 0.0, 1.0], axis=-1), [4.0])
    np.testing.assert_array_equal(strengths, [2.0])


@pytest.mark.parametrize(
    ("position", "gain"),
    [
        ((3.0, 0.0, 1.0), 1.0),
        ((2.0, np.tan(0.3) * 2.0, 1.0), np.exp(-0.5 * (0.3 / 0.2) ** 2)),
        ((-3.0, 0.0, 1.0), 0.0),
    ],
    ids=["ahead", "off the normal", "behind"],
)
def test_what_a_facet_returns_depends_on_the_angle(position, gain):
    points, strengths = reflectors((0.0, 0.0, np.nan), lobe=0.2).answers(np.array(position))

    assert points[0, 2] == position[2]
    assert strengths[0] == pytest.approx(2.0 * gain)


def test_a_ball_off_the_plane_is_farther_away_and_off_the_axis():
    amplitude, range_m = heard(BALL)

    distance_m = np.hypot(2.0, 0.5)
    assert range_m == pytest.approx(distance_m, abs=2e-3)
    gain = 1.0 - np.arctan2(0.5, 2.0) / EDGE_RAD
    assert amplitude == pytest.approx(gain / distance_m**2, rel=1e-3)


def test_a_transducer_that_is_tilted_towards_it_hears_it_louder():
    elevation = float(np.arctan2(0.5, 2.0))

    amplitude, range_m = heard(BALL, mount={"pitch_rad": -elevation})

    assert range_m == pytest.approx(np.hypot(2.0, 0.5), abs=2e-3)
    assert amplitude == pytest.approx(1.0 / (2.0**2 + 0.5**2), rel=1e-3)
    assert heard(BALL, mount={"pitch_rad": elevation})[0] < 0.5 * amplitude


def test_upright_things_answer_at_the_transducers_height_however_it_is_tilted():
    amplitude, range_m = heard({"points": [{"x_m": 2, "y_m": 0}]}, mount={"pitch_rad": 0.2})

    assert range_m == pytest.approx(2.0, abs=2e-3)
    assert amplitude == pytest.approx((1.0 - 0.2 / EDGE_RAD) / 4.0, rel=1e-3)


def test_roll_about_the_axis_of_a_round_beam_changes_nothing():
    world = {"points": [{"x_m": 2, "y_m": 0.4}]}
    assert heard(world, mount={"roll_rad": 1.0}) == pytest.approx(heard(world))


def test_a_ball_on_the_floor_is_no_farther_over_the_floor():
    # All four paths have one length: they add up.
    world = {"balls": [{"x_m": 2, "y_m": 0, "z_m": 0.0, "reflectivity": 1}]}

    amplitude, _ = heard(world, floor_reflectivity=1.0)

    assert amplitude == pytest.approx(4.0 * heard(world)[0], rel=1e-5)


def test_a_large_ball_returns_half_its_radius():
    world = {"balls": [{"x_m": 2.5, "y_m": 0, "z_m": 1.0, "radius_m": 0.5}]}
    amplitude, range_m = heard(world)

    assert range_m == pytest.approx(2.0, abs=2e-3)
    assert amplitude == pytest.approx(0.25 / 4.0, rel=1e-3)


def test_a_ball_that_returns_nothing_is_refused():
    with pytest.raises(ConfigurationError, match="reflectivity: is needed"):
        heard({"balls": [{"x_m": 2, "y_m": 0, "z_m": 1.0}]})
