"""What few pings say of the cells that may have returned their echoes."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.special import expit, logit

from usmap_ros.mapping.joint import first_pings
from usmap_ros.mapping.joint.first_pings import PlaceReadings, first_log_odds, weigh_sources
from usmap_ros.mapping.joint.forward_model.log_odds import NOTHING
from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.mapping.ping_bins import ECHO, SILENCE, UNJUDGED
from usmap_ros.mapping.ping_table import ping_in_row, ping_table_of
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

MakeCone = Callable[..., EchoCone]
PARAMETERS = MappingParameters()
RESOLUTION_M = PARAMETERS.resolution_m
FIELD = Field(-80, -80, 160, 160, RESOLUTION_M)


def log_odds_of(*cones: EchoCone) -> np.ndarray | None:
    table = ping_table_of(cones, PARAMETERS)
    all_bins = [ping_in_row(table, row) for row in range(len(cones))]
    return first_log_odds(all_bins, FIELD, PARAMETERS)


def probabilities(*cones: EchoCone) -> tuple[np.ndarray, np.ndarray]:
    """Centres of the suspected cells, m, and the probability of each."""
    log_odds = log_odds_of(*cones)
    assert log_odds is not None
    rows, columns = np.nonzero(log_odds > NOTHING)
    centers_m = (np.column_stack([columns, rows]) - 80 + 0.5) * RESOLUTION_M
    return centers_m, expit(log_odds[rows, columns])


def heard(kind: int, places: int, pings: int = 1) -> PlaceReadings:
    ones = np.ones((pings, places))
    return PlaceReadings(
        np.full((pings, places), kind, np.uint8), np.zeros((pings, places), int), *[ones] * 4
    )


def near(centers_m: np.ndarray, probability: np.ndarray, x_m: float, y_m: float) -> float:
    """Greatest probability within a cell of a place."""
    close = np.abs(centers_m - [x_m, y_m]).max(axis=1) < 1.5 * RESOLUTION_M
    return float(probability[close].max(initial=0.0))


def test_one_echo_has_one_source_somewhere_on_its_ring(make_cone: MakeCone) -> None:
    centers_m, probability = probabilities(make_cone((1.5, 0.2)))
    assert probability.max() < 0.2
    np.testing.assert_allclose(np.hypot(*centers_m.T), 1.5, atol=0.06)
    left, right = (probability[side * centers_m[:, 1] > 0.0].sum() for side in (1, -1))
    assert left == pytest.approx(right, rel=1e-6)


def test_where_two_rings_of_equal_power_cross_there_is_the_object(make_cone: MakeCone) -> None:
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
    centers_m, probability = probabilities(*cones)
    at_object = near(centers_m, probability, *place)
    assert at_object > 0.5
    elsewhere = np.abs(centers_m - place).max(axis=1) > 2 * RESOLUTION_M
    assert probability[elsewhere].max() < 0.2 * at_object
    # The same rings, with powers of which no single object can have both.
    loud = make_cone(
        (float(cones[1].ranges_m[0]), 8.0 * float(cones[1].amplitudes[0])),
        x_m=1.0, y_m=-1.4, yaw_rad=1.4,
    )  # fmt: skip
    assert near(*probabilities(cones[0], loud), *place) < 0.5 * at_object


def test_silence_from_where_it_would_be_heard_acquits(make_cone: MakeCone) -> None:
    """A second robot looks at the left half of the ring and hears nothing there."""
    echo = make_cone((1.5, 0.3))
    silent = make_cone(x_m=1.2, y_m=1.8, yaw_rad=-1.57, max_range_m=1.8)
    before, after = probabilities(echo), probabilities(echo, silent)
    assert near(*after, 1.4, 0.5) < 0.2 * near(*before, 1.4, 0.5)
    assert near(*after, 1.4, -0.5) > near(*before, 1.4, -0.5)


def test_pings_from_one_place_are_one_look(make_cone: MakeCone) -> None:
    echo = make_cone((1.5, 0.3))
    once, often = probabilities(echo), probabilities(*[echo] * 9)
    np.testing.assert_array_equal(once[0], often[0])
    np.testing.assert_array_equal(once[1], often[1])


def test_too_many_sources_are_not_weighed(
    make_cone: MakeCone, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert log_odds_of(*[make_cone((1.5, 0.2), x_m=0.1 * n) for n in range(7)]) is None
    monkeypatch.setattr(first_pings, "MOST_PAIRS", 100)
    assert log_odds_of(make_cone((1.5, 0.2))) is None


def test_odds_are_those_of_all_cases_counted() -> None:
    """One echo and two quarters: there is no circle, so belief propagation is exact."""
    prior, detection_probability, density = 0.1, 0.95, np.array([[0.6, 0.2]])
    log_odds = weigh_sources(heard(ECHO, 2), density, detection_probability, float(logit(prior)))
    for own, other in ((0, 1), (1, 0)):
        rest = first_pings.CLUTTER_DENSITY + prior * density[0, other]
        ratio = detection_probability * density[0, own] / rest + 1.0 - detection_probability
        expected = expit(logit(prior) + np.log(ratio))
        assert expit(log_odds[own]) == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize(("kind", "odds"), [(SILENCE, 0.95 * 0.3 + 0.05), (UNJUDGED, 1.0)])
def test_silence_counts_by_its_likelihood_and_what_is_not_judged_does_not(
    kind: int, odds: float
) -> None:
    log_odds = weigh_sources(heard(kind, 4), np.full((1, 4), 0.3), 0.95, -2.0)
    np.testing.assert_allclose(log_odds, -2.0 + np.log(odds), rtol=1e-6)
