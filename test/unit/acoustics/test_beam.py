"""Beam patterns."""

import numpy as np
import pytest

from usmap_ros.acoustics.beam import PAPER_HALF_ANGLE_RAD, BeamPattern
from usmap_ros.errors import MalformedMessageError

WAVELENGTH_M = 343.0 / 50_000.0
PATTERNS = {
    "linear": BeamPattern.linear(),
    "piston": BeamPattern.circular_piston(0.0192, WAVELENGTH_M),
    "small piston": BeamPattern.circular_piston(0.002, WAVELENGTH_M),
    "senscomp": BeamPattern.senscomp_600(),
}


@pytest.mark.parametrize("beam", PATTERNS.values(), ids=PATTERNS)
def test_every_pattern_is_one(beam):
    beam.validate()
    assert beam.gain(np.array(0.0)) == 1.0
    assert np.all(beam.gains <= 1.0)
    bearings = np.linspace(0.0, np.pi, 50)
    np.testing.assert_array_equal(beam.gain(bearings), beam.gain(-bearings))
    assert np.all(beam.gain(bearings[bearings > beam.half_angle_rad]) == 0.0)


def test_linear_pattern_is_the_papers():
    beam = BeamPattern.linear()
    assert beam.half_angle_rad == pytest.approx(np.deg2rad(40.0)) == PAPER_HALF_ANGLE_RAD
    assert beam.gain(np.deg2rad(10.0)) == pytest.approx(0.75)


def test_piston_ends_at_its_first_null():
    beam = BeamPattern.circular_piston(0.0192, WAVELENGTH_M)
    # sin θ = 0.61 wavelengths / radius, as for an Airy disc.
    assert np.sin(beam.half_angle_rad) == pytest.approx(0.6098 * WAVELENGTH_M / 0.0192, rel=1e-3)
    assert beam.gains[-1] == pytest.approx(0.0, abs=1e-12)
    assert np.all(np.diff(beam.gains) < 0.0)


def test_piston_two_ways_is_one_way_squared():
    # k a sin θ = 1.616 is the piston's -3 dB point one way: half the amplitude both ways.
    radius = 0.0192
    angle = np.arcsin(1.616 * WAVELENGTH_M / (2.0 * np.pi * radius))
    beam = BeamPattern.circular_piston(radius, WAVELENGTH_M, count=201)
    assert beam.gain(angle) == pytest.approx(0.5, abs=2e-3)


def test_piston_without_null_hears_all_that_is_in_front():
    beam = BeamPattern.circular_piston(0.002, WAVELENGTH_M)
    assert beam.half_angle_rad == pytest.approx(np.pi / 2.0)
    assert beam.gains[-1] > 0.3


def test_piston_can_be_cut():
    beam = BeamPattern.circular_piston(0.0192, WAVELENGTH_M, cut_rad=0.1)
    assert beam.half_angle_rad == 0.1


def test_piston_tables_are_close_to_the_formula():
    coarse = BeamPattern.circular_piston(0.0192, WAVELENGTH_M)
    fine = BeamPattern.circular_piston(0.0192, WAVELENGTH_M, count=2001)
    angles = np.linspace(0.0, fine.half_angle_rad, 500)
    assert np.max(np.abs(coarse.gain(angles) - fine.gain(angles))) < 0.005


def test_senscomp_is_half_as_loud_one_way_15_degrees_across():
    beam = BeamPattern.senscomp_600()
    one_way = np.sqrt(beam.gain(np.deg2rad([7.5, -7.5])))
    np.testing.assert_allclose(one_way, 0.5, atol=0.02)


@pytest.mark.parametrize(
    ("angles", "gains"),
    [
        ([0.0], [1.0]),
        ([0.0, 0.5], [1.0]),
        ([0.1, 0.5], [1.0, 0.0]),
        ([0.0, 0.5, 0.5], [1.0, 0.5, 0.0]),
        ([0.0, 4.0], [1.0, 0.0]),
        ([0.0, np.nan], [1.0, 0.0]),
        ([0.0, 0.5], [1.0, -0.1]),
        ([0.0, 0.5], [0.0, 0.0]),
    ],
)
def test_impossible_pattern_is_refused(angles, gains):
    with pytest.raises(MalformedMessageError, match=r"transducer\.beam"):
        BeamPattern(np.array(angles), np.array(gains)).validate()
