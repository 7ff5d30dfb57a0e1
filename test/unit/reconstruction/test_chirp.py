"""Chirps: long pulses that the matched filter makes short."""

from dataclasses import replace

import numpy as np
import pytest

from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.errors import MalformedMessageError
from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.reconstruction.baseband import to_baseband
from usmap_ros.reconstruction.cells import reconstruct_cells
from usmap_ros.reconstruction.reconstructor import reconstruct
from usmap_ros.reconstruction.template import Template

PARAMETERS = ReconstructionParameters()
CELLS = ReconstructionParameters(dictionary="cells", cell_size_m=0.25)
#: On the axis, 3 cm apart where a chirp of 2 ms is 34 cm long.
NEIGHBOURS = [(1.2, 0.0), (1.23, 0.0)]
RECEPTIONS = ["chirp_iq", "chirp_raw"]


def forgotten(trace):
    """Return the trace as a message has it: without the sweep."""
    pulse = replace(trace.transducer.pulse, sweep_hz=0.0)
    return replace(trace, transducer=replace(trace.transducer, pulse=pulse))


@pytest.mark.parametrize("reception", RECEPTIONS)
def test_neighbours_within_a_pulse_are_told_apart(hear, reception):
    trace = hear(NEIGHBOURS, [1.0, 0.6], reception=reception, noise_std=0.01)

    cone = reconstruct(trace, PARAMETERS).cone

    np.testing.assert_allclose(cone.ranges_m, [1.2, 1.23], atol=1e-3)
    np.testing.assert_allclose(cone.amplitudes, [1.0 / 1.2**2, 0.6 / 1.23**2], rtol=0.05)


@pytest.mark.parametrize("reception", RECEPTIONS)
def test_a_long_chirp_hears_what_a_burst_does_not(hear, reception):
    # An amplitude of 0.04 in noise of 0.03.
    trace = hear([(4.0, 0.0)], [0.64], reception=reception, noise_std=0.03)
    short = hear([(4.0, 0.0)], [0.64], reception="iq", noise_std=0.03)

    ranges_m = reconstruct(trace, PARAMETERS).cone.ranges_m

    np.testing.assert_allclose(ranges_m, [4.0], atol=5e-3)
    assert len(reconstruct(short, PARAMETERS).cone.ranges_m) == 0


def test_a_chirp_tells_range_better_than_a_burst_of_its_length(hear):
    chirp = hear([(2.0, 0.0)], reception="chirp_iq", noise_std=0.01)
    short = reconstruct(hear([(2.0, 0.0)], reception="iq", noise_std=0.01), PARAMETERS).cone

    cone = reconstruct(chirp, PARAMETERS).cone

    assert cone.range_stds_m[0] < 0.5 * short.range_stds_m[0]


def test_the_envelope_of_a_chirp_is_that_of_a_long_burst(hear):
    cone = reconstruct(hear([(1.5, 0.0)], reception="chirp_envelope"), PARAMETERS).cone

    np.testing.assert_allclose(cone.ranges_m, [1.5], atol=2e-3)


@pytest.mark.parametrize("reception", ["chirp_iq", "chirp_raw", "chirp_envelope"])
def test_cells_recover_a_chirp_exactly(hear, reception):
    # Centres of cells of 25 cm; in an envelope they must not overlap.
    trace = hear([(1.125, 0.125), (2.375, -0.625)], [1.0, 0.5], reception=reception)

    found = reconstruct_cells(trace, CELLS)

    assert found.relative_residual < 1e-5
    chosen = found.coefficients > 0.0
    # The beam is symmetric: the second cell and its mirror image share a coefficient.
    assert sorted(found.dictionary.cells.ranges_m[chosen].round(3)) == pytest.approx(
        sorted([np.hypot(1.125, 0.125).round(3)] * 2 + [np.hypot(2.375, 0.625).round(3)] * 2)
    )


@pytest.mark.parametrize("parameters", [PARAMETERS, CELLS], ids=["delay", "cells"])
def test_a_chirp_of_unknown_sweep_is_refused(hear, parameters):
    trace = forgotten(hear(NEIGHBOURS, reception="chirp_iq"))

    with pytest.raises(MalformedMessageError, match=r"reconstruction\.chirp_sweep_hz"):
        reconstruct(trace, parameters)


def test_a_parameter_gives_the_sweep_that_a_recording_lacks(hear):
    trace = hear(NEIGHBOURS, reception="chirp_iq", noise_std=0.01)
    told = PARAMETERS.model_copy(update={"chirp_sweep_hz": 20_000.0})

    cone = reconstruct(forgotten(trace), told).cone

    np.testing.assert_array_equal(cone.ranges_m, reconstruct(trace, PARAMETERS).cone.ranges_m)


def test_too_few_samples_for_a_sweep_are_refused(hear):
    trace = replace(hear(NEIGHBOURS, reception="chirp_iq"), sample_rate_hz=19_000.0)

    with pytest.raises(MalformedMessageError, match=r"sample_rate.*sweeps 20000 Hz"):
        reconstruct(trace, PARAMETERS)


@pytest.mark.parametrize("reception", RECEPTIONS)
def test_the_template_is_what_an_echo_looks_like(hear, reception):
    trace = hear([(2.0, 0.0)], [4.0], reception=reception)
    baseband = to_baseband(trace)
    times_s = baseband.sampling.times_s

    expected = baseband.template(times_s - 4.0 / 343.0)

    likeness = np.vdot(expected, baseband.signal)
    norms = np.linalg.norm(expected) * np.linalg.norm(baseband.signal)
    assert abs(likeness) / norms > 0.9995


def test_overlap_falls_with_the_sweep():
    pulse = Pulse(PulseShape.CHIRP, 50e3, 2e-3, 20e3)
    template = Template(0.0, pulse.duration_s, pulse)

    overlap = template.overlap(template, np.array([0.0, 0.35 * pulse.resolution_s, 6.0 / 20e3]))

    assert overlap[0] == pytest.approx(1.0)
    assert 0.2 < overlap[1] < 0.5
    assert overlap[2] < 0.02
