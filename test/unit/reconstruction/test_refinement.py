"""Steps off the grid."""

import numpy as np
import pytest

from usmap_ros.acoustics.propagation import Channel
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.sampling import Sampling
from usmap_ros.reconstruction.cosamp import Halt, LeastSquares
from usmap_ros.reconstruction.delay_domain import DelayDomainOperator
from usmap_ros.reconstruction.refinement import delay_step
from usmap_ros.reconstruction.template import Template

SUPPORT = np.array([100, 300])
OFFSETS_S = np.array([3e-6, -2e-6])


@pytest.fixture(params=[0.0, 0.5], ids=["air", "floor"])
def operator(request):
    return DelayDomainOperator(
        Template(0.0, 3.2e-4, Pulse(PulseShape.HANN_BURST, 50e3, 3.2e-4)),
        Sampling(25_000.0, 0.0, 400),
        Channel(343.0, floor_height_m=request.param, floor_reflectivity=0.8),
        0.2,
        2.0,
        4,
        1e-4,
    )


@pytest.fixture
def heard(operator):
    truth = operator.moved(SUPPORT, OFFSETS_S)
    phases = np.exp(1j * np.arange(2 * operator.block_size))
    strengths = np.tile([1.0, 0.6, 0.3][: operator.block_size], 2)
    return truth.columns(SUPPORT) @ (phases * strengths)


def test_steps_lead_to_the_true_delays(operator, heard):
    at = operator
    for _ in range(6):
        solution = LeastSquares(at, heard, False).on(SUPPORT, 1, Halt.ITERATIONS)
        at = at.moved(SUPPORT, delay_step(at, solution)[0])
    found_s = 2.0 * (at.block_ranges_m(SUPPORT) - operator.ranges_m[SUPPORT]) / 343.0

    np.testing.assert_allclose(found_s, OFFSETS_S, atol=1e-8)


def test_deviation_is_the_scatter_over_noise(operator, heard):
    generator, noise_std, steps = np.random.default_rng(0), 0.003, []
    at = operator.moved(SUPPORT, OFFSETS_S)
    for _ in range(200):
        noise = generator.normal(size=(2, len(heard))) * noise_std / np.sqrt(2.0)
        solution = LeastSquares(at, heard + noise[0] + 1j * noise[1], False).on(
            SUPPORT, 1, Halt.ITERATIONS
        )
        step_s, unit_std_s = delay_step(at, solution)
        steps.append(step_s)

    np.testing.assert_allclose(
        np.std(steps, axis=0), noise_std / np.sqrt(2.0) * unit_std_s, rtol=0.2
    )


def test_step_is_never_longer_than_the_grid_step(operator, heard):
    solution = LeastSquares(operator, heard, False).on(SUPPORT + 6, 1, Halt.ITERATIONS)
    step_s, _ = delay_step(operator, solution)

    assert np.abs(step_s).max() <= operator.delay_step_s
