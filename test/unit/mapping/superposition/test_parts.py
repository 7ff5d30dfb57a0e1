"""The parts of superposition, held against plain computations."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.special import expit, logit

from usmap_ros.mapping.footprint import footprint
from usmap_ros.mapping.grid import TILE_SIDE, TiledGrid
from usmap_ros.mapping.robot_check.agreement import log_likelihood
from usmap_ros.mapping.superposition.cells import QUARTERS, Tiles, slot_at
from usmap_ros.mapping.superposition.free_space import prove_free
from usmap_ros.mapping.superposition.inverse_sensor_model import Bounds, add_gain
from usmap_ros.mapping.superposition.log_odds import (
    Scale,
    beside_free_space,
    calibrated,
    evidence_of,
    uncalibrated,
)
from usmap_ros.mapping.superposition.ping_bins import ECHO, NEVER, SILENCE, Look, look_of
from usmap_ros.mapping.superposition.ping_update import learn
from usmap_ros.mapping.superposition.power_estimation import (
    Powers,
    find_unexplained,
    gradient_between,
    weigh_bins,
)
from usmap_ros.mapping.superposition.ray_casting import HIDDEN, OWN_STEPS
from usmap_ros.mapping.superposition.workspace import Workspace
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

MakeCone = Callable[..., EchoCone]
PARAMETERS = MappingParameters()


class Area:
    """Four tiles around the origin, with room for what stands there."""

    def __init__(self) -> None:
        grid = TiledGrid(0.05, {"any": 0.0})
        grid.slots(np.array([-1, -1, 0, 0]), np.array([-1, 0, -1, 0]))
        self.tiles = Tiles(*grid.directory, 0.05)
        slots = 4 * TILE_SIDE**2
        self.nothing = np.zeros(slots, np.float32)
        self.powers = Powers(
            *(np.zeros(slots * QUARTERS, np.float32) for _ in range(3)),
            looks=np.zeros(slots, np.float32),
            alive=np.zeros(slots, np.float32),
        )
        self.work = Workspace()

    def slot(self, x_m: float, y_m: float) -> int:
        return slot_at(int(y_m // 0.05), int(x_m // 0.05), self.tiles)

    def suspect(self, x_m: float, y_m: float, power: float = 0.05) -> int:
        slot = self.slot(x_m, y_m)
        self.powers.power[slot * QUARTERS : (slot + 1) * QUARTERS] = power
        self.powers.alive[slot] = 1.0
        return slot

    def power(self, slot: int) -> float:
        return float(self.powers.power[slot * QUARTERS : (slot + 1) * QUARTERS].sum())

    def see(self, look: Look) -> int:
        """Work out what is expected of the suspected cells; returns how many are seen."""
        return self.work.expect(
            look, self.tiles, self.nothing, self.powers.alive, self.powers.power
        )

    def expected(self, look: Look) -> np.ndarray:
        self.see(look)
        return self.work.scratch.bins.expected[: len(look.kind)].copy()

    def learn(self, look: Look) -> float:
        """Learn from a look; returns its log-likelihood before."""
        before = float(log_likelihood(look, self.expected(look)).sum())
        learn(look, self.see(look), self.powers, 0.5, self.work.scratch)
        return before


@pytest.fixture
def area() -> Area:
    return Area()


def test_a_cells_slot_is_found_in_any_tile(area: Area) -> None:
    assert slot_at(0, 0, area.tiles) == slot_at(1, 0, area.tiles) - TILE_SIDE
    assert slot_at(TILE_SIDE, 0, area.tiles) == slot_at(0, -TILE_SIDE - 1, area.tiles) == -1
    places = [(row, column) for row in range(-64, 64, 7) for column in range(-64, 64, 5)]
    assert len({slot_at(*place, area.tiles) for place in places}) == len(places)


@pytest.mark.parametrize("yaw_rad", [0.0, 1.1, -2.6])
def test_the_cells_in_a_cone_are_those_of_its_footprint(
    area: Area, make_cone: MakeCone, yaw_rad: float
) -> None:
    cone = make_cone(x_m=0.21, y_m=-0.33, yaw_rad=yaw_rad, max_range_m=2.5)
    look, cells = look_of(cone, PARAMETERS), footprint(cone, 0.05)
    seen, count = area.work.see(look, area.tiles, area.nothing, area.nothing + 1.0)
    weight = np.exp(2.0 * cells.log_unit_amplitude)
    loud = weight * cells.range_m**4 > 4.2e-4
    found = dict(
        zip(zip(seen.row[:count], seen.column[:count], strict=True), range(count), strict=True)
    )
    expected = list(zip(cells.rows[loud], cells.columns[loud], strict=True))
    assert set(expected) <= set(found)
    assert set(found) <= set(zip(cells.rows, cells.columns, strict=True))
    places = [found[cell] for cell in expected]
    np.testing.assert_allclose(seen.weight[places], weight[loud], rtol=0.03)
    np.testing.assert_allclose(seen.bearing[places], cells.bearing_rad[loud], atol=1e-5)
    # Four quarters lie about the cell's own range.
    middle_m = 0.5 * (seen.low[places] + seen.high[places]).mean(axis=1) * look.bin_m + 0.1
    np.testing.assert_allclose(middle_m, cells.range_m[loud], atol=1e-4)


def test_all_of_an_objects_power_is_expected_around_its_range(
    area: Area, make_cone: MakeCone
) -> None:
    """G² r⁻⁴ v for each of the four quarters of both cells, and noise in every bin."""
    look = look_of(make_cone(), PARAMETERS)
    assert area.expected(look) == pytest.approx(np.full(len(look.kind), look.noise))
    area.suspect(1.525, 0.025, 0.05)
    area.suspect(2.025, -0.475, 0.2)
    signal = area.expected(look) - look.noise
    direct = 0.0
    for x_m, y_m, power in ((1.525, 0.025, 0.2), (2.025, -0.475, 0.8)):
        gain = 1.0 - np.arctan2(abs(y_m), x_m) / look.half_angle_rad
        direct += power * gain**2 / np.hypot(x_m, y_m) ** 4
    assert signal.sum() == pytest.approx(direct, rel=0.02)
    lit = np.flatnonzero(signal > 1e-9) * look.bin_m + 0.1
    assert lit.min() > 1.525 - 0.05
    assert lit.max() < 2.08 + 0.06
    assert not np.any((lit > 1.6) & (lit < 2.0))


def test_a_blurred_quarter_belongs_where_there_is_an_echo(area: Area, make_cone: MakeCone) -> None:
    """Otherwise to its middle: silence at its rim says nothing of it."""
    exact = look_of(make_cone((1.5125, 0.2)), PARAMETERS)
    looks = [exact._replace(range_std_m=0.0), exact._replace(range_std_m=0.03)]
    near, far = area.suspect(1.5375, 0.0125), area.suspect(2.5125, 0.0125)
    width, heard, density = {}, {}, {}
    for sharp, look in zip((True, False), looks, strict=True):
        area.see(look)
        seen = area.work.scratch.seen
        for slot in (near, far):
            place = seen.place[slot]
            width[sharp, slot] = seen.high[place] - seen.low[place]
            heard[sharp, slot] = seen.heard[place].copy()
            density[sharp, slot] = seen.density[place]
    assert np.all(heard[False, near])
    assert not np.any(heard[False, far])
    assert np.all(width[False, near] > 3.0 * width[True, near])
    np.testing.assert_allclose(width[False, far], width[True, far], rtol=1e-5)
    # In each bin it is expected as strong as without the blur: it stands in one place.
    assert density[False, near] == density[True, near]


def test_unexplained_echoes_are_those_much_stronger_than_expected(
    area: Area, make_cone: MakeCone
) -> None:
    look = look_of(make_cone((1.0125, 0.2), (2.0125, 0.1)), PARAMETERS)
    first, second = np.flatnonzero(look.kind == ECHO)
    area.expected(look)
    bins, following = area.work.scratch.bins, np.empty(len(look.kind) + 1, np.int32)
    assert find_unexplained(look, bins, following)
    assert list(following[[0, first, first + 1, second]]) == [first, first, second, second]
    assert np.all(following[second + 1 :] == NEVER)
    bins.expected[[first, second]] = 0.04, 0.01
    assert not find_unexplained(look, bins, following)
    bins.expected[second] = 0.001
    assert find_unexplained(look, bins, following)
    assert following[0] == second


@pytest.mark.parametrize("heard", [False, True])
@pytest.mark.parametrize(("low", "high"), [(3.2, 3.9), (3.2, 8.7), (-2.0, 4.5), (110.0, 900.0)])
def test_gradients_are_summed_over_stretches_of_range_bins(
    area: Area, make_cone: MakeCone, low: float, high: float, heard: bool
) -> None:
    """Beside silence, only if nothing was heard in the stretch."""
    look = look_of(make_cone((0.15, 0.3), (1.5125, 0.2)), PARAMETERS)
    for x_m in np.arange(0.1, 3.0, 0.05):
        area.suspect(float(x_m), 0.0125, 0.3)
    area.expected(look)
    bins, count = area.work.scratch.bins, len(look.kind)
    weigh_bins(look, bins)
    raises, lowers = np.diff(bins.gradient[: count + 1, :2], axis=0).T
    assert np.count_nonzero(raises) > 30
    covered = np.clip(
        np.minimum(np.arange(count) + 1, high) - np.maximum(np.arange(count), low), 0, 1
    )
    if heard:
        covered[look.kind == SILENCE] = 0.0
    found = gradient_between(bins, count, low, high, heard)
    np.testing.assert_allclose(found, (covered @ raises, covered @ lowers), rtol=1e-6, atol=1e-9)


def test_the_power_of_a_lone_reflector_is_learnt(area: Area, make_cone: MakeCone) -> None:
    """It is expected as strong as it was heard, in the bin in which it was."""
    slot = area.suspect(1.5125, 0.0125)
    look = look_of(make_cone((1.5125, 0.2)), PARAMETERS)
    for _ in range(60):
        area.learn(look)
    (echo,) = np.flatnonzero(look.kind == ECHO)
    assert area.expected(look)[echo] == pytest.approx(0.04, rel=0.1)
    assert 0.04 * 1.5**4 < area.power(slot) < 6.0 * 0.04 * 1.5**4


def test_the_powers_of_two_reflectors_are_told_apart(area: Area, make_cone: MakeCone) -> None:
    near, far = area.suspect(1.0125, 0.0125), area.suspect(2.0125, 0.0125)
    look = look_of(make_cone((1.0125, 0.2), (2.0125, 0.1)), PARAMETERS)
    for _ in range(60):
        area.learn(look)
    np.testing.assert_allclose(area.expected(look)[look.kind == ECHO], [0.04, 0.01], rtol=0.1)
    assert area.power(far) / area.power(near) == pytest.approx(0.25 * 16.0, rel=0.3)


def test_what_is_never_heard_loses_its_power(area: Area, make_cone: MakeCone) -> None:
    slot = area.suspect(1.5125, 0.0125)
    for _ in range(30):
        area.learn(look_of(make_cone(), PARAMETERS))
    assert area.power(slot) == 0.0
    assert area.powers.alive[slot] == 0.0


def test_learning_again_from_a_ping_makes_it_no_less_likely(
    area: Area, make_cone: MakeCone
) -> None:
    for x_m in np.arange(0.9875, 2.0, 0.05):
        area.suspect(float(x_m), 0.0125, 0.3)
    look = look_of(make_cone((1.1, 0.3), (1.31, 0.1), (1.7, 0.2)), PARAMETERS)
    likelihood = [area.learn(look) for _ in range(40)]
    assert likelihood[-1] > likelihood[0] + 10.0
    assert np.min(np.diff(likelihood)) > -0.5


BOUNDS = Bounds(of_a_bin=8.0, of_all=60.0, forgetting=0.06)


def test_evidence_stays_within_its_bounds_on_either_side() -> None:
    sums = np.zeros(3, np.float32)
    for _ in range(100):
        add_gain(sums, 1, 4.0, BOUNDS)
    assert sums[1] == 60.0
    assert np.count_nonzero(sums) == 1
    for _ in range(100):
        add_gain(sums, 1, -4.0, BOUNDS)
    assert sums[1] == -15.0


def test_a_contradiction_makes_a_cell_forget() -> None:
    sums = np.full(1, 50.0, np.float32)
    add_gain(sums, 0, -1.0, BOUNDS)
    assert sums[0] == pytest.approx(46.0)
    add_gain(sums, 0, -0.1, BOUNDS)  # too little to be a contradiction
    assert sums[0] == pytest.approx(45.9)


def test_rays_behind_an_opaque_wall_are_dark(area: Area, make_cone: MakeCone) -> None:
    look = look_of(make_cone(x_m=0.025, y_m=0.025), PARAMETERS)
    depth = area.nothing.copy()
    for y_m in np.arange(-0.375, 0.4, 0.05):
        depth[area.slot(1.025, y_m)] = 5.0
    area.work.see(look, area.tiles, depth, depth)
    step_m, in_sight = area.work.scratch.rays.step_m, area.work.scratch.rays.in_sight.T
    middle = len(in_sight) // 2
    at_m = (np.arange(in_sight.shape[1]) + 0.5) * step_m
    assert np.all(in_sight[middle, at_m < 1.04] == 1.0)  # the wall does not hide itself
    assert np.all(in_sight[middle, at_m > 1.2] < 0.01)
    assert np.all(in_sight[0] == 1.0)


@pytest.mark.parametrize("seed", range(5))
def test_shadows_are_those_of_rays_followed_step_by_step(
    area: Area, make_cone: MakeCone, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    look = look_of(make_cone(x_m=0.02, y_m=0.01, yaw_rad=rng.uniform(-0.2, 0.2)), PARAMETERS)
    depth = area.nothing.copy()
    cells_m = np.arange(0.325, 2.0, 0.05), np.arange(-0.675, 0.7, 0.05)
    for x_m, y_m in zip(*(rng.choice(at_m, 30) for at_m in cells_m), strict=True):
        depth[area.slot(x_m, y_m)] = rng.uniform(0.1, 3.0)
    area.work.see(look, area.tiles, depth, depth)
    rays = area.work.scratch.rays
    steps, count = rays.in_sight.shape
    off_rad = ((np.arange(count) + 0.5) / count * 2.0 - 1.0) * look.half_angle_rad
    at_m = (np.arange(steps) + 0.5) * rays.step_m
    for ray, angle in enumerate(look.heading_rad + off_rad):
        x_m, y_m = look.x_m + at_m * np.cos(angle), look.y_m + at_m * np.sin(angle)
        inside = (x_m < 2.2) & (np.abs(y_m) < 1.5)
        passed = [
            np.exp(-depth[area.slot(x, y)] * rays.step_m / 0.05) if is_inside else 1.0
            for x, y, is_inside in zip(x_m, y_m, inside, strict=True)
        ]
        expected = np.cumprod([1.0] * OWN_STEPS + passed[:-OWN_STEPS])
        np.testing.assert_allclose(
            rays.in_sight[:, ray], np.where(expected < HIDDEN, 0.0, expected), rtol=1e-4
        )


def test_proof_ends_a_cell_before_what_the_sound_came_back_from(
    area: Area, make_cone: MakeCone
) -> None:
    look = look_of(make_cone(x_m=0.025, y_m=0.025), PARAMETERS)
    area.work.see(look, area.tiles, area.nothing, area.nothing)
    rays, clear = area.work.scratch.rays, area.nothing.copy()
    rays.proven_m[:] = 0.0
    rays.proven_m[len(rays.proven_m) // 2] = 1.5
    prove_free(look, area.tiles, rays, clear)
    assert clear[area.slot(1.4, 0.03)] == 1.0
    assert clear[area.slot(1.53, 0.03)] == 0.0
    assert clear.sum() == pytest.approx(29, abs=2)
    assert clear.max() == 1.0


def test_calibration_keeps_the_order_and_can_be_undone() -> None:
    scale = Scale(16.0, 0.5, -10.0, 2.5, -5.3)
    raw = np.linspace(-8.0, 40.0, 400).astype(np.float32)
    shown = calibrated(raw, scale)
    assert np.all(np.diff(shown) > 0.0)
    np.testing.assert_allclose(uncalibrated(shown, scale), evidence_of(raw, scale), atol=0.02)
    # A little below the threshold a cell is not yet occupied; beyond it, it is.
    assert shown[raw < -0.5].max() < logit(0.65) < shown[raw > 0.5].min()


def test_beside_free_space_less_evidence_is_enough_for_a_surface() -> None:
    """The order stays, and what is more certain or more unlikely stays as it is."""
    scale = Scale(16.0, 0.5, -10.0, 2.5, -5.3)
    evidence = np.array([0.0, 0.1, 0.4, 0.9, 2.0, 5.0])
    above = scale.slope * scale.threshold * (evidence - 1.0)
    raw = np.where(evidence > 1.0, above, scale.prior * (1.0 - evidence)).astype(np.float32)
    elsewhere = calibrated(raw, scale)
    shown = beside_free_space(raw, elsewhere, scale)
    np.testing.assert_array_equal(shown[[0, 1, 4, 5]], elsewhere[[0, 1, 4, 5]])
    assert np.all(np.diff(shown) >= 0.0)
    assert np.all(expit(elsewhere[2:4]) < 0.65)
    assert np.all(expit(shown[2:4]) > 0.65)
