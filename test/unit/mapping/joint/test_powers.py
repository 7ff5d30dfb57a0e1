"""Powers of cells: the forward model, its gradient, and the updates that climb by it."""

import numpy as np
import pytest
from numpy.typing import NDArray

from usmap_ros.mapping.joint.forward_model.candidates import candidates, count_all_hits
from usmap_ros.mapping.joint.forward_model.power_estimation import (
    FIRST_POWER,
    LEAST_POWER,
    expect_powers,
    gather_gradients,
    power_limits,
    update_powers,
)
from usmap_ros.mapping.joint.kept_pings import KeptPings, Pings
from usmap_ros.mapping.joint.visibility.field import QUARTERS, Field, field_around
from usmap_ros.mapping.joint.visibility.projection import Projection, Scatterers, project
from usmap_ros.mapping.ping_bins import ECHO, SILENCE
from usmap_ros.mapping.ping_table import NOISE
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone


class Problem:
    """Pings, cells that may hold something, and what they return."""

    def __init__(self, cones: list[EchoCone]) -> None:
        parameters = MappingParameters()
        kept = KeptPings(parameters)
        for cone in cones:
            kept.add(cone, "robot")
        self.pings: Pings = kept.pings()
        self.field: Field = field_around(self.pings.table, self.pings.rows, parameters.resolution_m)
        table, rows, weights = self.pings[:3]
        cells = candidates(*count_all_hits(table, rows, weights, self.field))
        parts = np.tile(np.arange(QUARTERS, dtype=np.uint8), len(cells))
        self.power = np.full(len(parts), FIRST_POWER, np.float32)
        scatterers = Scatterers(np.repeat(cells, QUARTERS), parts)
        self.rows: Projection = project(table, rows, self.field, scatterers)

    def expected(self, power: NDArray[np.float32]) -> NDArray[np.float32]:
        table, rows = self.pings[:2]
        levels = np.ones((len(rows), table.kind.shape[1]), np.float32)
        expect_powers(table, rows, self.rows, power, levels)
        return levels

    def log_likelihood(self, power: NDArray[np.float32]) -> float:
        """Of what all bins returned, written down as it is in textbooks."""
        table, rows, weights = self.pings[:3]
        levels = self.expected(power).astype(float)
        total = 0.0
        for index, row in enumerate(rows):
            bins = table.bins[row]
            level, kind = levels[index, :bins], table.kind[row, :bins]
            is_echo, is_silent = kind == ECHO, kind == SILENCE
            loud = table.power[row, :bins][is_echo] / level[is_echo] + np.log(level[is_echo])
            limits = table.limit[row, :bins][is_silent]
            quiet = np.log(-np.expm1(-limits / level[is_silent]))
            total += float(weights[index]) * float(quiet.sum() - loud.sum())
        return total

    def gradients(self, power: NDArray[np.float32]) -> NDArray[np.float32]:
        gradients = np.zeros((len(power), 2), np.float32)
        gather_gradients(*self.pings[:3], self.rows, power, gradients)
        return gradients

    def sweep(self, power: NDArray[np.float32]) -> None:
        update_powers(power, self.gradients(power)[np.newaxis], LEAST_POWER)


@pytest.fixture
def problem(views: list[EchoCone]) -> Problem:
    return Problem(views)


def test_expectations_are_those_of_each_bin_by_itself(problem: Problem) -> None:
    """The share of a row's stretch that lies in a bin, but for silence that an echo outweighs."""
    table, rows = problem.pings[:2]
    for index, ping in enumerate(rows):
        own = slice(problem.rows.start[index], problem.rows.start[index + 1])
        low, high, heard = problem.rows.low[own], problem.rows.high[own], problem.rows.heard[own]
        bins = np.arange(table.bins[ping])[:, np.newaxis]
        inside = np.maximum(np.minimum(high, bins + 1) - np.maximum(low, bins), 0.0)
        is_silent = table.kind[ping, : len(bins), np.newaxis] == SILENCE
        inside[is_silent & (heard == 1)] = 0.0
        returned = inside @ (problem.rows.weight[own] * problem.power[problem.rows.scatterer[own]])
        levels = problem.expected(problem.power)[index, : len(bins)]
        np.testing.assert_allclose(levels, table.numbers[ping, NOISE] + returned, rtol=1e-4)


def test_without_power_only_noise_is_expected(problem: Problem) -> None:
    levels = problem.expected(np.zeros_like(problem.power))
    table, rows = problem.pings[:2]
    for index, row in enumerate(rows):
        np.testing.assert_allclose(levels[index, : table.bins[row]], table.numbers[row, NOISE])


def test_expectations_add_up(problem: Problem) -> None:
    """What two sets of cells return together is what each returns, with the noise once."""
    chosen = np.random.default_rng(3).random(problem.power.shape) < 0.5
    one, other = np.where(chosen, problem.power, 0), np.where(chosen, 0, problem.power)
    nothing = problem.expected(np.zeros_like(problem.power))
    together = problem.expected(one.astype(np.float32)) + problem.expected(other.astype(np.float32))
    np.testing.assert_allclose(together - nothing, problem.expected(problem.power), rtol=1e-3)


def test_the_gradient_is_that_of_the_likelihood(problem: Problem) -> None:
    random = np.random.default_rng(5)
    power = problem.power * random.uniform(0.3, 3.0, problem.power.shape).astype(np.float32)
    raises, lowers = problem.gradients(power).T
    gradient = (raises - lowers).astype(float)
    for quarter in np.argsort(-np.abs(gradient * power))[:20]:
        step = 0.02 * power[quarter]
        higher, lower = power.copy(), power.copy()
        higher[quarter] += step
        lower[quarter] -= step
        change = problem.log_likelihood(higher) - problem.log_likelihood(lower)
        slope = change / float(higher[quarter] - lower[quarter])
        assert slope == pytest.approx(gradient[quarter], rel=0.03)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_sweeps_explain_pings_better_and_better(problem: Problem, seed: int) -> None:
    random = np.random.default_rng(seed)
    power = problem.power * random.uniform(0.5, 2.0, problem.power.shape).astype(np.float32)
    likelihoods = [problem.log_likelihood(power)]
    for _ in range(12):
        problem.sweep(power)
        likelihoods.append(problem.log_likelihood(power))
    # Nothing is lost but what weak quarters returned that vanish.
    assert np.diff(likelihoods).min() > -0.5
    assert likelihoods[-1] > likelihoods[0] + 100.0


def test_quarters_that_no_echo_needs_vanish(problem: Problem) -> None:
    power = problem.power.copy()
    for _ in range(30):
        problem.sweep(power)
    assert 0 < np.count_nonzero(power) < 0.5 * np.count_nonzero(problem.power)


def test_what_is_of_interest_is_as_faint_as_most_echoes(problem: Problem) -> None:
    """A wall that mirrors nearly all sound scatters a thousandth of what a rough one does."""
    table, rows = problem.pings[:2]
    assert power_limits(table, rows) == (FIRST_POWER, LEAST_POWER)
    faint, fainter = (
        power_limits(table._replace(power=table.power * share), rows)
        for share in (np.float32(1e-4), np.float32(1e-5))
    )
    np.testing.assert_allclose(faint, 10.0 * np.array(fainter), rtol=1e-5)
    assert faint.first < FIRST_POWER
    assert faint.least < LEAST_POWER


def test_silence_leaves_usual_limits(problem: Problem) -> None:
    table, rows = problem.pings[:2]
    silent = table._replace(kind=np.full_like(table.kind, SILENCE))
    assert power_limits(silent, rows) == (FIRST_POWER, LEAST_POWER)
