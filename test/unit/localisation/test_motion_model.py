"""Poses that are off by chance, by how steadily a robot moves."""

import numpy as np
import pytest

from usmap_ros.localisation.motion_model import smoothed
from usmap_ros.numerics.arrays import FloatArray

STD_M, STD_RAD, STEP_S = 0.03, 0.01, 0.1
STATED = np.diag([STD_M**2, STD_M**2, STD_RAD**2])


def drive(turns_rad: FloatArray, speeds_m_s: FloatArray) -> FloatArray:
    """Give the poses of a robot that drives where it faces midway of each step."""
    yaw_rad = np.concatenate([[0.3], 0.3 + np.cumsum(turns_rad)])
    midway_rad = 0.5 * (yaw_rad[1:] + yaw_rad[:-1])
    steps_m = STEP_S * speeds_m_s * np.stack([np.cos(midway_rad), np.sin(midway_rad)])
    x_m, y_m = np.concatenate([np.zeros((2, 1)), np.cumsum(steps_m, axis=1)], axis=1)
    return np.column_stack([x_m, y_m, yaw_rad])


def winding(speeds_m_s: FloatArray, seed: int = 3) -> FloatArray:
    """Give the same of one that turns by chance, by some 8° a step."""
    turns_rad = np.random.default_rng(seed).normal(scale=0.15, size=len(speeds_m_s))
    return drive(turns_rad, speeds_m_s)


def told_of(true: FloatArray, seed: int = 5) -> FloatArray:
    """Give poses that are off by chance."""
    errors = np.random.default_rng(seed).normal(size=true.shape)
    return np.asarray(true + errors * [STD_M, STD_M, STD_RAD])


def stamps_of(told: FloatArray) -> FloatArray:
    """Give when they were told."""
    return np.asarray(STEP_S * np.arange(len(told)), np.float64)


def smooth(told: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Smooth poses told ten times a second."""
    return smoothed(stamps_of(told), told, np.tile(STATED, (len(told), 1, 1)))


def off_m(poses: FloatArray, true: FloatArray) -> float:
    """Give the error of each coordinate, root mean square."""
    return float(np.sqrt(np.mean((poses - true)[:, :2] ** 2)))


def stated_m(known: FloatArray) -> float:
    """Give what is stated of it."""
    return float(np.sqrt(0.5 * np.mean(known[:, 0, 0] + known[:, 1, 1])))


STEADY = np.full(249, 0.8)


@pytest.mark.parametrize(
    "speeds_m_s",
    [
        STEADY,
        np.repeat([0.0, 0.8, 0.0, 0.5], [80, 60, 50, 59]),
    ],
    ids=["steady", "starts and stops"],
)
def test_who_drives_where_it_faces_is_where_it_would_have_come_to(speeds_m_s: FloatArray) -> None:
    """However it turns; and it is said how far that is off."""
    true = winding(speeds_m_s)
    poses, known = smooth(told_of(true))
    assert off_m(poses, true) < 0.45 * STD_M
    assert 0.6 < off_m(poses, true) / stated_m(known) < 1.5


def test_what_moves_anywhere_goes_on_as_it_did() -> None:
    """As a drone does, that faces wherever it likes."""
    true = drive(np.full(249, 0.02), STEADY)
    true[:, 2] = np.random.default_rng(1).uniform(-3.0, 3.0, len(true))
    poses, known = smooth(told_of(true))
    assert off_m(poses, true) < 0.5 * STD_M
    assert 0.6 < off_m(poses, true) / stated_m(known) < 1.5


def test_errors_that_wander_are_not_smoothed_away() -> None:
    """They look like motion, and are stated as large as they were."""
    true = winding(STEADY)
    rng, wandering_m, share = np.random.default_rng(2), np.zeros(2), np.exp(-STEP_S / 5.0)
    told = told_of(true)
    for row in range(len(told)):
        wandering_m = share * wandering_m + rng.normal(size=2) * STD_M * np.sqrt(1.0 - share**2)
        told[row, :2] = true[row, :2] + wandering_m
    poses, known = smooth(told)
    assert stated_m(known) > 0.95 * STD_M
    assert np.abs(poses - told)[:, :2].max() < 0.5 * STD_M


def test_headings_of_who_drives_straight_are_smoothed() -> None:
    true = drive(np.zeros(249), STEADY)
    told = told_of(true)
    poses, known = smooth(told)
    assert np.std(poses[:, 2]) < 0.4 * np.std(told[:, 2])
    assert known[:, 2, 2].max() < 0.4 * STD_RAD**2


def test_headings_of_who_turns_as_it_likes_stay_as_told() -> None:
    told = told_of(winding(STEADY))
    poses, known = smooth(told)
    np.testing.assert_allclose(poses[:, 2], np.angle(np.exp(1j * told[:, 2])), atol=0.02)
    assert known[:, 2, 2].min() > 0.7 * STD_RAD**2


def test_which_frame_poses_are_told_in_does_not_matter() -> None:
    told, turn_rad, shift_m = told_of(winding(STEADY)), 2.1, np.array([300.0, -40.0])
    turn = np.array([[np.cos(turn_rad), -np.sin(turn_rad)], [np.sin(turn_rad), np.cos(turn_rad)]])
    elsewhere = np.column_stack([told[:, :2] @ turn.T + shift_m, told[:, 2] + turn_rad])
    poses, known = smooth(told)
    turned, as_known = smooth(elsewhere)
    np.testing.assert_allclose(turned[:, :2], poses[:, :2] @ turn.T + shift_m, atol=1e-6)
    np.testing.assert_allclose(as_known, known, rtol=1e-6)


def test_who_is_told_worse_counts_less() -> None:
    """One ping in five is off by six times as much, and says so."""
    true = winding(STEADY)
    told, is_bad = told_of(true), np.arange(len(true)) % 5 == 2
    told[is_bad, :2] += 6.0 * (told - true)[is_bad, :2]
    stated = np.tile(STATED, (len(told), 1, 1))
    stated[is_bad, :2, :2] *= 49.0
    poses, _ = smoothed(stamps_of(told), told, stated)
    assert off_m(poses, true) < 0.4 * STD_M


@pytest.mark.parametrize("variance_m2", [STD_M**2, 0.0])
def test_few_pings_and_those_that_are_certain_stay_as_told(variance_m2: float) -> None:
    count = 11 if variance_m2 else 50
    told = told_of(winding(STEADY))[:count]
    stated = np.tile(STATED, (count, 1, 1))
    stated[3, :2, :2] = variance_m2 * np.eye(2)
    poses, known = smoothed(stamps_of(told), told, stated)
    np.testing.assert_array_equal(poses, told)
    np.testing.assert_array_equal(known, stated)
