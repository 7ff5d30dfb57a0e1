"""The simulator against recordings that were made independently of it."""

from dataclasses import dataclass

import numpy as np
import pytest

from usmap_ros.io.bag_reader import BagReader
from usmap_ros.io.map_files import load_truth
from usmap_ros.pings.trace import Encoding
from usmap_ros.simulation import EchoSimulator, Scenario, simulate

POLES = {"area_m": [0, 10, 0, 10], "random_poles": {"count": 30, "separation_m": 0.5}}
STILL_AIR = {"sound_speed_m_s": 343.0, "attenuation_db_m": 0.0}


@pytest.fixture(scope="session")
def recorded(shared_folder):
    def read(name):
        with BagReader([shared_folder / "bags" / name]) as bag:
            return [trace for _, trace in bag.traces()]

    return read


def simulated(encoding, sample_rate_hz):
    receiver = {"encoding": encoding, "sample_rate_hz": sample_rate_hz}
    robots = [
        {"name": f"robot{number}", "transducers": [{"receiver": receiver}]} for number in (1, 2, 3)
    ]
    content = {"world": POLES, "medium": STILL_AIR, "robots": robots}
    return [trace for _, trace in simulate(Scenario.from_mapping(content, "poles.yaml"))]


def quiet_level(traces):
    """RMS of what is left of the traces beside their echoes."""
    levels = [np.median(np.abs(trace.signal())) for trace in traces]
    return np.median(levels)


def loudest_reflectivities(traces):
    """What the strongest sample of each ping, made up for its range, stands for."""
    ranges = [trace.channel.sound_speed_m_s * trace.sample_times_s() / 2.0 for trace in traces]
    return [
        np.max(np.abs(trace.signal()) * range_m**2)
        for trace, range_m in zip(traces, ranges, strict=True)
    ]


@dataclass(frozen=True)
class Recorded:
    """Figures of a recording that others made of a like scene.

    Parameters
    ----------
    encoding, sample_rate_hz : Encoding, float
        What its samples are.
    samples : int
        In one trace.
    noise_std : float
        As stated.
    quiet_level : float
        Median magnitude of a sample.
    loudest_reflectivities : tuple
        Quartiles of what the strongest sample of each ping stands for.
    """

    encoding: Encoding
    sample_rate_hz: float
    samples: int
    noise_std: float
    quiet_level: float
    loudest_reflectivities: tuple[float, float, float]


@pytest.mark.parametrize(
    "theirs",
    [
        Recorded(Encoding.IQ, 25e3, 1488, 0.01, 0.00850, (0.759, 0.964, 1.256)),
        Recorded(Encoding.RAW, 250e3, 7376, 0.00707107, 0.00489, (0.890, 1.078, 1.317)),
        Recorded(Encoding.ENVELOPE, 25e3, 744, 0.01, 0.00849, (0.598, 0.875, 1.202)),
    ],
    ids=lambda theirs: theirs.encoding.name,
)
def test_traces_are_like_the_recorded_ones(theirs):
    ours = simulated(theirs.encoding.name.lower(), theirs.sample_rate_hz)
    assert ours[0].noise_std == pytest.approx(theirs.noise_std)
    assert len(ours[0].samples) == pytest.approx(theirs.samples, rel=0.02)
    assert quiet_level(ours) == pytest.approx(theirs.quiet_level, rel=0.05)
    quartiles = np.percentile(loudest_reflectivities(ours), (25, 50, 75))
    ratio = quartiles / theirs.loudest_reflectivities
    assert np.all((ratio > 0.6) & (ratio < 1.6))


def test_pose_errors_are_stated_like_the_recorded_ones():
    content = {
        "world": POLES,
        "robots": [{"name": "robot1", "pose_error": {"position_std_m": 0.03, "yaw_std_rad": 0.01}}],
    }
    _, ours = next(simulate(Scenario.from_mapping(content, "poles.yaml")))
    np.testing.assert_allclose(np.diag(ours.pose.covariance), [0.0009, 0.0009, 0, 0, 0, 0.0001])


@pytest.fixture(scope="session")
def sandbox(shared_folder):
    content = {
        "world": {"map": {"path": "tb3_sandbox.yaml"}, "surface": {"specular_reflectivity": 0.0}},
        "medium": STILL_AIR,
        "robots": [{"name": "robot1"}],
    }
    return Scenario.from_mapping(content, shared_folder / "maps" / "scenario.yaml")


@pytest.mark.recordings
def test_the_truth_of_a_map_is_the_recorded_one(sandbox, shared_folder):
    theirs = load_truth(shared_folder / "bags" / "sandbox_truth.yaml")
    ours = sandbox.truth_map(0.05)
    np.testing.assert_array_equal(ours.occupied, theirs.occupied)
    np.testing.assert_allclose(ours.geometry.origin_m, theirs.geometry.origin_m)


@pytest.mark.recordings
def test_from_the_recorded_poses_the_same_walls_are_heard(sandbox, recorded):
    def first_echo_m(trace):
        loud = np.flatnonzero(np.abs(trace.signal()) > 0.08)
        return 343.0 * trace.sample_times_s()[loud[0]] / 2.0 if len(loud) else np.inf

    scene = sandbox.scene()
    simulator = EchoSimulator(scene)
    transducer = sandbox.fleet(scene)[0].transducers[0]
    rng = np.random.default_rng(0)
    differences, levels = [], []
    for theirs in recorded("sandbox")[::4]:
        ours = simulator.ping(transducer, theirs.pose, theirs.stamp_ns, rng)
        differences.append(first_echo_m(ours) - first_echo_m(theirs))
        levels.append((ours, theirs))
    assert np.mean(np.abs(differences) < 0.1) > 0.9
    loudest = [np.median(loudest_reflectivities(side)) for side in zip(*levels, strict=True)]
    assert loudest[0] == pytest.approx(loudest[1], rel=0.3)
