"""Which cells an echo may have come from, and what it tells each of them."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from usmap_ros.cone import EchoCone
from usmap_ros.mapping.footprint import footprint
from usmap_ros.mapping.reflectivity import LogReflectivity, Silence, silence
from usmap_ros.mapping.ring import Ring, RingEvidence, find_ring, fit_to_ring, ring_evidence
from usmap_ros.parameters import MappingParameters

PARAMETERS = MappingParameters()
MakeCone = Callable[..., EchoCone]


def make_ring(count: int = 1, *, clutter: float = 0.003, log_reflectivity: float = -0.7) -> Ring:
    """One echo, and cells that fit its range equally well."""
    return Ring(
        cells=np.arange(count),
        cell=np.arange(count),
        echo=np.zeros(count, dtype=np.intp),
        range_fit=np.ones(count),
        log_reflectivity=np.full(count, log_reflectivity),
        variance=np.full(count, 0.02),
        clutter=np.full(count, clutter),
        echo_count=1,
    )


def tell(
    ring: Ring, probability: float | list[float], audibility: float = 0.95, bound: float = -3.0
) -> RingEvidence:
    """Evidence for cells of the default belief."""
    count = len(ring.cells)
    belief = LogReflectivity(np.full(count, 1.0 / 0.81), np.full(count, -0.7 / 0.81))
    heard = np.full(count, audibility)
    quiet = silence(belief, np.full(count, bound), heard, 0.15)
    return ring_evidence(ring, np.broadcast_to(probability, count), belief, quiet, heard)


@pytest.mark.parametrize("planar_covariance", [None, np.diag([9e-4, 9e-4, 1e-4])])
def test_find_ring_pairs_each_echo_with_all_cells_whose_range_it_fits(
    make_cone: MakeCone, planar_covariance: np.ndarray | None
) -> None:
    cone = make_cone(0.7, 0.72, 1.4, 2.9, x_m=0.013, planar_covariance=planar_covariance)
    cells = footprint(cone, 0.05)
    ring = find_ring(cone, cells, PARAMETERS)
    found = set(zip(ring.cells[ring.cell].tolist(), ring.echo.tolist(), strict=True))
    expected = {
        (cell, echo)
        for cell in range(len(cells.range_m))
        for echo, range_m in enumerate(cone.ranges_m)
        if abs(range_m - cells.range_m[cell])
        < cells.half_depth_m[cell] + 3.0 * np.hypot(cells.range_std_m[cell], 0.003)
    }
    assert len(expected) > 100
    assert found == expected
    assert len(np.unique(ring.cells)) == len(ring.cells)


def test_a_silent_cone_has_no_ring(make_cone: MakeCone) -> None:
    cone = make_cone()
    cells = footprint(cone, 0.05)
    ring = find_ring(cone, cells, PARAMETERS)
    assert (len(ring.cells), len(ring.cell), ring.echo_count) == (0, 0, 0)
    assert len(tell(ring, []).log_ratio) == 0


@pytest.mark.parametrize("row", [0, 6, 20], ids=["along a side", "aslant", "across a corner"])
def test_the_range_fit_is_that_of_an_object_anywhere_in_the_square(
    make_cone: MakeCone, row: int
) -> None:
    """By Monte Carlo: objects spread over the cell, ranges with the stated error."""
    resolution_m, column, x_m, y_m = 0.05, 20, 0.0125, 0.02
    center_m = (np.array([column, row]) + 0.5) * resolution_m
    yaw_rad = np.arctan2(center_m[1] - y_m, center_m[0] - x_m)
    echoes_m = np.hypot(*(center_m - [x_m, y_m])) + np.linspace(-0.045, 0.045, 7)
    parameters = MappingParameters(range_error_m=0.006)
    cone = make_cone(*echoes_m, x_m=x_m, y_m=y_m, yaw_rad=yaw_rad)
    cells = footprint(cone, resolution_m)
    ring = find_ring(cone, cells, parameters)
    place = int(np.flatnonzero((cells.rows == row) & (cells.columns == column))[0])
    pairs = np.flatnonzero(ring.cells[ring.cell] == place)
    assert len(pairs) >= 5

    generator = np.random.default_rng(1)
    objects_m = center_m + generator.uniform(-0.5, 0.5, (400_000, 2)) * resolution_m
    ranges_m = np.hypot(*(objects_m - [x_m, y_m]).T)
    ranges_m += np.hypot(0.006, 1e-3) * generator.standard_normal(len(ranges_m))
    width_m = 0.004
    share = [np.mean(np.abs(ranges_m - echoes_m[echo]) < width_m / 2) for echo in ring.echo[pairs]]
    # A density, scaled to the plateau of a box as deep as the square's projection at half height.
    plateau_m = 2.0 * cells.half_depth_m[place] - cells.taper_m[place]
    expected = np.array(share) * plateau_m / width_m
    np.testing.assert_allclose(ring.range_fit[pairs], expected, atol=0.06)


def test_an_amplitude_is_read_as_the_reflectivity_it_would_need(make_cone: MakeCone) -> None:
    cone = make_cone((1.0, 0.4), amplitude_std=0.04, attenuation_db_m=2.0)
    cells = footprint(cone, 0.05)
    ring = find_ring(cone, cells, PARAMETERS)
    place = ring.cells[ring.cell]
    spreading = cells.range_m[place] ** -2 * 10 ** (-2.0 * 2.0 * cells.range_m[place] / 20)
    gain = 1.0 - np.abs(cells.bearing_rad[place]) / np.deg2rad(40)
    np.testing.assert_allclose(
        ring.log_reflectivity, np.log(0.4 / (gain * spreading)), rtol=1e-5, atol=1e-5
    )
    np.testing.assert_allclose(ring.variance, 0.1**2 + PARAMETERS.fluctuation**2, rtol=1e-5)


def test_a_lone_cell_on_a_ring_is_told_the_closed_form() -> None:
    """ln of ((λ m + q) / λ), its ring-mates explaining nothing."""
    ring, audibility, bound = make_ring(), 0.95, -3.0
    belief = LogReflectivity(np.array([1.0 / 0.81]), np.array([-0.7 / 0.81]))
    heard = np.array([audibility])
    quiet = silence(belief, np.array([bound]), heard, 0.15)
    (returned,) = fit_to_ring(ring, belief, heard)
    assert returned == pytest.approx(0.95 * np.sqrt(0.02 / 0.83))
    expected = np.log(np.exp(quiet.log_ratio) + returned / 0.003)
    np.testing.assert_allclose(tell(ring, 0.3).log_ratio, expected, rtol=1e-12)


def test_a_lone_cell_is_told_the_same_however_probable_it_was() -> None:
    ratios = [tell(make_ring(), p).log_ratio[0] for p in (1e-6, 0.1, 0.9, 1.0)]
    assert ratios == pytest.approx([ratios[0]] * 4)


def test_a_believed_ring_mate_takes_the_credit() -> None:
    among_strangers = tell(make_ring(2), [2e-4, 2e-4]).log_ratio
    beside_a_known_one = tell(make_ring(2), [2e-4, 0.92]).log_ratio
    assert among_strangers[0] == among_strangers[1] > 3.0
    assert beside_a_known_one[0] < 0.5
    assert beside_a_known_one[1] == pytest.approx(among_strangers[0], abs=0.1)


def test_the_more_cells_share_an_echo_the_less_each_of_them_gains() -> None:
    gains = [tell(make_ring(count), 0.01).log_ratio[0] for count in (1, 4, 40, 400)]
    assert np.all(np.diff(gains) < 0.0)


def test_an_echo_of_a_strength_that_does_not_fit_tells_little() -> None:
    fitting = tell(make_ring(), 0.01).log_ratio
    too_loud = tell(make_ring(log_reflectivity=6.0), 0.01).log_ratio
    assert too_loud < 0.0 < fitting


def test_an_echo_that_clutter_explains_tells_little() -> None:
    assert tell(make_ring(clutter=0.9), 0.01).log_ratio < 0.2


def test_the_source_of_an_echo_learns_its_reflectivity() -> None:
    evidence = tell(make_ring(log_reflectivity=0.4), 0.9)
    assert evidence.precision == pytest.approx(1.0 / 0.02, rel=0.1)
    assert evidence.information / evidence.precision == pytest.approx(0.4, abs=0.1)


def test_evidence_does_not_depend_on_the_order_of_cells_and_pairs() -> None:
    generator = np.random.default_rng(3)
    cells, echoes, pairs = 12, 4, 30
    choice = generator.choice(cells * echoes, pairs, replace=False)
    ring = Ring(
        cells=np.arange(cells),
        cell=choice % cells,
        echo=choice // cells,
        range_fit=generator.uniform(0.0, 1.0, pairs),
        log_reflectivity=generator.normal(-0.7, 0.5, pairs),
        variance=np.full(pairs, 0.03),
        clutter=np.full(pairs, 0.003),
        echo_count=echoes,
    )
    probability = generator.uniform(0.0, 0.9, cells)
    expected = tell(ring, list(probability))

    shuffled_pairs, renamed = generator.permutation(pairs), generator.permutation(cells)
    shuffled = replace(
        ring,
        cell=renamed[ring.cell[shuffled_pairs]],
        echo=ring.echo[shuffled_pairs],
        range_fit=ring.range_fit[shuffled_pairs],
        log_reflectivity=ring.log_reflectivity[shuffled_pairs],
    )
    renamed_probability = np.empty(cells)
    renamed_probability[renamed] = probability
    found = tell(shuffled, list(renamed_probability))
    for name in ("log_ratio", "precision", "information"):
        np.testing.assert_allclose(
            getattr(found, name)[renamed], getattr(expected, name), rtol=1e-9, atol=1e-12
        )


@pytest.mark.parametrize("probability", [0.0, 1e-300, 0.5, 1.0])
@pytest.mark.parametrize("clutter", [1e-300, 1e-17, 0.003, 10.0])
@pytest.mark.parametrize("log_reflectivity", [-60.0, -0.7, 60.0])
@pytest.mark.parametrize("bound", [-60.0, 60.0])
def test_extremes_stay_finite(
    probability: float, clutter: float, log_reflectivity: float, bound: float
) -> None:
    ring = make_ring(7, clutter=clutter, log_reflectivity=log_reflectivity)
    evidence = tell(ring, probability, bound=bound)
    for values in (evidence.log_ratio, evidence.precision, evidence.information):
        assert np.all(np.isfinite(values))


def test_an_echo_of_no_strength_tells_nothing_wild(make_cone: MakeCone) -> None:
    cone = make_cone((1.0, 0.0), amplitude_std=0.0)
    ring = find_ring(cone, footprint(cone, 0.05), PARAMETERS)
    assert len(ring.cells) > 10
    assert np.all(np.isfinite(ring.log_reflectivity))
    evidence = tell(ring, 2e-4)
    assert np.all(evidence.log_ratio <= 0.0)
    assert np.all(np.isfinite(evidence.information))


def test_silence_is_all_that_a_ring_without_echoes_says() -> None:
    quiet = Silence(np.array([-0.5]), np.array([0.2]), np.array([-0.1]))
    nowhere = np.zeros(0)
    ring = Ring(
        np.array([0]), nowhere.astype(int), nowhere.astype(int), nowhere, nowhere, nowhere,
        nowhere, 0,
    )  # fmt: skip
    belief = LogReflectivity(np.array([1.0]), np.array([0.0]))
    evidence = ring_evidence(ring, np.array([0.1]), belief, quiet, np.array([0.9]))
    assert (evidence.log_ratio, evidence.precision, evidence.information) == (-0.5, 0.2, -0.1)
