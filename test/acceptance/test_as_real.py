"""What is promised of real hardware, on a scenario that does what real hardware does."""

from pathlib import Path

import numpy as np
import pytest

from usmap_ros.calibration import Target, calibrate
from usmap_ros.parameters import PipelineParameters
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.simulation import Scenario, simulate

SCENARIO = Path(__file__).parents[2] / "config" / "scenarios" / "as_real.yaml"
#: The pole: where it stands, what it is worth as a point target, and its radius.
POLE = Target(0.0, 0.0, 0.5, 0.02)
#: In the beam of pings that are closer to its axis than this, and near enough.
TOWARDS_RAD, WITHIN_M = 0.8, 2.4

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def scenario():
    return Scenario.load(SCENARIO)


@pytest.fixture(scope="module")
def traces(scenario):
    return list(simulate(scenario))


@pytest.fixture(scope="module")
def calibration(traces):
    return calibrate([trace for _, trace in traces], target=POLE)


@pytest.fixture(scope="module")
def mapped(traces, calibration):
    """Pipeline with the map, and the cones that it is of."""
    content = {"reconstruction": calibration.reconstruction()}
    pipeline = Pipeline(PipelineParameters.model_validate(content))
    return pipeline, [pipeline.process(trace) for _, trace in traces]


def test_calibration_finds_what_is_off(scenario, calibration):
    receiver = scenario.robots[0].transducers[0].receiver
    speed_m_s = scenario.medium.channel(40e3, 0.6).sound_speed_m_s
    speed_m_s += 0.5 * scenario.duration_s * scenario.medium.drift_m_s2

    assert abs(20.0 * np.log10(calibration.gain.value / receiver.gain)) < 1.0
    assert calibration.range_offset_m.value == pytest.approx(
        0.5 * speed_m_s * receiver.latency_s, abs=0.005
    )
    assert calibration.sound_speed_m_s.value == pytest.approx(speed_m_s, abs=0.5)
    assert calibration.floor_height_m.value == pytest.approx(0.6, abs=0.01)
    assert calibration.floor_model.value == "corner"
    assert all(estimate.is_known for estimate in calibration.estimates().values())


def test_measured_pulse_is_the_true_one(scenario, calibration):
    measured = calibration.pulse.parameters
    template = np.array(measured.template_i) + 1j * np.array(measured.template_q)
    time_s = np.arange(len(template)) / measured.template_rate_hz
    true = scenario.robots[0].transducers[0].pulse.build().profile(time_s)
    left = template - np.vdot(true, template) / np.vdot(true, true) * true

    assert calibration.pulse.residual < 0.1
    assert np.linalg.norm(left) < 0.1 * np.linalg.norm(template)


def test_strongest_echo_is_the_pole_and_stands_alone(mapped):
    hits, false, pings = 0, 0, 0
    for cone in mapped[1]:
        cone.validate()
        distance_m, bearing_rad = cone.pose.polar(np.array([[0.0, 0.0, 0.6]]))
        true_m = float(distance_m[0]) - POLE.radius_m
        if abs(bearing_rad[0]) > TOWARDS_RAD or true_m > WITHIN_M:
            continue
        pings += 1
        error_m = np.abs(cone.ranges_m - true_m)
        hits += len(error_m) > 0 and error_m[np.argmax(cone.amplitudes)] < 0.06
        false += np.count_nonzero(error_m < 0.1) - (error_m.min(initial=1.0) < 0.1)

    assert pings > 150
    assert hits >= 0.98 * pings
    assert false <= 0.5 * pings


def test_map_has_the_pole_and_little_else(mapped):
    occupancy = mapped[0].occupancy_map()
    rows, columns = np.nonzero(occupancy.observed & (occupancy.probability() >= 0.65))
    distance_m = np.hypot(*occupancy.geometry.cell_centers_m(rows, columns).T)

    assert 1 <= np.count_nonzero(distance_m < 0.1) <= 6
    assert np.count_nonzero(distance_m >= 0.1) <= 3
