"""Pings, one by one, and whole scenarios."""

import hashlib
import os
import subprocess
import sys

import numpy as np
import pytest
from scipy.stats import kstest

from usmap_ros.acoustics.propagation import Channel
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.trace import Encoding
from usmap_ros.simulation import EchoSimulator, Scenario, simulate
from usmap_ros.simulation.robot import ping_count
from usmap_ros.simulation.simulator import reported_pose

HOME = Pose.planar(0.0, 0.0, 0.0)
CONTENT = {
    "duration_s": 0.5,
    "world": {"area_m": [0, 4, 0, 4], "random_poles": {"count": 5}},
    "robots": [{"name": "robot1"}, {"name": "robot2"}],
}


def ping(world, transducer, pose=HOME, *, stamp_ns=0, seed=0, start_ns=0):
    simulator = EchoSimulator(world, "map", start_ns)
    return simulator.ping(transducer, pose, stamp_ns, np.random.default_rng(seed))


def scenario(**changes):
    return Scenario.from_mapping(CONTENT | changes, "scenario.yaml")


def test_unit_target_on_axis_at_a_metre_peaks_at_one(scene, points, sonar):
    trace = ping(scene(points((1, 0))), sonar(Encoding.ENVELOPE, rate=1e6))
    assert trace.samples.max() == pytest.approx(1.0, abs=1e-5)


def test_amplitude_is_reflectivity_times_gain_over_range_squared(scene, points, sonar):
    bearing = np.deg2rad(20.0)
    target = 2.5 * np.array([np.cos(bearing), np.sin(bearing)])
    trace = ping(scene(points(target, reflectivity=0.8)), sonar(Encoding.ENVELOPE, rate=1e6))
    assert trace.samples.max() == pytest.approx(0.8 * 0.5 / 2.5**2, rel=1e-5)


def test_delay_is_exact_below_a_sample(scene, points, sonar):
    for range_m in (1.0, 1.0001, 1.0003):
        trace = ping(scene(points((range_m, 0))), sonar())
        expected = np.exp(-2j * np.pi * 50_000.0 * 2.0 * range_m / 343.0)
        signal = trace.signal()
        strongest = signal[np.argmax(np.abs(signal))]
        assert strongest / np.abs(strongest) == pytest.approx(expected, abs=1e-4)


def test_a_trace_says_where_and_how_it_was_taken(scene, points, sonar):
    pose = Pose.planar(1.0, 2.0, 0.5, 0.3)
    transducer = sonar(noise=0.01)
    trace = ping(scene(points((1, 0))), transducer, pose, stamp_ns=1_700_000_000_123_456_789)
    trace.validate()
    assert trace.stamp_ns == 1_700_000_000_123_456_789
    assert (trace.frame_id, trace.child_frame_id) == ("map", "robot1/sonar")
    np.testing.assert_allclose(trace.pose.position_m, [1.0, 2.0, 0.3])
    assert trace.pose.yaw_rad == pytest.approx(0.5)
    assert not trace.pose.covariance.any()
    assert trace.transducer is transducer.transducer
    assert trace.noise_std == 0.01
    # One pulse length beyond the end of an echo from 5 m.
    assert trace.sample_times_s()[-1] == pytest.approx(10.0 / 343.0 + 0.00064, abs=1 / 25_000.0)


def test_the_floor_adds_its_paths(scene, points, sonar):
    floor = Channel(343.0, 0.0, 0.5, 0.6)
    trace = ping(scene(points((2, 0))), sonar(Encoding.ENVELOPE, rate=1e6, channel=floor))
    direct, via_floor = 2.0, np.sqrt(5.0)
    for length, amplitude in [
        (2 * direct, 1 / direct**2),
        (direct + via_floor, 2 * 0.6 / (direct * via_floor)),
        (2 * via_floor, 0.36 / via_floor**2),
    ]:
        peak = trace.samples[round((length / 343.0 + 0.00016) * 1e6)]
        assert peak == pytest.approx(amplitude, rel=1e-3)


def test_what_is_stated_may_differ_from_what_is(scene, points, sonar):
    stated = Channel(350.0, 0.5, 0.4, 0.2)
    transducer = sonar(channel=Channel(343.0), stated_channel=stated, stated_noise_std=0.0)
    trace = ping(scene(points((1, 0))), transducer)
    assert trace.channel == stated
    assert trace.noise_std == 0.0
    honest = ping(scene(points((1, 0))), sonar())
    np.testing.assert_array_equal(trace.samples, honest.samples)


def test_moving_objects_start_with_the_scene(scene, sonar):
    world = Scenario.from_mapping(
        {
            "world": {
                "area_m": [0, 9, -5, 5],
                "moving": [
                    {
                        "waypoints_m": [[1, 0], [4, 0]],
                        "speed_m_s": 1.0,
                        "loop": False,
                        "radius_m": 0,
                    }
                ],
            },
            "robots": [{"name": "robot1"}],
        },
        "moving.yaml",
    ).scene()
    start = 1_700_000_000 * 10**9
    trace = ping(world, sonar(Encoding.ENVELOPE), stamp_ns=start + 10**9, start_ns=start)
    heard_at = trace.sample_times_s()[np.argmax(trace.samples)]
    assert 343.0 * (heard_at - 0.00016) / 2.0 == pytest.approx(2.0, abs=0.01)


def test_pose_errors_have_the_covariance_that_is_stated():
    stds, rng = np.array([0.03, 0.05, 0.01]), np.random.default_rng(4)
    true = Pose.planar(1.0, -2.0, 3.1, 0.5)
    squares = []
    for _ in range(3000):
        reported = reported_pose(true, stds, rng.standard_normal(3))
        np.testing.assert_allclose(reported.planar_covariance, np.diag(stds**2))
        yaw_error = np.angle(np.exp(1j * (reported.yaw_rad - true.yaw_rad)))
        error = np.array([*(reported.position_m - true.position_m)[:2], yaw_error])
        squares.append(error @ np.linalg.solve(reported.planar_covariance, error))
        assert reported.position_m[2] == 0.5
    assert kstest(squares, "chi2", args=(3,)).pvalue > 0.01


@pytest.mark.parametrize("hash_seed", ["1", "2"])
def test_the_order_of_hashes_does_not_matter(hash_seed):
    script = (
        "import hashlib; from usmap_ros.simulation import *;"
        f"pings = simulate(Scenario.from_mapping({CONTENT}, 'scenario.yaml'));"
        "samples = b''.join(trace.samples.tobytes() for _, trace in pings);"
        "print(hashlib.sha256(samples).hexdigest())"
    )
    environment = os.environ | {"PYTHONHASHSEED": hash_seed}
    there = subprocess.run(
        [sys.executable, "-c", script], env=environment, check=True, capture_output=True, text=True
    )
    here = b"".join(trace.samples.tobytes() for _, trace in simulate(scenario()))
    assert there.stdout.strip() == hashlib.sha256(here).hexdigest()


def test_another_seed_gives_another_world():
    (_, one), (_, other) = next(simulate(scenario())), next(simulate(scenario(seed=2)))
    assert not np.array_equal(one.samples, other.samples)


def test_another_robot_changes_nothing_for_the_others():
    names = [{"name": f"robot{number}"} for number in (1, 2, 3)]
    two = [trace for topic, trace in simulate(scenario(robots=names[:2])) if "robot2" in topic]
    three = [trace for topic, trace in simulate(scenario(robots=names)) if "robot2" in topic]
    for one, other in zip(two, three, strict=True):
        np.testing.assert_array_equal(one.samples, other.samples)


def test_pings_come_in_order_and_none_coincide():
    world = scenario(robots=[{"name": "a", "ping_rate_hz": 20}, {"name": "b"}])
    pings = list(simulate(world))
    stamps = [trace.stamp_ns for _, trace in pings]
    assert stamps == sorted(set(stamps))
    assert stamps[0] == 1_700_000_000 * 10**9
    assert len(pings) == world.ping_count == 15
    assert {topic for topic, _ in pings} == {"/a/echo", "/b/echo"}


def test_several_transducers_take_turns_under_names_of_their_own():
    robot = {"name": "r", "transducers": [{"name": "left"}, {"name": "right"}]}
    pings = list(simulate(scenario(robots=[robot], duration_s=0.2)))
    assert [topic for topic, _ in pings] == ["/r/left/echo", "/r/right/echo"] * 2
    assert [trace.child_frame_id for _, trace in pings[:2]] == ["r/left", "r/right"]
    assert np.diff([trace.stamp_ns for _, trace in pings]).tolist() == [50_000_000] * 3


@pytest.mark.parametrize(
    ("duration_s", "interval_s", "count"), [(0.3, 0.1, 3), (0.31, 0.1, 4), (0.01, 0.1, 1)]
)
def test_pings_begin_within_the_duration(duration_s, interval_s, count):
    assert ping_count(duration_s, interval_s) == count
