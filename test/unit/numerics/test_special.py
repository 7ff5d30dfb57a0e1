"""The functions that stand in for SciPy's give what SciPy's do."""

import numpy as np
import pytest
from scipy import ndimage
from scipy import special as scipy_special

from usmap_ros.mapping.normals import CellsBeside, connected_parts
from usmap_ros.numerics.arrays import quantiles
from usmap_ros.numerics.special import entropy, logistic, logit, normal_quantile, running_maximum


@pytest.mark.parametrize("probability", [1e-12, 0.01, 0.3, 0.5, 0.65, 1.0 - 1e-9])
def test_log_odds_of_a_probability(probability):
    assert logit(probability) == pytest.approx(scipy_special.logit(probability), rel=1e-12)
    assert float(logit(np.array([probability]))[0]) == logit(probability)
    assert normal_quantile(probability) == pytest.approx(scipy_special.ndtri(probability))


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_probabilities_of_log_odds_keep_their_precision(kind):
    log_odds = np.array([-800.0, -80.0, -3.0, 0.0, 0.1, 40.0, 800.0], kind)
    found = logistic(log_odds)
    assert found.dtype == kind
    np.testing.assert_allclose(found, scipy_special.expit(log_odds), rtol=1e-5)


def test_what_is_certain_has_no_entropy():
    probability = np.array([0.0, 1e-9, 0.2, 1.0])
    np.testing.assert_allclose(entropy(probability), scipy_special.entr(probability), atol=1e-15)


@pytest.mark.parametrize("width", [1, 3, 5, 9, 31])
@pytest.mark.parametrize("shape", [(1,), (20,), (12, 7)])
def test_running_maxima(width, shape):
    values = np.random.default_rng(width).normal(size=shape)
    expected = ndimage.maximum_filter1d(values, width, axis=0, mode="nearest")
    np.testing.assert_array_equal(running_maximum(values, width), expected)


@pytest.mark.parametrize("share", [0.0, 0.1, 0.4, 0.6, 1.0])
def test_connected_parts(share):
    inside = np.random.default_rng(1).random((40, 30)) < share
    expected, count = ndimage.label(inside, structure=np.ones((3, 3)))
    found = connected_parts(CellsBeside(inside, 1))
    # The same parts, under whatever numbers.
    together = np.unique(np.stack([found, expected[inside]]), axis=1)
    assert together.shape[1] == count == len(np.unique(found))


@pytest.mark.parametrize("count", [1, 2, 20, 745])
def test_quantiles_are_those_of_numpy(count):
    values = np.random.default_rng(count).normal(size=count)
    shares = (0.0, 0.05, 0.25, 1.0)
    np.testing.assert_allclose(quantiles(values, *shares), np.quantile(values, shares))
