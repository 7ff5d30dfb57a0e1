"""What few pings say of the cells that may have returned their echoes."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.special import expit, logit

from usmap_ros.mapping.grid import TILE_SIDE, TiledGrid
from usmap_ros.mapping.superposition import first_pings
from usmap_ros.mapping.superposition.cells import QUARTERS, Tiles
from usmap_ros.mapping.superposition.first_pings import Explained, explain, weigh_sources
from usmap_ros.mapping.superposition.ping_bins import ECHO, SILENCE, UNJUDGED, Look, look_of
from usmap_ros.mapping.superposition.sources import Sources
from usmap_ros.mapping.superposition.visible_cells import VisibleCells
from usmap_ros.mapping.superposition.workspace import Workspace
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

MakeCone = Callable[..., EchoCone]
PARAMETERS = MappingParameters()
RESOLUTION_M = PARAMETERS.resolution_m
#: Tiles along each side of the area, and the row and column of its first cell.
SIDE = 4
FIRST = -SIDE * TILE_SIDE // 2


class Area:
    """Tiles around the origin, and what some pings say of them."""

    def __init__(self) -> None:
        self.grid = TiledGrid(RESOLUTION_M, {"any": 0.0})
        corners = FIRST + TILE_SIDE * np.arange(SIDE)
        rows, columns = np.meshgrid(corners, corners, indexing="ij")
        self.grid.slots(rows.ravel(), columns.ravel())
        self.work = Workspace()

    def find(self, look: Look, among: np.ndarray) -> tuple[VisibleCells, int]:
        tiles = Tiles(*self.grid.directory, RESOLUTION_M)
        return self.work.see(look, tiles, np.zeros_like(among), among)

    def explained(self, *cones: EchoCone) -> Explained | None:
        looks = [look_of(cone, PARAMETERS) for cone in cones]
        return explain(looks, self.find, SIDE**2 * TILE_SIDE**2, PARAMETERS)

    def probabilities(self, *cones: EchoCone) -> tuple[np.ndarray, np.ndarray]:
        """Centres of the suspected cells, m, and the probability of each."""
        found = self.explained(*cones)
        assert found is not None
        chosen = np.zeros(SIDE**2 * TILE_SIDE**2, np.bool_)
        chosen[found.slots] = True
        rows, columns, slots = self.grid.cells(chosen)
        np.testing.assert_array_equal(slots, found.slots)
        centers_m = (np.column_stack([columns, rows]) + 0.5) * RESOLUTION_M
        return centers_m, -np.expm1(found.vacancy)


@pytest.fixture
def area() -> Area:
    return Area()


def near(centers_m: np.ndarray, probability: np.ndarray, x_m: float, y_m: float) -> float:
    """Probability that there is an object within a cell of a place."""
    close = np.abs(centers_m - [x_m, y_m]).max(axis=1) < 1.5 * RESOLUTION_M
    return float(1.0 - np.prod(1.0 - probability[close]))


def test_one_echo_has_one_source_somewhere_on_its_ring(area: Area, make_cone: MakeCone) -> None:
    centers_m, probability = area.probabilities(make_cone((1.5, 0.2)))
    assert probability.sum() == pytest.approx(0.95, abs=0.1)
    assert probability.max() < 0.1
    likely = probability > 0.01
    np.testing.assert_allclose(np.hypot(*centers_m[likely].T), 1.5, atol=0.06)
    left, right = (probability[side * centers_m[:, 1] > 0.0].sum() for side in (1, -1))
    assert left == pytest.approx(right, rel=1e-6)


def test_where_two_rings_of_equal_power_cross_there_is_the_object(
    area: Area, make_cone: MakeCone
) -> None:
    """Seen from the origin and from the right; both would be heard with amplitude 0.5 / r²."""
    place = np.array([1.2, 0.4])
    cones = []
    for x_m, y_m, yaw_rad in ((0.0, 0.0, 0.0), (1.0, -1.4, 1.4)):
        range_m = float(np.hypot(*(place - [x_m, y_m])))
        bearing = np.arctan2(place[1] - y_m, place[0] - x_m) - yaw_rad
        gain = make_cone().transducer.beam.gain(np.abs(bearing))
        cones.append(
            make_cone((range_m, 0.5 * gain / range_m**2), x_m=x_m, y_m=y_m, yaw_rad=yaw_rad)
        )
    centers_m, probability = area.probabilities(*cones)
    at_object = near(centers_m, probability, *place)
    assert at_object > 0.5
    elsewhere = np.abs(centers_m - place).max(axis=1) > 2 * RESOLUTION_M
    assert probability[elsewhere].max() < 0.1 * at_object
    # The same rings, with powers of which no single object can have both.
    loud = make_cone(
        (float(cones[1].ranges_m[0]), 8.0 * float(cones[1].amplitudes[0])),
        x_m=1.0, y_m=-1.4, yaw_rad=1.4,
    )  # fmt: skip
    assert near(*area.probabilities(cones[0], loud), *place) < 0.5 * at_object


def test_silence_from_where_it_would_be_heard_acquits(area: Area, make_cone: MakeCone) -> None:
    """A second robot looks at the left half of the ring and hears nothing there."""
    echo = make_cone((1.5, 0.3))
    silent = make_cone(x_m=1.2, y_m=1.8, yaw_rad=-1.57, max_range_m=1.8)
    before, after = area.probabilities(echo), area.probabilities(echo, silent)
    assert near(*after, 1.4, 0.5) < 0.2 * near(*before, 1.4, 0.5)
    assert near(*after, 1.4, -0.5) > near(*before, 1.4, -0.5)


def test_too_many_sources_are_not_weighed(
    area: Area, make_cone: MakeCone, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(first_pings, "MOST_PAIRS", 100)
    assert area.explained(make_cone((1.5, 0.2))) is None


def test_odds_are_those_of_all_cases_counted() -> None:
    """One echo and two quarters: there is no circle, so belief propagation is exact."""
    prior, detection_probability, density = 0.1, 0.95, np.array([[0.6, 0.2]])
    sources = Sources(
        row_of=np.zeros(1, np.int64),
        kind=np.full((1, 2), ECHO, np.uint8),
        bin=np.zeros((1, 2), np.int32),
        level=np.ones((1, 2), np.float32),
        weight=np.ones((1, 2), np.float32),
        fit=np.ones((1, 2), np.float32),
        noise=np.ones(1),
    )
    log_odds = np.empty(2)
    weigh_sources(sources, density, 1, detection_probability, float(logit(prior)), log_odds)
    for own, other in ((0, 1), (1, 0)):
        rest = first_pings.CLUTTER_DENSITY + prior * density[0, other]
        ratio = detection_probability * density[0, own] / rest + 1.0 - detection_probability
        expected = expit(logit(prior) + np.log(ratio))
        assert expit(log_odds[own]) == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize(("kind", "odds"), [(SILENCE, 0.95 * 0.3 + 0.05), (UNJUDGED, 1.0)])
def test_silence_counts_by_its_likelihood_and_what_is_not_judged_does_not(
    kind: int, odds: float
) -> None:
    sources = Sources(
        np.zeros(1, np.int64),
        np.full((1, QUARTERS), kind, np.uint8),
        np.zeros((1, QUARTERS), np.int32),
        *(np.ones((1, QUARTERS), np.float32) for _ in range(3)),
        np.ones(1),
    )
    log_odds = np.empty(QUARTERS)
    weigh_sources(sources, np.full((1, QUARTERS), 0.3), 1, 0.95, -2.0, log_odds)
    np.testing.assert_allclose(log_odds, -2.0 + np.log(odds), rtol=1e-6)
