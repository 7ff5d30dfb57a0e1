"""Places that were looked at from one side only: what stands there may be elsewhere on its arc."""

import math

import numpy as np
import pytest

from usmap_ros.mapping.joint.forward_model.cell_evidence import CellEvidence
from usmap_ros.mapping.joint.free_space.one_sided import (
    LEAST_HEARD,
    SURE,
    one_sided_share,
    spreads,
    surely_returned,
)
from usmap_ros.numerics.arrays import BoolArray, FloatArray

SHAPE = (9, 9)
#: Two cells that are apart.
HERE, THERE = (2, 2), (6, 6)


def heard_from(directions_rad: dict[tuple[int, int], list[float]]) -> CellEvidence:
    """Evidence of cells, each of which was heard once from each of its directions."""
    sums = {name: np.zeros(SHAPE, np.float32) for name in CellEvidence._fields}
    for cell, directions in directions_rad.items():
        sums["heard"][cell] = len(directions)
        sums["axis_cos"][cell] = sum(math.cos(2.0 * each) for each in directions)
        sums["axis_sin"][cell] = sum(math.sin(2.0 * each) for each in directions)
    return CellEvidence(**{name: values.ravel() for name, values in sums.items()})


def cells(*some: tuple[int, int]) -> BoolArray:
    are = np.zeros(SHAPE, bool)
    for cell in some:
        are[cell] = True
    return are


def power_left(evidence: CellEvidence, one_sided: float) -> FloatArray:
    """Share of their power that cells surely return."""
    power = np.full(SHAPE, 2.0, np.float32)
    return surely_returned(evidence, cells(HERE, THERE), power, one_sided) / power


def test_spread_is_that_of_directions_to_either_side() -> None:
    said = spreads(heard_from({HERE: [1.0, 1.4, 1.0 + math.pi], THERE: [0.1]})).reshape(SHAPE)
    alone = 2.0 * math.sin(0.5 * 0.4) ** 2
    assert 0.5 * alone < said[HERE] < math.sin(0.4)
    assert said[THERE] == pytest.approx(0.0, abs=1e-3)
    assert not said[cells(HERE, THERE) == 0].any()


@pytest.mark.parametrize(("turn_rad", "share"), [(0.1, 1.0), (0.8, 0.0)])
def test_a_place_was_seen_from_one_side_if_most_of_it_was(turn_rad: float, share: float) -> None:
    evidence = heard_from({HERE: [0.5, 0.5 + turn_rad], THERE: [2.0, 2.0 + turn_rad]})
    assert one_sided_share(evidence, cells(HERE, THERE)) == share


def test_what_was_hardly_heard_does_not_tell() -> None:
    evidence = heard_from({HERE: [0.5, 1.5]})
    evidence.heard[np.ravel_multi_index(THERE, SHAPE)] = 0.9 * LEAST_HEARD
    assert one_sided_share(evidence, cells(HERE, THERE)) == 0.0
    assert one_sided_share(evidence, cells(THERE)) == 0.0


def test_sound_surely_came_from_what_was_heard_from_several_sides() -> None:
    """Arcs of walls that robots drove towards reached beyond their corners, and opened them."""
    evidence = heard_from({HERE: [0.5, 0.5 + 2.5 * SURE], THERE: [1.0, 1.0 + 0.2 * SURE]})
    left = power_left(evidence, 1.0)
    assert left[HERE] == pytest.approx(1.0)
    assert left[THERE] < 0.02
    assert not left[0, 0]


def test_where_most_was_heard_from_several_sides_all_of_it_is_where_it_stands() -> None:
    evidence = heard_from({HERE: [0.5, 1.5], THERE: [1.0]})
    np.testing.assert_array_equal(power_left(evidence, 0.0)[5:8, 5:8], 1.0)
    assert power_left(evidence, 0.5)[THERE] == pytest.approx(0.5)
