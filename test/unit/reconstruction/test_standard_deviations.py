"""Stated standard deviations are those of the errors, whatever was sent and however sampled."""

import importlib
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.sampling import Sampling
from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.pings.trace import Encoding
from usmap_ros.reconstruction.baseband import to_baseband
from usmap_ros.reconstruction.delay_search import between_samples
from usmap_ros.reconstruction.reconstructor import reconstruct

FOLDER = Path(__file__).parents[3] / "benchmarks"
PARAMETERS = ReconstructionParameters()
sys.path.insert(0, str(FOLDER))
benchmark = importlib.import_module("standard_deviations")
sys.path.remove(str(FOLDER))
TONE = Pulse(PulseShape.TONE_BURST, 50_000.0, 0.00032)


@pytest.mark.parametrize(
    ("reception", "rate_hz", "ratio_db"),
    [
        pytest.param(
            reception,
            rate_hz,
            ratio_db,
            id=f"{reception[0]}, {rate_hz / 1e3:g} kS/s, {ratio_db:g} dB",
            # The faintest echoes are the hardest.
            marks=[] if (rate_hz, ratio_db) == (rates_hz[0], 20.0) else [pytest.mark.slow],
        )
        for *reception, rates_hz in benchmark.RECEPTIONS
        for rate_hz in rates_hz
        for ratio_db in benchmark.RATIOS_DB
    ],
)
def test_errors_are_as_large_as_stated(
    reception: list[Any], rate_hz: float, ratio_db: float
) -> None:
    row = benchmark.row(reception, rate_hz, ratio_db, 160 if ratio_db == 20.0 else 100)

    assert row.missed < 8
    assert 0.8 < benchmark.spread(row.ranges) < 1.25
    assert 0.8 < benchmark.spread(row.amplitudes) < 1.25


@pytest.mark.parametrize("rate_hz", [122e3, 1e6])
def test_clean_raw_tone_bursts_make_valid_cones(rate_hz: float) -> None:
    rng = np.random.default_rng(1)
    clean = benchmark.traces(Encoding.RAW, TONE, rate_hz, 200.0, 200, rng)
    for trace, range_m, amplitude in clean:
        cone = reconstruct(replace(trace, noise_std=0.0), PARAMETERS).cone

        cone.validate()
        assert len(cone.ranges_m) == 1
        assert abs(cone.ranges_m[0] - range_m) < 4.0 * cone.range_stds_m[0]
        assert 0.0 < cone.range_stds_m[0] < 0.001
        assert cone.amplitudes[0] == pytest.approx(amplitude, rel=0.05)


@pytest.mark.parametrize("rate_hz", [122e3, 250e3, 1e6])
def test_template_of_a_raw_tone_burst_has_a_slope(rate_hz: float) -> None:
    rng = np.random.default_rng(1)
    ((trace, _, _),) = benchmark.traces(Encoding.RAW, TONE, rate_hz, 40.0, 1, rng)
    template = to_baseband(trace).template
    time_s = np.linspace(0.0, template.duration_s, 4001)
    slope = template.slope(time_s[1:-1]).real

    envelope = template(time_s[1:-1]).real
    middle = (envelope > 0.1 * envelope.max()) & (envelope < 0.9 * envelope.max())
    assert np.mean(np.abs(slope[middle]) > 0.1 * np.abs(slope).max()) > 0.95
    by_difference = np.gradient(template(time_s).real, time_s)[1:-1]
    # But for the points next to a bend.
    agree = np.abs(slope - by_difference) < 0.02 * np.abs(slope).max()
    assert np.mean(agree) > 0.97


def test_an_edge_lies_in_the_middle_between_two_samples() -> None:
    sampling = Sampling(1000.0, 0.0, 100)
    # The first sample that is touched is number 11, of which the echo lasts ten.
    step_s, std_s = between_samples(np.array([0.0102]), np.ones(1), 0.01, 0.010, sampling)
    assert step_s[0] == pytest.approx(0.0003)
    assert std_s[0] == pytest.approx(0.001 / np.sqrt(12.0))

    # Of ten and a half samples, ten or eleven are touched, which halves the room.
    step_s, std_s = between_samples(np.array([0.0102]), np.ones(1), 0.01, 0.0105, sampling)
    assert step_s[0] == pytest.approx(0.00005)
    assert std_s[0] == pytest.approx(0.0005 / np.sqrt(12.0))


def test_noise_moves_an_edge() -> None:
    sampling = Sampling(1000.0, 0.0, 100)
    stds_s = [
        between_samples(np.array([0.0102]), np.ones(1), noise, 0.010, sampling)[1][0]
        for noise in (0.01, 0.3, 1.0, 3.0)
    ]
    assert np.all(np.diff(stds_s) > 0.0)
