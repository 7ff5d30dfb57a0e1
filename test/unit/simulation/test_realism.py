"""Switches by which the simulator does what real hardware and rooms do."""

import copy

import numpy as np
import pytest

from usmap_ros.simulation import Scenario, simulate

ROBOT = {
    "name": "robot1",
    "motion": {"kind": "waypoints", "waypoints_m": [[0.0, 0.0], [0.4, 0.0]], "speed_m_s": 0.5},
    "transducers": [{"receiver": {"noise_std": 0.0}}],
}
CONTENT = {
    "seed": 3,
    "duration_s": 0.2,
    "world": {"area_m": [-3, 3, -3, 3], "points": [{"x_m": 1.5, "y_m": 0.2}]},
    "medium": {"sound_speed_m_s": 343.0, "attenuation_db_m": 0.0},
    "robots": [ROBOT],
}
RATE_HZ = 25e3


def recorded(*, receiver=None, world=None, medium=None, robot=None, **scenario):
    """Traces of a scenario with some switches turned."""
    content = copy.deepcopy(CONTENT) | scenario
    content["world"] |= world or {}
    content["medium"] |= medium or {}
    content["robots"][0] |= robot or {}
    content["robots"][0]["transducers"][0]["receiver"] |= receiver or {}
    return [trace for _, trace in simulate(Scenario.from_mapping(content, "test"))]


def loud_at(trace, share=0.5):
    """Half the way (m) to where a trace is loud."""
    magnitude = np.abs(trace.signal())
    return 171.5 * np.flatnonzero(magnitude > share * magnitude.max()) / RATE_HZ


def test_gain_and_offset_are_in_the_samples():
    plain, (scaled, *_) = recorded()[0], recorded(receiver={"gain": 300.0, "offset": 7.0})
    assert scaled.samples == pytest.approx(300.0 * plain.samples + 7.0, abs=1e-3)


def test_latency_delays_echoes():
    plain, late = recorded()[0], recorded(receiver={"latency_s": 0.0004})[0]
    assert np.abs(late.signal())[10:] == pytest.approx(np.abs(plain.signal())[:-10], abs=1e-6)


def test_transmitter_rings_and_blanking_silences_it():
    ring = {"ring_down": {"amplitude": 5.0, "decay_s": 0.0003}}
    ringing = recorded(receiver=ring)[0]
    blanked = recorded(receiver=ring | {"blanking_s": 0.002})[0]

    assert np.abs(ringing.signal()[4]) == pytest.approx(5.0)
    decay = np.abs(ringing.signal()[20] / ringing.signal()[30])
    assert decay == pytest.approx(np.exp(10 / RATE_HZ / 0.0003), rel=0.01)
    assert np.abs(blanked.signal()[:50]).max() < 0.2


def test_receiver_mutes_itself_behind_what_it_detects():
    behind = {"points": [{"x_m": 1.5, "y_m": 0.2}, {"x_m": 2.5, "y_m": 0.0}]}
    muting = {"muting": {"threshold": 0.05, "hold_s": 0.001}}
    open_, muted = recorded(world=behind)[0], recorded(world=behind, receiver=muting)[0]

    assert loud_at(open_, 0.2).max() > 2.4
    assert loud_at(muted, 0.2).max() < 1.7


def test_motion_during_a_ping_shortens_the_way_back():
    still, moved = (
        recorded(robot={"moves_during_ping": one, "motion": ROBOT["motion"] | {"speed_m_s": 5.0}})[
            0
        ]
        for one in (False, True)
    )
    way_m = np.hypot(1.5, 0.2)
    shift_m = 0.5 * 5.0 * 2.0 * way_m / 343.0
    turned = np.angle(np.vdot(still.signal(), moved.signal()))
    expected = 2.0 * np.pi * 50e3 * 2.0 * shift_m * (1.5 / way_m) / 343.0

    assert np.exp(1j * turned) == pytest.approx(np.exp(1j * expected), abs=0.4)
    assert not np.allclose(still.samples, moved.samples)


def test_warming_air_quickens_sound():
    drift = recorded(duration_s=10.0, medium={"temperature_drift_c_s": 0.5},
                     robot={"motion": ROBOT["motion"] | {"speed_m_s": 0.0}})  # fmt: skip
    first_m, last_m = (loud_at(trace).mean() for trace in (drift[0], drift[-1]))

    assert last_m / first_m == pytest.approx(1.0 - 0.5 * 9.9 * 0.5 / 293.15, abs=0.002)
    assert drift[-1].channel.sound_speed_m_s == 343.0


def test_robots_hear_each_other_only_with_crosstalk():
    other = copy.deepcopy(ROBOT) | {"name": "robot2"}
    other["motion"] = ROBOT["motion"] | {"waypoints_m": [[2.0, 0.0], [1.9, 0.0]]}
    alone, apart, together = (
        recorded(robots=robots, crosstalk=crosstalk, world={"points": []})[0]
        for robots, crosstalk in (([ROBOT], True), ([ROBOT, other], False), ([ROBOT, other], True))
    )

    assert not np.any(alone.samples)
    assert not np.any(apart.samples)
    # Sent 1 ms later from 2 m away, once and not there and back.
    assert loud_at(together, 0.9).min() == pytest.approx(0.5 * (2.0 + 0.343) + 0.027, abs=0.02)


SMOOTH = {"specular_reflectivity": 0.8, "diffuse_reflectivity": 0.0}


def test_inner_corner_returns_sound_that_neither_wall_does():
    corner = {
        "points": [],
        "surface": SMOOTH,
        "walls": [{"corners_m": [[2.0, -1.0], [2.0, 0.4], [-1.0, 0.4]]}],
    }
    once, twice = recorded(world=corner)[0], recorded(world=corner | {"wall_bounces": 2})[0]
    extra = np.abs(twice.signal() - once.signal())

    at_m = 171.5 * np.argmax(extra) / RATE_HZ
    assert at_m == pytest.approx(np.hypot(2.0, 0.4) + 0.5 * 0.00032 * 171.5, abs=0.02)
    assert extra.max() > 0.01


def test_facing_walls_flutter():
    facing = {
        "points": [],
        "surface": SMOOTH,
        "walls": [
            {"corners_m": [[1.0, -2.0], [1.0, 2.0]]},
            {"corners_m": [[-0.5, 2.0], [-0.5, -2.0]]},
        ],
    }
    plain, fluttering = (recorded(world=facing | {"wall_bounces": count})[0] for count in (1, 3))
    extra = np.abs(fluttering.signal() - plain.signal())

    # To the wall ahead, the one behind, and the one ahead again: 1.0 + 1.5 m.
    assert 171.5 * np.argmax(extra) / RATE_HZ == pytest.approx(2.5 + 0.027, abs=0.03)


def test_edges_answer_where_walls_end():
    wall = {"points": [], "walls": [{"corners_m": [[1.0, 0.3], [2.5, 0.3]]}]}
    surface = {"specular_reflectivity": 0.0, "diffuse_reflectivity": 0.0}
    silent = recorded(world=wall | {"surface": surface})[0]
    heard = recorded(world=wall | {"surface": surface | {"edge_reflectivity": 0.1}})[0]

    assert not np.any(silent.samples)
    assert loud_at(heard, 0.9).mean() == pytest.approx(np.hypot(1.0, 0.3) + 0.027, abs=0.03)


def test_tall_pole_answers_from_its_foot_too():
    mount = {"transducers": [{"mount": {"z_m": 0.8}, "receiver": {"noise_std": 0.0}}]}
    pole = {"points": [{"x_m": 1.2, "y_m": 0.0}]}
    floor = {"floor_reflectivity": 0.6, "floor_model": "corner"}
    (bare, *_), (floored, *_) = (
        recorded(world=pole, robot=mount),
        recorded(world=pole, robot=mount, medium=floor),
    )
    extra = floored.signal()[: len(bare.signal())] - bare.signal()

    assert 171.5 * np.argmax(np.abs(extra)) / RATE_HZ == pytest.approx(
        np.hypot(1.2, 0.8) + 0.027, abs=0.03
    )
