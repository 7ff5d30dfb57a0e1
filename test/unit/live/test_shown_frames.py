"""Where robots' frames are shown: smoothly, but for jumps that are said."""

import numpy as np
import pytest

from usmap_ros.live.shown_frames import JUMP_M, SPEED_M_S, TURN_RAD_S, ShownFrames


def test_a_frame_is_where_it_was_found_at_first() -> None:
    frames = ShownFrames()
    assert frames.aim({"robot1/odom": np.array([1.0, 2.0, 0.5])}) == []
    np.testing.assert_array_equal(frames.shown["robot1/odom"], [1.0, 2.0, 0.5])


def test_a_frame_moves_at_a_bounded_rate_and_arrives() -> None:
    frames = ShownFrames()
    frames.aim({"a": np.array([0.0, 0.0, 3.1])})
    target = np.array([0.3, -0.2, -3.0])
    assert frames.aim({"a": target}) == []
    before = frames.shown["a"]
    for _ in range(40):
        frames.step(0.1)
        moved = frames.shown["a"] - before
        assert np.hypot(*moved[:2]) <= 0.1 * SPEED_M_S + 1e-9
        assert abs(moved[2]) <= 0.1 * TURN_RAD_S + 1e-9
        before = frames.shown["a"]
    np.testing.assert_allclose(before[:2], target[:2], atol=1e-9)
    assert np.cos(before[2] - target[2]) == pytest.approx(1.0)


def test_a_frame_that_is_far_off_jumps_and_is_named() -> None:
    frames = ShownFrames()
    frames.aim({"a": np.zeros(3), "b": np.zeros(3)})
    assert frames.aim({"a": np.array([JUMP_M + 0.1, 0.0, 0.0]), "b": np.zeros(3)}) == ["a"]
    assert frames.shown["a"][0] == JUMP_M + 0.1


def test_a_frame_that_is_no_more_known_is_not_shown() -> None:
    frames = ShownFrames()
    frames.aim({"a": np.zeros(3)})
    frames.aim({})
    frames.step(0.1)
    assert frames.shown == {}
