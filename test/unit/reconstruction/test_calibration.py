"""Sound speed and floor from echoes."""

from dataclasses import replace

import numpy as np
import pytest

from usmap_ros.acoustics.propagation import Channel
from usmap_ros.errors import UsmapError
from usmap_ros.geometry import Pose
from usmap_ros.reconstruction.calibration import calibrate

POLES = [(1.5, 0.5), (2.4, -0.6), (3.4, 0.6)]
STRENGTHS = [0.4, 0.7, 1.2]


def drive(hear, true, stated, pings=20, noise_std=0.002, step_m=0.05):
    traces = []
    for number in range(pings):
        pose = Pose.planar(step_m * number, 0.05 * np.sin(0.3 * number), 0.1 - 0.01 * number)
        trace = hear(POLES, STRENGTHS, channel=true, noise_std=noise_std, pose=pose, seed=number)
        traces.append(replace(trace, channel=stated))
    return traces


@pytest.mark.parametrize("sound_speed", [332.0, 349.0, 354.0])
@pytest.mark.parametrize("height_m", [0.35, 0.6])
def test_recording_tells_speed_and_floor(hear, sound_speed, height_m):
    true = Channel(sound_speed, 0.8, floor_height_m=height_m, floor_reflectivity=0.4)
    stated = Channel(343.0, 0.8, floor_height_m=0.5, floor_reflectivity=0.9)
    found = calibrate(drive(hear, true, stated))

    assert found.sound_speed_m_s == pytest.approx(sound_speed, rel=2e-3)
    assert found.floor_height_m == pytest.approx(height_m, abs=0.003)
    assert found.floor_reflectivity == pytest.approx(0.4, abs=0.04)
    assert found.attenuation_db_m == 0.8


def test_no_floor_is_found_where_there_is_none(hear):
    found = calibrate(drive(hear, Channel(346.0), Channel(343.0, 0.0, 0.5, 0.9)))

    assert found.floor_height_m == 0.0
    assert found.sound_speed_m_s == pytest.approx(346.0, rel=1e-3)


def test_robot_that_stands_still_cannot_tell_the_speed(hear):
    trace = hear(POLES, STRENGTHS, noise_std=0.002)
    with pytest.raises(UsmapError, match="enough places"):
        calibrate([trace] * 20)


def test_silence_cannot_tell_the_speed(hear):
    with pytest.raises(UsmapError, match="enough places"):
        calibrate([hear([], noise_std=0.01, seed=seed) for seed in range(10)])
