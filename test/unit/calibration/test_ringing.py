"""What a transducer hears of itself in every ping is found, and no object is taken for it."""

from dataclasses import replace

import numpy as np
import pytest

from usmap_ros.calibration import Target, calibrate
from usmap_ros.parameters import ReconstructionParameters, RingingParameters
from usmap_ros.pings.preparation.ring_down import without_ringing
from usmap_ros.reconstruction.reconstructor import reconstruct
from usmap_ros.simulation import Scenario, simulate

POLE = Target(0.0, 0.0, 0.5)
#: Ranges and amplitudes of what is heard in every ping.
RINGING = {0.27: 0.1, 0.34: 0.06, 0.41: 0.03}
TRANSDUCER = {
    "pulse": {"shape": "hann_burst", "carrier_hz": 40e3, "duration_s": 3e-4},
    "beam": {"kind": "linear", "half_angle_rad": 1.2},
    "min_range_m": 0.2,
    "max_range_m": 2.5,
    "receiver": {"encoding": "iq", "sample_rate_hz": 25e3, "noise_std": 0.003},
}


def recorded(waypoints, ringing):
    """Traces of a robot that looks to the left, with echoes of its own casing."""
    motion = {"kind": "waypoints", "waypoints_m": waypoints, "speed_m_s": 0.6,
              "heading_rad": np.pi / 2.0}  # fmt: skip
    content = {
        "seed": 3,
        "duration_s": 8.0,
        "world": {"points": [{"x_m": 0.0, "y_m": 0.0, "reflectivity": 0.5}]},
        "robots": [{"name": "robot1", "motion": motion, "transducers": [TRANSDUCER]}],
    }
    traces = [trace for _, trace in simulate(Scenario.from_mapping(content, "ringing"))]
    window = traces[0].transducer.pulse.envelope
    time_s = traces[0].sample_times_s()
    own = sum(
        amplitude * window(time_s - 2.0 * range_m / traces[0].channel.sound_speed_m_s)
        for range_m, amplitude in ringing.items()
    )
    pairs = np.zeros(len(traces[0].samples), dtype=np.float32)
    pairs[0::2] = own
    return [replace(trace, samples=trace.samples + pairs) for trace in traces]


LAP = [[0.9, 0.0], [0.5, 0.8], [-0.2, 1.3], [-1.1, 0.5], [-0.9, -0.6], [0.0, -1.2], [1.0, -0.8]]


def test_ringing_is_found_and_taken_off():
    traces = recorded(LAP, RINGING)
    calibration = calibrate(traces, target=POLE)
    found = ReconstructionParameters.model_validate(calibration.reconstruction())

    assert calibration.range_offset_m.value == pytest.approx(0.0, abs=0.005)
    assert found.ringing.ranges_m == pytest.approx(list(RINGING), abs=0.005)
    assert found.ringing.amplitudes == pytest.approx(list(RINGING.values()), rel=0.1)
    for trace in traces[::10]:
        cone = reconstruct(trace, found).cone
        cone.validate()
        assert not np.any(cone.ranges_m < 0.45)
        # What it hides is not said to be free.
        bins = ((np.array(list(RINGING)) - 0.2) / cone.limit_step_m).astype(int)
        assert np.all(cone.limit_amplitudes()[bins] >= list(RINGING.values()))


def test_pole_that_is_always_as_far_away_is_no_ringing():
    angles = np.linspace(0.0, 2.0 * np.pi, 40)
    circle = np.stack([0.4 * np.cos(angles), 0.4 * np.sin(angles)], axis=-1).tolist()
    found = calibrate(recorded(circle, {}), target=POLE)

    assert found.ringing is None


def test_echo_that_is_louder_than_the_ringing_stays():
    trace = recorded([[-0.3, -0.27], [-0.2, -0.27]], {})[0]
    cone = reconstruct(trace, ReconstructionParameters()).cone
    faint, loud = (
        RingingParameters(ranges_m=[float(cone.ranges_m[0])], amplitudes=[amplitude])
        for amplitude in cone.amplitudes[0] * np.array([0.3, 1.0])
    )
    assert len(without_ringing(cone, faint).ranges_m) == len(cone.ranges_m)
    assert len(without_ringing(cone, loud).ranges_m) == len(cone.ranges_m) - 1


def test_every_range_needs_its_amplitude():
    with pytest.raises(ValueError, match="one for each of ranges_m"):
        RingingParameters(ranges_m=[0.3, 0.4], amplitudes=[0.1])
