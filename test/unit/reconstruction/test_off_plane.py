"""Objects off the plane of the transducer, and transducers that are tilted."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from usmap_ros.acoustics.propagation import Channel
from usmap_ros.mapping.footprint import footprint
from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.reconstruction.reconstructor import reconstruct
from usmap_ros.simulation import Scenario, simulate

HEIGHT_M, LEVEL_M = 1.0, 0.2
LYING = {"upright_objects": False, "object_height_m": LEVEL_M}
CELLS = {"dictionary": "cells", "cell_size_m": 0.25}


def trace(pitch_rad=0.0, floor_reflectivity=0.0):
    """Return what a transducer 1 m up hears of a ball 20 cm up, over the middle of a cell."""
    ball = {"x_m": 2.125, "y_m": 0.625, "z_m": LEVEL_M, "reflectivity": 1.0}
    scenario = Scenario.from_mapping(
        {
            "duration_s": 0.1,
            "world": {"area_m": [-1, 5, -3, 3], "balls": [ball]},
            "medium": {
                "sound_speed_m_s": 343.0,
                "attenuation_db_m": 0.0,
                "floor_reflectivity": floor_reflectivity,
            },
            "robots": [
                {
                    "name": "robot",
                    "motion": {"kind": "random_walk", "start": [0.07, 0.11, 0.3], "speed_m_s": 0},
                    "transducers": [
                        {
                            "mount": {"z_m": HEIGHT_M, "pitch_rad": pitch_rad},
                            "receiver": {"noise_std": 0.0},
                        }
                    ],
                }
            ],
        },
        "scenario",
    )
    ((_, heard),) = simulate(scenario)
    return heard


def distance_m():
    return float(np.linalg.norm([2.125 - 0.07, 0.625 - 0.11, LEVEL_M - HEIGHT_M]))


@pytest.mark.parametrize("pitch_rad", [0.0, 0.3])
@pytest.mark.parametrize("floor_reflectivity", [0.0, 0.6])
def test_cells_at_the_objects_height_explain_them_exactly(pitch_rad, floor_reflectivity):
    heard = trace(pitch_rad, floor_reflectivity)
    told = reconstruct(heard, ReconstructionParameters(**CELLS, **LYING))
    plane = reconstruct(heard, ReconstructionParameters(**CELLS))

    assert told.cone.residual < 1e-4
    assert plane.cone.residual > 0.5
    np.testing.assert_allclose(told.cone.ranges_m, [distance_m()], atol=1e-6)


def test_the_cone_says_how_high_its_objects_are():
    cone = reconstruct(trace(), ReconstructionParameters(**LYING)).cone

    assert cone.object_rise_m == pytest.approx(LEVEL_M - HEIGHT_M)
    np.testing.assert_allclose(cone.ranges_m, [distance_m()], atol=1e-3)
    assert reconstruct(trace(), ReconstructionParameters()).cone.object_rise_m == 0.0


def test_echoes_over_the_floor_are_one_object_if_its_height_is_known():
    heard = trace(floor_reflectivity=0.6)

    told = reconstruct(heard, ReconstructionParameters(**LYING)).cone

    np.testing.assert_allclose(told.ranges_m, [distance_m()], atol=2e-3)
    assert len(reconstruct(heard, ReconstructionParameters()).cone.ranges_m) > 1


@pytest.mark.parametrize("pitch_rad", [0.0, 0.3, 1.2])
def test_the_footprint_is_where_the_beam_meets_the_objects_height(pitch_rad):
    cone = reconstruct(trace(pitch_rad), ReconstructionParameters(**LYING)).cone
    cells = footprint(cone, 0.1)

    centers_m = 0.1 * (np.stack([cells.columns, cells.rows], axis=-1) + 0.5)
    offsets_m = np.column_stack([centers_m, np.full(len(centers_m), LEVEL_M)])
    offsets_m -= cone.pose.position_m
    axis = Rotation.from_euler("ZYX", [0.3, pitch_rad, 0.0]).apply([1.0, 0.0, 0.0])
    cosine = offsets_m @ axis / np.linalg.norm(offsets_m, axis=-1)
    np.testing.assert_allclose(cells.range_m, np.linalg.norm(offsets_m, axis=-1))
    np.testing.assert_allclose(np.cos(cells.bearing_rad), cosine, atol=1e-9)
    assert cosine.min() > np.cos(0.6981317)
    # None is left out: a disc of 5 m holds all that is in the beam and in range.
    side = 0.1 * (np.arange(-60, 60) + 0.5)
    every_m = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    every_m = np.column_stack([every_m, np.full(len(every_m), LEVEL_M)]) - cone.pose.position_m
    distances = np.linalg.norm(every_m, axis=-1)
    inside = (every_m @ axis > np.cos(0.6981317) * distances) & (distances < 5.0)
    assert np.count_nonzero(inside & (distances > 0.2)) == len(cells.rows)


@pytest.mark.parametrize("rise_m", [-0.8, 0.0, 0.7])
def test_a_leg_over_the_floor_goes_to_the_mirror_image(rise_m):
    channel = Channel(343.0, floor_height_m=1.0, floor_reflectivity=0.5, object_rise_m=rise_m)
    ground_m = 2.0

    delays_s = channel.delays_s(np.array(np.hypot(ground_m, rise_m)))

    image_m = np.hypot(ground_m, 1.0 + (1.0 + rise_m))
    assert 343.0 * delays_s[-1] == pytest.approx(2.0 * image_m)
