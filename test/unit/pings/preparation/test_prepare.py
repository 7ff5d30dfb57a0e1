"""What parameters add to traces, and what pings of one receiver share."""

from dataclasses import replace

import numpy as np
import pytest

from usmap_ros.errors import MalformedMessageError
from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.pings.preparation.dc_offset import _is_around_zero, _median_level, without_dc_offset
from usmap_ros.pings.preparation.prepare import prepared
from usmap_ros.pings.preparation.valid_part import valid_part
from usmap_ros.pings.trace import Encoding
from usmap_ros.reconstruction.reconstructor import reconstruct
from usmap_ros.reconstruction.shared_noise import SharedNoise
from usmap_ros.simulation import hear, simulate
from usmap_ros.simulation.receiver import Receiver
from usmap_ros.simulation.scenario import Scenario

DEFAULTS = ReconstructionParameters()
RATES = {Encoding.RAW: 250e3, Encoding.IQ: 25e3, Encoding.ENVELOPE: 25e3}


def trace_of(encoding=Encoding.IQ, noise=0.01, seed=0, objects=((1.5, 0.0),)):
    return hear(objects, receiver=Receiver(encoding, RATES[encoding], 0.0, noise), seed=seed)


@pytest.mark.parametrize("encoding", Encoding)
def test_level_that_samples_rest_at_is_taken_off(encoding):
    trace = trace_of(encoding)
    lifted = replace(trace, samples=(trace.samples + np.float32(2048.0)))
    settled = without_dc_offset(lifted)

    assert settled.samples == pytest.approx(trace.samples, abs=0.005)
    assert without_dc_offset(trace) is trace
    cone = reconstruct(lifted, DEFAULTS).cone
    assert cone.ranges_m == pytest.approx([1.5], abs=0.002)


def test_no_median_is_needed_to_know_that_noise_is_around_zero():
    generator = np.random.default_rng(0)
    spared = []
    for level in np.repeat([0.0, 0.1, 0.5, 0.6, 0.7, 0.8, 1.0, 3.0], 20):
        samples = generator.normal(size=generator.integers(2, 900)) + level
        samples[: len(samples) // 10] *= 100.0
        spared.append(_is_around_zero(samples, 1))
        assert not (spared[-1] and _median_level(samples))
    assert np.mean(spared[:40]) > 0.9


@pytest.mark.parametrize("encoding", Encoding)
def test_noise_of_a_recording_is_shared(encoding):
    shared = SharedNoise(DEFAULTS)
    stated = trace_of(encoding).noise_std
    levels = [
        shared.with_noise(replace(trace_of(encoding, seed=seed), noise_std=0.0)).noise_std
        for seed in range(30)
    ]

    assert levels[-1] == pytest.approx(stated, rel=0.1)
    assert np.std(levels[20:]) < 0.02 * stated
    assert shared.with_noise(trace_of(encoding)).noise_std == stated


def test_transducers_do_not_share_their_noise():
    shared = SharedNoise(DEFAULTS)
    quiet, loud = (replace(trace_of(noise=one), noise_std=0.0) for one in (0.001, 0.1))
    loud = replace(loud, child_frame_id="other")

    assert shared.with_noise(quiet).noise_std < 0.1 * shared.with_noise(loud).noise_std


def test_stated_window_is_obeyed():
    window = valid_part(trace_of(), 0.005, 0.012)

    assert window.start_delay_s == pytest.approx(0.005, abs=1e-4)
    assert window.sampling.end_s == pytest.approx(0.012, abs=1e-4)
    parameters = ReconstructionParameters(valid_from_s=0.010)
    assert len(reconstruct(trace_of(), parameters).cone.ranges_m) == 0


def two_elements(offset_m):
    """Traces of a sensor with its receiver beside its sender."""
    sensor = {"receiver_offset_m": offset_m, "receiver": {"noise_std": 0.001}}
    motion = {"kind": "waypoints", "waypoints_m": [[0.0, 0.0], [0.1, 0.0]], "heading_rad": 0.3}
    content = {
        "duration_s": 0.1,
        "world": {"points": [{"x_m": 0.6, "y_m": 0.2}], "area_m": [-1, 3, -1, 3]},
        "robots": [{"name": "robot", "motion": motion, "transducers": [sensor]}],
    }
    return [trace for _, trace in simulate(Scenario.from_mapping(content, "test"))]


@pytest.mark.parametrize("dictionary", ["delay", "cells"])
def test_receiver_beside_the_sender_is_honoured(dictionary):
    (trace,) = two_elements([0.0, -0.3, 0.0])
    parameters = ReconstructionParameters(
        dictionary=dictionary, receiver_offset_m=[0.0, -0.3, 0.0], cell_size_m=0.02
    )
    cone = reconstruct(trace, parameters).cone
    sender_m = np.linalg.norm([0.6, 0.2])
    receiver = trace.pose.position_m + trace.pose.rotation @ [0.0, -0.3, 0.0]
    receiver_m = np.linalg.norm([0.6 - receiver[0], 0.2 - receiver[1]])
    strongest_m = cone.ranges_m[np.argmax(cone.amplitudes)]

    if dictionary == "delay":
        assert strongest_m == pytest.approx(0.5 * (sender_m + receiver_m), abs=0.002)
        middle = 0.5 * (trace.pose.position_m + receiver)
        assert cone.pose.position_m == pytest.approx(middle)
    else:
        assert cone.residual < 0.5


def test_offset_is_not_for_arrays():
    trace = prepared(trace_of(), ReconstructionParameters(receiver_offset_m=[0.0, 0.05, 0.0]))
    with pytest.raises(MalformedMessageError, match="receiver_offset_m"):
        prepared(trace, ReconstructionParameters(receiver_offset_m=[0.0, 0.05, 0.0]))
