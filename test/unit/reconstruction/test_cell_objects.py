"""Columns for objects of a size, and coefficients as shares of a full cell."""

import numpy as np
import pytest

from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.reconstruction.cells import reconstruct_cells
from usmap_ros.reconstruction.reconstructor import reconstruct
from usmap_ros.simulation import Scenario, simulate

CELL_M = 0.5


def heard(objects, noise_std=0.0):
    scenario = Scenario.from_mapping(
        {
            "duration_s": 0.1,
            "world": {"area_m": [-1, 5, -3, 3], **objects},
            "medium": {"sound_speed_m_s": 343.0, "attenuation_db_m": 0.0},
            "robots": [
                {
                    "name": "robot",
                    "motion": {"kind": "random_walk", "start": [0.03, 0.07, 0.2], "speed_m_s": 0},
                    "transducers": [{"receiver": {"noise_std": noise_std}}],
                }
            ],
        },
        "scenario",
    )
    ((_, trace),) = simulate(scenario)
    return trace


def pillar(x_m, y_m):
    return {"x_m": x_m, "y_m": y_m, "radius_m": 0.2}


def pole(x_m, y_m, reflectivity):
    return {"x_m": x_m, "y_m": y_m, "reflectivity": reflectivity}


def parameters(**options):
    return ReconstructionParameters(dictionary="cells", cell_size_m=CELL_M, sparsity=4, **options)


def test_pillars_are_explained_by_columns_of_their_size():
    trace = heard({"cylinders": [pillar(2.25, 0.25), pillar(3.25, -0.25)]})

    told = reconstruct(trace, parameters(object_diameter_m=0.4)).cone

    assert told.residual < 1e-4
    assert reconstruct(trace, parameters()).cone.residual > 0.5
    distances = np.hypot([2.25 - 0.03, 3.25 - 0.03], [0.25 - 0.07, -0.25 - 0.07])
    np.testing.assert_allclose(told.ranges_m, distances - 0.2, atol=1e-6)
    np.testing.assert_allclose(told.amplitudes[0] * told.ranges_m[0] ** 2, 0.9, atol=0.2)


@pytest.mark.parametrize("full", [0.5, 1.0, 4.0])
def test_a_coefficient_is_the_share_of_a_full_cell(full):
    # A point of 0.2 and one of 0.4, where a full cell would return as much as one of `full`.
    trace = heard({"points": [pole(2.25, 0.25, 0.2), pole(3.25, -0.25, 0.4)]})

    found = reconstruct_cells(trace, parameters(full_reflectivity=full))

    shares = np.sort(found.coefficients[found.coefficients > 0.0])
    np.testing.assert_allclose(shares, [0.2 / full, 0.4 / full], rtol=0.02)
    # What is told to fusion is in the units of the trace all the same.
    plain = reconstruct(trace, parameters()).cone
    told = reconstruct(trace, parameters(full_reflectivity=full)).cone
    np.testing.assert_allclose(told.amplitudes, plain.amplitudes, rtol=1e-5)


def test_binary_coefficients_count_full_cells():
    trace = heard({"points": [pole(2.25, 0.25, 0.3)]}, noise_std=1e-4)

    found = reconstruct_cells(trace, parameters(solver="binary", full_reflectivity=0.3))

    assert found.coefficients[found.coefficients > 0.0].tolist() == [1.0]
    assert found.relative_residual < 0.1
