"""Transducers of one robot that ping at once."""

from dataclasses import replace

import numpy as np
import pytest

from usmap_ros.errors import MalformedMessageError
from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.pings.soundings import soundings
from usmap_ros.reconstruction.delays import reconstruct_delays
from usmap_ros.reconstruction.reconstructor import reconstruct, reconstruct_sounding
from usmap_ros.simulation import Scenario, simulate

PARAMETERS = ReconstructionParameters()
BASE_M = 0.12
POLES = [(1.3, 0.25), (2.1, -0.4), (2.9, 0.1)]
UP = {"shape": "chirp", "carrier_hz": 50_000.0, "duration_s": 0.002, "sweep_hz": 16_000.0}
DOWN = {**UP, "sweep_hz": -16_000.0}
HIGH = {"shape": "hann_burst", "carrier_hz": 55_000.0, "duration_s": 0.0006}
LOW = {**HIGH, "carrier_hz": 47_000.0}


def sonar(name, y_m, pulse, encoding="iq", noise_std=0.003, **fields):
    rate_hz = 250_000.0 if encoding == "raw" else 30_000.0
    return {
        "name": name,
        "mount": {"y_m": y_m},
        "pulse": pulse,
        "receiver": {"encoding": encoding, "sample_rate_hz": rate_hz, "noise_std": noise_std},
        **fields,
    }


def pair(pulses=(UP, DOWN), poles=POLES, **fields):
    """Return the traces of one ping of two transducers side by side."""
    left = sonar("left", BASE_M / 2.0, pulses[0], **fields)
    right = sonar("right", -BASE_M / 2.0, pulses[1], **fields)
    return one_sounding([left, right], poles)


def one_sounding(transducers, poles=POLES):
    scenario = Scenario.from_mapping(
        {
            "duration_s": 0.1,
            "world": {
                "area_m": [-1, 4, -2, 2],
                "points": [{"x_m": x, "y_m": y, "reflectivity": 1.0} for x, y in poles],
            },
            "medium": {"sound_speed_m_s": 343.0, "attenuation_db_m": 0.0},
            "robots": [
                {
                    "name": "bat",
                    "motion": {"kind": "random_walk", "start": [0.0, 0.0, 0.0], "speed_m_s": 0.0},
                    "simultaneous": True,
                    "transducers": transducers,
                }
            ],
        },
        "scenario",
    )
    (sounding,) = soundings(simulate(scenario))
    return [trace for _, trace in sounding]


def polar_from(y_m, poles=POLES):
    """Ranges and bearings as seen from a transducer at a place on the y axis."""
    x, y = np.transpose(poles)
    order = np.argsort(np.hypot(x, y - y_m))
    return np.hypot(x, y - y_m)[order], np.arctan2(y - y_m, x)[order]


@pytest.mark.parametrize("pulses", [(UP, DOWN), (HIGH, LOW)], ids=["sweeps", "carriers"])
@pytest.mark.parametrize("encoding", ["iq", "raw"])
def test_each_transducer_is_given_the_echoes_of_its_own_pulse(pulses, encoding):
    traces = pair(pulses, encoding=encoding)

    for trace, y_m in zip(traces, (BASE_M / 2.0, -BASE_M / 2.0), strict=True):
        cone = reconstruct(trace, PARAMETERS).cone
        np.testing.assert_allclose(cone.ranges_m, polar_from(y_m)[0], atol=2e-3)


def test_a_method_that_knows_one_pulse_finds_echoes_that_are_none():
    trace = pair((HIGH, LOW))[0]
    alone = reconstruct(replace(trace, array=None), PARAMETERS)
    told = reconstruct(trace, PARAMETERS)

    assert np.linalg.norm(told.residual) < 0.3 * np.linalg.norm(alone.residual)


def test_pulses_of_the_other_arrive_by_way_of_both():
    trace = pair()[0]
    own, other = reconstruct_delays(trace, PARAMETERS).echoes

    halves = 0.5 * (polar_from(BASE_M / 2.0)[0] + polar_from(-BASE_M / 2.0)[0])
    np.testing.assert_allclose(np.sort(own.ranges_m), polar_from(BASE_M / 2.0)[0], atol=2e-3)
    np.testing.assert_allclose(np.sort(other.ranges_m), halves, atol=2e-3)


def test_bearings_are_within_their_standard_deviations():
    deviations = []
    for shift in range(24):
        poles = [(1.3 + 0.0137 * shift, 0.25), (2.4 - 0.0071 * shift, -0.4)]
        traces = pair(poles=poles, noise_std=0.01)
        for found, y_m in zip(reconstruct_sounding(traces, PARAMETERS), (0.06, -0.06), strict=True):
            error = found.cone.bearings_rad - polar_from(y_m, poles)[1]
            deviations.extend(error / found.cone.bearing_stds_rad)

    # Of about 100 normal deviations; the transducers' bearings of one pole depend on each other.
    assert 0.6 < np.sqrt(np.mean(np.square(deviations))) < 1.5


def test_one_sends_and_two_listen():
    traces = one_sounding([sonar("left", 0.06, UP), sonar("right", -0.06, UP, emits=False)])
    left, right = reconstruct_sounding(traces, PARAMETERS)

    assert right is None
    ranges, bearings = polar_from(0.06)
    np.testing.assert_allclose(left.cone.ranges_m, ranges, atol=2e-3)
    np.testing.assert_allclose(left.cone.bearings_rad, bearings, atol=0.02)


def test_a_lone_listener_hears_as_from_the_middle():
    trace = one_sounding([sonar("left", 0.06, UP), sonar("right", -0.06, UP, emits=False)])[1]
    cone = reconstruct(trace, PARAMETERS).cone

    np.testing.assert_allclose(cone.pose.position_m, 0.0, atol=1e-9)
    np.testing.assert_allclose(cone.ranges_m, polar_from(0.0)[0], atol=3e-3)
    assert cone.bearings_rad is None


def test_objects_that_cannot_be_matched_have_no_bearing():
    # As far apart in range as the receivers are: either could be either's.
    cone = reconstruct(pair(poles=[(1.5, 0.0), (1.52, 0.0), (2.9, 0.1)])[0], PARAMETERS).cone

    assert np.isfinite(cone.bearings_rad[-1])
    known = np.isfinite(cone.bearings_rad)
    expected = [0.0 - np.arctan2(0.06, 1.5), 0.0 - np.arctan2(0.06, 1.52)]
    np.testing.assert_allclose(
        cone.bearings_rad[:-1][known[:-1]], np.array(expected)[known[:-1]], atol=0.05
    )


@pytest.mark.parametrize("encoding", ["iq", "raw"])
def test_cells_sum_the_echoes_of_both_pulses(encoding):
    parameters = ReconstructionParameters(dictionary="cells", cell_size_m=0.25, sparsity=4)
    # Centres of cells, mirrored about the robot's axis: only the two together tell them apart.
    poles = [(1.625, 0.375), (2.375, -0.625)]
    for trace in pair(poles=poles, encoding=encoding, noise_std=0.0):
        found = reconstruct(trace, parameters)
        assert np.linalg.norm(found.residual) < 1e-4 * np.linalg.norm(found.received)


def test_equal_pulses_at_once_are_refused():
    with pytest.raises(Exception, match="send the same pulse"):
        pair((UP, UP))
    trace = pair()[0]
    left, right = trace.array.elements
    alike = replace(trace.array, elements=(left, replace(right, transducer=left.transducer)))
    twice = replace(trace, array=alike)
    with pytest.raises(MalformedMessageError, match="nothing tells their echoes apart"):
        reconstruct(twice, PARAMETERS)
