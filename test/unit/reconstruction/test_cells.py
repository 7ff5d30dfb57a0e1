"""Traces explained by cells."""

import numpy as np
import pytest
from pydantic import ValidationError

from usmap_ros.acoustics.propagation import Channel
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.reconstruction.cells import cell_cone, reconstruct_cells

AT_EDGE = Pose.planar(0.0, 0.5, 0.0)
#: On the axis, and twice off it.
OBJECTS = [(7.5, 0.5), (3.5, 1.5), (5.5, -1.5)]
FLOOR = Channel(343.0, floor_height_m=1.0, floor_reflectivity=0.9)
SHARING = ["cosamp", "omp", "l1", "walls", "nnls"]
CHOOSING = ["integer", "binary"]
SOLVERS = [*SHARING, "tv", *CHOOSING]


def paper(solver="cosamp", **changes):
    return ReconstructionParameters(
        dictionary="cells", solver=solver, cell_size_m=1.0, sparsity=15, **changes
    )


def by_cell(found):
    return {
        tuple(center): value
        for center, value in zip(found.dictionary.cells.centers_m, found.coefficients, strict=True)
        if value > 1e-4
    }


@pytest.mark.parametrize("solver", SHARING)
@pytest.mark.parametrize("reception", ["square", "iq", "raw"])
def test_true_cells_and_their_mirror_images_share_and_nothing_else_is_found(
    hear, solver, reception
):
    trace = hear(OBJECTS, reception=reception, pose=AT_EDGE, max_range_m=10.0)
    found = reconstruct_cells(trace, paper(solver))

    assert by_cell(found) == pytest.approx(
        {(7.5, 0.5): 1.0, (3.5, 1.5): 0.5, (3.5, -0.5): 0.5, (5.5, -1.5): 0.5, (5.5, 2.5): 0.5},
        abs=1e-4,
    )
    assert found.relative_residual < (1e-5 if solver == "walls" else 1e-6)
    np.testing.assert_allclose(
        found.signal - found.dictionary.matrix @ found.coefficients, found.residual, atol=1e-9
    )


def test_total_variation_explains_the_trace_by_the_true_cells_and_their_mirror_images(hear):
    trace = hear(OBJECTS, reception="square", pose=AT_EDGE, max_range_m=10.0)
    found = by_cell(reconstruct_cells(trace, paper("tv")))

    assert set(found) == {(7.5, 0.5), (3.5, 1.5), (3.5, -0.5), (5.5, -1.5), (5.5, 2.5)}
    assert found[3.5, 1.5] + found[3.5, -0.5] == pytest.approx(1.0, abs=1e-4)


def test_objects_off_the_centres_are_not_explained(hear):
    off = [(x + 0.12, y + 0.12) for x, y in OBJECTS]
    trace = hear(off, reception="raw", pose=AT_EDGE, max_range_m=10.0)

    assert reconstruct_cells(trace, paper()).relative_residual > 0.5


@pytest.mark.parametrize("solver", SOLVERS)
def test_there_are_never_more_cells_than_the_sparsity(hear, solver):
    objects = np.random.default_rng(0).uniform([1.0, -3.0], [9.0, 3.0], (30, 2))
    trace = hear(objects, pose=AT_EDGE, noise_std=0.003, max_range_m=10.0)
    found = reconstruct_cells(trace, paper(solver))

    assert 0 < np.count_nonzero(found.coefficients) <= 15
    assert found.relative_residual <= 1.0
    assert np.all(found.coefficients >= 0.0)


@pytest.mark.parametrize("solver", SOLVERS)
def test_silence_is_empty(hear, solver):
    found = reconstruct_cells(hear([], max_range_m=10.0), paper(solver))

    assert not np.any(found.coefficients)
    assert found.relative_residual == 0.0


def test_noise_alone_is_no_object(hear):
    for seed in range(10):
        trace = hear([], noise_std=0.01, max_range_m=10.0, seed=seed)
        assert not np.any(reconstruct_cells(trace, paper()).coefficients)


def test_reflectivity_is_the_coefficient(hear):
    trace = hear([(4.5, 0.5)], [0.3], pose=AT_EDGE, max_range_m=10.0)

    assert by_cell(reconstruct_cells(trace, paper())) == pytest.approx({(4.5, 0.5): 0.3}, rel=1e-5)


def test_cone_has_the_range_and_loudness_of_each_echo(hear):
    trace = hear(OBJECTS, pose=AT_EDGE, noise_std=1e-4, max_range_m=10.0)
    parameters = paper()
    cone = cell_cone(trace, reconstruct_cells(trace, parameters), parameters)

    cone.validate()
    offset = np.array(sorted(OBJECTS)) - [0.0, 0.5]
    ranges_m = np.hypot(*offset.T)
    gains = trace.transducer.beam.gain(np.arctan2(offset[:, 1], offset[:, 0]))
    np.testing.assert_allclose(cone.ranges_m, ranges_m, rtol=1e-6)
    np.testing.assert_allclose(cone.amplitudes, gains / ranges_m**2, rtol=0.02)
    limits = cone.limit_amplitudes()
    assert limits[int((4.5 - 0.2) / cone.limit_step_m)] < cone.amplitudes[2]
    assert limits[int((ranges_m[0] - 0.2) / cone.limit_step_m)] > cone.amplitudes[0]


def test_cone_without_a_cell_says_nothing(hear):
    parameters = ReconstructionParameters(dictionary="cells", cell_size_m=2.0)
    trace = hear([(0.5, 0.0)], max_range_m=0.6, noise_std=0.01)
    cone = cell_cone(trace, reconstruct_cells(trace, parameters), parameters)

    cone.validate()
    assert len(cone.ranges_m) == 0
    assert np.all(cone.detection_limits == 255)


def test_other_solvers_need_the_dictionary_of_cells():
    with pytest.raises(ValidationError, match="needs the dictionary of cells"):
        ReconstructionParameters(solver="omp")
