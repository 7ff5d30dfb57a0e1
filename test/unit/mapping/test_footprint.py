"""The cells of a cone, and what is known of each before anything was heard."""

from collections.abc import Callable

import numpy as np
import pytest

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.mapping.footprint import LEAST_GAIN, footprint
from usmap_ros.pings.cone import EchoCone

MakeCone = Callable[..., EchoCone]


@pytest.mark.parametrize("beam", [BeamPattern.linear(), BeamPattern.senscomp_600()])
@pytest.mark.parametrize("attenuation_db_m", [0.0, 1.7])
def test_the_unit_amplitude_is_the_contracts_direct_path(
    make_cone: MakeCone, beam: BeamPattern, attenuation_db_m: float
) -> None:
    """G(θ) 10^(−2 α r / 20) / r², as CONTRACT.md has it for s = 1 and no floor."""
    cone = make_cone(x_m=0.3, y_m=-1.2, yaw_rad=2.0, beam=beam, attenuation_db_m=attenuation_db_m)
    cells = footprint(cone, 0.05)
    x_m, y_m = (cells.columns + 0.5) * 0.05 - 0.3, (cells.rows + 0.5) * 0.05 + 1.2
    range_m = np.hypot(x_m, y_m)
    bearing_rad = np.angle((x_m + 1j * y_m) * np.exp(-2.0j))
    amplitude = beam.gain(bearing_rad) * 10 ** (-attenuation_db_m * 2 * range_m / 20) / range_m**2
    np.testing.assert_allclose(cells.range_m, range_m)
    np.testing.assert_allclose(cells.bearing_rad, bearing_rad, atol=1e-12)
    loud = amplitude * range_m**2 > 10 * LEAST_GAIN
    assert np.mean(loud) > 0.9
    np.testing.assert_allclose(np.exp(cells.log_unit_amplitude[loud]), amplitude[loud])
    assert np.all(np.isfinite(cells.log_unit_amplitude))


def test_ranges_spread_as_the_poses_do(make_cone: MakeCone) -> None:
    """By Monte Carlo: a fixed cell seen from poses drawn from the covariance."""
    stds, generator = np.array([0.03, 0.02, 0.015]), np.random.default_rng(2)
    correlation = np.array([[1.0, 0.5, -0.4], [0.5, 1.0, 0.3], [-0.4, 0.3, 1.0]])
    covariance = correlation * np.outer(stds, stds)
    cone = make_cone(x_m=0.5, y_m=0.2, yaw_rad=0.6, min_range_m=0.6, planar_covariance=covariance)
    cells = footprint(cone, 0.1)
    poses = generator.multivariate_normal([0.5, 0.2, 0.6], covariance, size=40_000)
    for cell in range(0, len(cells.range_m), len(cells.range_m) // 12):
        place_m = (np.array([cells.columns[cell], cells.rows[cell]]) + 0.5) * 0.1
        away_m = place_m - poses[:, :2]
        assert np.std(np.hypot(*away_m.T)) == pytest.approx(cells.range_std_m[cell], rel=0.03)


def test_an_exact_pose_spreads_nothing(make_cone: MakeCone) -> None:
    cells = footprint(make_cone(), 0.05)
    assert not cells.range_std_m.any()


def test_depth_and_taper_are_those_of_the_projected_square(make_cone: MakeCone) -> None:
    cells = footprint(make_cone(beam=BeamPattern.linear(1.2)), 0.1)
    corners = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]]) * 0.05
    heading = np.arctan2((cells.rows + 0.5) * 0.1, (cells.columns + 0.5) * 0.1)
    projected = np.sort(corners @ np.stack([np.cos(heading), np.sin(heading)]), axis=0)
    np.testing.assert_allclose(cells.half_depth_m, projected[3], atol=1e-12)
    np.testing.assert_allclose(cells.taper_m, projected[3] - projected[2], atol=1e-12)
