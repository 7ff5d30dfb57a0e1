"""Calibration of simulated recordings whose errors are known."""

from dataclasses import replace

import numpy as np
import pytest

from usmap_ros.calibration import Target, calibrate
from usmap_ros.errors import UsmapError
from usmap_ros.parameters import CorrectionParameters, PipelineParameters
from usmap_ros.pings.preparation.prepare import corrected
from usmap_ros.reconstruction.reconstructor import reconstruct
from usmap_ros.simulation import Scenario, simulate

POLES = [
    (1.2, 1.4, 0.4),
    (3.0, 2.6, 0.7),
    (3.1, 0.4, 1.0),
    (4.6, 1.6, 0.6),
    (2.2, 3.6, 0.8),
    (-0.5, 2.0, 0.5),
]
LAP = [[0.5, 0.5], [2.2, 0.6], [3.8, 1.2], [3.4, 1.9], [1.8, 2.2], [0.6, 2.4]]


def record(*, reception=("iq", 25_000.0), stated=None, poles=POLES, **change):
    """Traces of one robot that goes round among poles, turning as it goes."""
    defaults = {
        "floor_reflectivity": 0.0,
        "waypoints": LAP,
        "spin_rad_s": 0.8,
        "duration_s": 12.0,
        "noise_std": 0.005,
        "position_std_m": 0.0,
        "seed": 3,
    }
    setting = defaults | change
    encoding, rate_hz = reception
    receiver = {"encoding": encoding, "sample_rate_hz": rate_hz, "noise_std": setting["noise_std"]}
    motion = {
        "kind": "waypoints",
        "waypoints_m": setting["waypoints"],
        "speed_m_s": 0.6,
        "spin_rad_s": setting["spin_rad_s"],
    }
    scenario = Scenario.from_mapping(
        {
            "seed": setting["seed"],
            "duration_s": setting["duration_s"],
            "world": {"points": [{"x_m": x, "y_m": y, "reflectivity": s} for x, y, s in poles]},
            "medium": {
                "sound_speed_m_s": 346.0,
                "floor_reflectivity": setting["floor_reflectivity"],
            },
            "stated": stated or {},
            "robots": [
                {
                    "name": "robot",
                    "motion": motion,
                    "pose_error": {"position_std_m": setting["position_std_m"]},
                    "transducers": [{"mount": {"z_m": 0.45}, "receiver": receiver}],
                }
            ],
        },
        "test",
    )
    return [trace for _, trace in simulate(scenario)]


def spoilt(traces, gain=1.0, offset_m=0.0):
    """The same behind an amplifier, and with a latency that lengthens ranges by `offset_m`."""
    latency_s = 2.0 * offset_m / 346.0
    return [
        replace(
            trace,
            samples=(gain * trace.samples).astype(np.float32),
            noise_std=gain * trace.noise_std,
            start_delay_s=trace.start_delay_s + latency_s,
        )
        for trace in traces
    ]


@pytest.mark.parametrize(
    "reception", [("iq", 25_000.0), ("envelope", 25_000.0), ("raw", 250_000.0)]
)
def test_speed_and_offset_are_found_of_every_encoding(reception):
    traces = record(reception=reception, stated={"sound_speed_m_s": 339.0})
    found = calibrate(spoilt(traces, offset_m=0.068))

    assert found.sound_speed_m_s.value == pytest.approx(346.0, abs=0.5)
    assert found.range_offset_m.value == pytest.approx(0.068, abs=0.005)
    assert found.sound_speed_m_s.is_known
    assert found.range_offset_m.is_known


@pytest.mark.parametrize("offset_m", [0.0, -0.05])
def test_floor_is_found_beside_a_wrong_speed_and_offset(offset_m):
    stated = {"sound_speed_m_s": 340.0, "floor_height_m": 0.7, "floor_reflectivity": 0.9}
    traces = record(floor_reflectivity=0.5, stated=stated)
    found = calibrate(spoilt(traces, offset_m=offset_m))

    assert found.floor_height_m.value == pytest.approx(0.45, abs=0.01)
    assert found.floor_reflectivity.value == pytest.approx(0.5, abs=0.05)
    assert found.sound_speed_m_s.value == pytest.approx(346.0, abs=0.5)
    assert found.range_offset_m.value == pytest.approx(offset_m, abs=0.005)


@pytest.mark.parametrize("gain", [0.02, 1.0, 2000.0])
def test_target_tells_gain_and_offset(gain):
    x_m, y_m, reflectivity = POLES[1]
    traces = spoilt(record(), gain, 0.03)
    found = calibrate(traces, target=Target(x_m, y_m, reflectivity))

    assert abs(20.0 * np.log10(found.gain.value / gain)) < 1.0
    assert found.range_offset_m.value == pytest.approx(0.03, abs=0.005)
    assert found.gain.is_known


def test_units_that_cannot_be_are_noticed_without_a_target():
    found = calibrate(spoilt(record(), 1500.0))

    assert found.gain.is_known
    assert abs(np.log(found.gain.value / 1500.0)) < 2.0 * found.gain.std
    assert not calibrate(record()).gain.is_known


def test_deviations_are_those_of_repeated_recordings():
    runs = [calibrate(record(seed=seed, position_std_m=0.005)) for seed in range(6)]
    for name, truth in (("sound_speed_m_s", 346.0), ("range_offset_m", 0.0)):
        estimates = [getattr(run, name) for run in runs]
        z = np.array([(one.value - truth) / one.std for one in estimates])
        assert 0.3 < np.sqrt(np.mean(z**2)) < 2.0, name


def test_correction_makes_ranges_and_amplitudes_true():
    right = record(stated={"sound_speed_m_s": 339.0})
    traces = spoilt(right, 30.0, 0.06)
    x_m, y_m, reflectivity = POLES[1]
    correction = calibrate(traces, target=Target(x_m, y_m, reflectivity)).correction()
    parameters = PipelineParameters().reconstruction

    speed = CorrectionParameters(sound_speed_m_s=346.0)
    for before, trace in zip(right[::17], traces[::17], strict=True):
        true = reconstruct(corrected(before, speed), parameters).cone
        mended = reconstruct(trace, parameters.model_copy(update={"correction": correction})).cone
        assert mended.ranges_m == pytest.approx(true.ranges_m, abs=0.005)
        assert mended.amplitudes == pytest.approx(true.amplitudes, rel=0.1)


def test_no_floor_is_found_where_there_is_none():
    silent = calibrate(record())
    assert not silent.floor_height_m.is_known
    assert "no echo over a floor" in silent.floor_height_m.why_unknown

    contradicted = calibrate(record(stated={"floor_height_m": 0.5, "floor_reflectivity": 0.9}))
    assert contradicted.floor_height_m.value == 0.0
    assert contradicted.correction().floor_height_m == 0.0


def test_robot_that_stands_still_cannot_tell_speed_or_offset():
    found = calibrate(record(waypoints=[[0.5, 0.5]], spin_rad_s=0.0, duration_s=2.0))

    assert "from enough places" in found.sound_speed_m_s.why_unknown
    assert "from enough places" in found.range_offset_m.why_unknown
    assert found.correction() == CorrectionParameters()


def test_robot_that_goes_straight_at_an_object_cannot_tell_an_offset():
    ahead = [[0.0, 1.0], [2.0, 1.0]]
    found = calibrate(
        record(waypoints=ahead, spin_rad_s=0.0, poles=[(4.5, 1.0, 1.0)], duration_s=3.0)
    )

    assert not found.range_offset_m.is_known
    assert found.sound_speed_m_s.value == pytest.approx(346.0, abs=1.0)


def test_silence_is_an_error():
    with pytest.raises(UsmapError, match="no echo was heard"):
        calibrate(record(poles=[(20.0, 20.0, 1.0)], duration_s=1.0))


def test_target_that_is_not_there_is_an_error():
    with pytest.raises(UsmapError, match=r"target: no object was heard at x 1 m, y 3 m"):
        calibrate(record(), target=Target(1.0, 3.0))


def test_correction_leaves_out_samples_from_before_the_emission():
    trace = record(duration_s=0.1)[0]
    late = corrected(trace, CorrectionParameters(range_offset_m=0.1))

    assert late.start_delay_s >= 0.0
    assert late.start_delay_s + len(late.samples) / 2 / 25_000.0 == pytest.approx(
        trace.start_delay_s + len(trace.samples) / 2 / 25_000.0 - 0.2 / 346.0
    )
    late.validate()


def test_target_tells_the_offset_at_the_stated_speed_where_the_speed_is_not_told():
    # Few distances, and ranges that are off by more than they say, as on a bench.
    ahead = [[0.0, 1.0], [2.0, 1.0]]
    traces = record(waypoints=ahead, spin_rad_s=0.0, poles=[(2.5, 1.0, 1.0)], duration_s=1.0)
    rng = np.random.default_rng(2)
    jittered = [spoilt([trace], 1.0, -0.09 + rng.normal(0.0, 0.008))[0] for trace in traces]
    found = calibrate(jittered, target=Target(2.5, 1.0, 1.0))

    assert not found.sound_speed_m_s.is_known
    assert found.range_offset_m.is_known
    assert found.range_offset_m.value == pytest.approx(-0.09, abs=0.01)


def test_offset_that_is_too_wide_to_be_looked_for_is_said():
    traces = spoilt(record(poles=POLES[1:2], duration_s=8.0), offset_m=0.5)
    x_m, y_m, reflectivity = POLES[1]
    with pytest.raises(UsmapError, match=r"nor within 0\.3 m before or behind .* start_delay_s\?"):
        calibrate(traces, target=Target(x_m, y_m, reflectivity))
