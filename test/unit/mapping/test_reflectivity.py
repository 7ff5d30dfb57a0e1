"""What silence says of a cell, held against integrals over its reflectivity."""

import numpy as np
import pytest
from scipy.special import ndtr

from usmap_ros.mapping.reflectivity import LEAST_VARIANCE, LogReflectivity, Silence, silence

LN_S = np.linspace(-15.0, 15.0, 60_001)
FLUCTUATION = 0.15


def normal(mean: float, std: float) -> LogReflectivity:
    return LogReflectivity(np.array([std**-2]), np.array([mean * std**-2]))


def hear_nothing(belief: LogReflectivity, bound: float, detection_probability: float) -> Silence:
    return silence(belief, np.array([bound]), np.array([detection_probability]), FLUCTUATION)


def integrated(
    mean: float, std: float, bound: float, detection_probability: float
) -> tuple[float, float, float]:
    """Probability of silence, and mean and variance of ln s given it, by summing over ln s."""
    density = np.exp(-0.5 * ((LN_S - mean) / std) ** 2)
    density /= density.sum()
    weight = density * (
        1.0 - detection_probability + detection_probability * ndtr((bound - LN_S) / FLUCTUATION)
    )
    probability = weight.sum()
    after = weight @ LN_S / probability
    return probability, after, weight @ (LN_S - after) ** 2 / probability


@pytest.mark.parametrize("bound", [-6.0, -2.0, -0.7, 0.0, 1.5, 5.0])
@pytest.mark.parametrize("detection_probability", [0.05, 0.5, 0.95, 1.0])
@pytest.mark.parametrize(("mean", "std"), [(-0.7, 0.9), (0.3, 0.3), (0.0, 2.0)])
def test_the_ratio_is_the_integral_over_all_reflectivities(
    mean: float, std: float, bound: float, detection_probability: float
) -> None:
    probability, _, _ = integrated(mean, std, bound, detection_probability)
    heard = hear_nothing(normal(mean, std), bound, detection_probability)
    np.testing.assert_allclose(heard.log_ratio, np.log(probability), rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(heard.detection_probability, 1.0 - probability, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("bound", [-2.0, -0.7, 0.0, 1.5, 5.0])
@pytest.mark.parametrize(("mean", "std"), [(-0.7, 0.9), (0.3, 0.5), (0.0, 2.0)])
def test_silence_that_only_weakness_explains_moves_the_belief_to_its_true_moments(
    mean: float, std: float, bound: float
) -> None:
    _, mean_after, variance_after = integrated(mean, std, bound, detection_probability=1.0)
    belief = normal(mean, std)
    heard = hear_nothing(belief, bound, detection_probability=1.0)
    precision = belief.precision + heard.precision
    np.testing.assert_allclose(1.0 / precision, max(variance_after, LEAST_VARIANCE), rtol=1e-4)
    np.testing.assert_allclose(
        (belief.information + heard.information) / precision, mean_after, rtol=1e-4, atol=1e-6
    )


@pytest.mark.parametrize("detection_probability", [0.1, 0.6, 0.95])
def test_the_less_audible_a_cell_the_less_its_silence_says_of_its_reflectivity(
    detection_probability: float,
) -> None:
    belief = normal(-0.7, 0.9)
    faint = hear_nothing(belief, -0.7, detection_probability)
    clear = hear_nothing(belief, -0.7, 1.0)
    assert 0.0 < faint.precision[0] < clear.precision[0]
    assert clear.log_ratio[0] < faint.log_ratio[0] < 0.0


def test_repeated_silence_is_worth_less_and_less() -> None:
    belief, ratios = normal(-0.7, 0.9), []
    for _ in range(20):
        heard = hear_nothing(belief, -0.7, 0.95)
        ratios.append(float(heard.log_ratio[0]))
        belief = LogReflectivity(
            belief.precision + heard.precision, belief.information + heard.information
        )
    assert np.all(np.diff(ratios) > 0.0)
    assert ratios[-1] > 0.2 * ratios[0]
    independent = 20 * ratios[0]
    assert sum(ratios) > 0.5 * independent


@pytest.mark.parametrize("bound", [-1e6, -200.0, -8.01, -7.99, 0.0, 40.0, 1e6])
@pytest.mark.parametrize("std", [1e-3, 0.9, 5.0])
def test_far_tails_stay_finite_and_never_speak_for_an_object(bound: float, std: float) -> None:
    heard = hear_nothing(normal(-0.7, std), bound, 0.95)
    for values in (heard.log_ratio, heard.precision, heard.information):
        assert np.all(np.isfinite(values))
    assert np.log(1.0 - 0.95) - 1e-9 <= heard.log_ratio[0] <= 0.0
    assert heard.precision[0] >= 0.0


def test_beliefs_of_some_cells_are_those_cells() -> None:
    belief = LogReflectivity(np.array([1.0, 4.0, 2.0]), np.array([0.5, 2.0, -3.0]))
    chosen = belief.at(np.array([2, 1]))
    np.testing.assert_array_equal(chosen.variance, [0.5, 0.25])
    np.testing.assert_array_equal(chosen.mean, [-1.5, 0.5])
