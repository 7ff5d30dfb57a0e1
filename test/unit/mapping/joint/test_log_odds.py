"""Which cells stand for what speaks for them and their neighbours."""

import numpy as np
import pytest

from usmap_ros.mapping.joint.forward_model.cell_evidence import CellEvidence, no_evidence
from usmap_ros.mapping.joint.forward_model.log_odds import NOTHING, cell_log_odds, hiding, judged
from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.numerics.arrays import FloatArray

FIELD = Field(0, 0, 5, 5, 0.05)
MIDDLE = (2, 2)
#: Of points that are no neighbours.
COLUMNS = [2, 7, 12]


def evidence(own: dict[tuple[int, int], float], together: float) -> CellEvidence:
    """Of cells with evidence of their own, and of as much in every block that all of them are in.

    They were heard from all around.
    """
    found = no_evidence(FIELD)
    grids = CellEvidence(*(values.reshape(FIELD.shape) for values in found))
    for place, value in own.items():
        grids.own[place] = value
        near = sum(max(abs(place[0] - row), abs(place[1] - column)) < 2 for row, column in own)
        grids.block[place] = together * near / len(own)
        grids.heard[place] = 20.0
    return found


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_what_is_heard_of_several_cells_is_not_lost(sign: float) -> None:
    # Heard from poses that are a little off, each cell alone may explain the pings worse than none.
    point = evidence({MIDDLE: sign * 20.0, (2, 3): sign * 1.0, (3, 2): sign * 40.0}, 60.0)
    assert judged(point, FIELD.shape).max() == 60.0
    assert cell_log_odds(point, FIELD.shape).max() > 0.0
    assert hiding(point, FIELD.shape, np.zeros(FIELD.shape, bool)).max() > 0.99


def test_it_is_in_the_middle_of_cells_that_explain_it_together_alone() -> None:
    # The last is beside two of the others, and the least wrong.
    point = evidence({MIDDLE: -20.0, (2, 3): -30.0, (3, 1): -40.0, (1, 4): -1.0}, 60.0)
    log_odds = cell_log_odds(point, FIELD.shape)
    assert log_odds[1, 4] == NOTHING
    assert log_odds[2, 3] > 0.0


def test_a_cell_with_little_of_its_own_owes_its_block_to_its_neighbour() -> None:
    point = evidence({MIDDLE: 50.0, (2, 3): 1.0}, 60.0)
    strength = judged(point, FIELD.shape)
    assert (strength[MIDDLE], strength[2, 3]) == (60.0, 1.0)


def test_what_contradicts_a_block_is_nothing() -> None:
    nothing = evidence({MIDDLE: -20.0, (2, 3): -1.0}, -30.0)
    assert (cell_log_odds(nothing, FIELD.shape) == NOTHING).all()
    assert not hiding(nothing, FIELD.shape, np.zeros(FIELD.shape, bool)).any()


def poles(power: FloatArray) -> FloatArray:
    """Log-odds of three points that are heard alike, with such powers."""
    wide = Field(0, 0, 5, 15, 0.05)
    found = no_evidence(wide)
    grids = CellEvidence(*(values.reshape(wide.shape) for values in found))
    scatters = np.zeros(wide.shape, np.float32)
    for column, each in zip(COLUMNS, power, strict=True):
        grids.own[2, column], grids.block[2, column] = 30.0, 30.0
        grids.heard[2, column], grids.asked[2, column] = 10.0, 12.0
        scatters[2, column] = each
    return cell_log_odds(found, wide.shape, scatters)[2, COLUMNS]


def test_what_is_fainter_or_louder_than_usual_is_less_certain() -> None:
    usual, faint, loud = (poles(np.array([1.0, 1.0, each])) for each in (1.0, 0.2, 4.0))
    assert usual[2] == usual[0]
    assert faint[2] < usual[2] - 0.5
    assert loud[2] < usual[2] - 0.5
    # What is usual is told by most of them.
    assert faint[0] == usual[0]


@pytest.mark.parametrize("gain", [1e-4, 1e6])
def test_gains_change_no_belief(gain: float) -> None:
    power = np.array([1.0, 0.3, 2.0])
    np.testing.assert_allclose(poles(gain * power), poles(power), atol=1e-4)


def test_a_cell_that_has_no_power_left_is_fainter_than_any() -> None:
    nothing, little = (poles(np.array([1.0, 1.0, each]))[2] for each in (0.0, 1e-3))
    assert np.isfinite(nothing)
    assert nothing == pytest.approx(little)
