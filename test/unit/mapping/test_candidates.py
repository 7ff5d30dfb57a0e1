"""What a single ping can say of where its echoes came from."""

from collections.abc import Callable

import numpy as np
import pytest

from usmap_ros.mapping.candidates import LEAST_LIKELIHOOD, CandidateCells, candidate_cells
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

PARAMETERS = MappingParameters()


@pytest.fixture
def candidates(cone_of_objects: Callable[..., EchoCone]) -> CandidateCells:
    return candidate_cells(cone_of_objects((1.525, 0.425, 0.5)), PARAMETERS)


def test_the_true_cell_and_its_mirror_image_are_equally_likely(candidates: CandidateCells) -> None:
    likelihood = dict(
        zip(
            zip(candidates.rows, candidates.columns, strict=True),
            candidates.likelihood,
            strict=True,
        )
    )
    assert likelihood[8, 30] == pytest.approx(likelihood[-9, 30])
    assert likelihood[8, 30] > 0.9


def test_all_of_them_are_on_the_ring_of_the_echo(candidates: CandidateCells) -> None:
    ranges_m = np.hypot(*candidates.centers_m.T)
    np.testing.assert_allclose(ranges_m, np.hypot(1.525, 0.425), atol=0.05 * np.sqrt(0.5) + 0.01)
    assert candidates.likelihood.max() == 1.0
    assert candidates.likelihood.min() >= LEAST_LIKELIHOOD


def test_an_object_off_the_axis_must_be_stronger_to_be_as_loud(candidates: CandidateCells) -> None:
    off_axis = np.abs(np.arctan2(*candidates.centers_m.T[::-1]))
    order = np.argsort(off_axis)
    assert np.all(np.diff(candidates.coefficient[order[::20]]) > 0.0)
    true_cell = (candidates.rows == 8) & (candidates.columns == 30)
    assert candidates.coefficient[true_cell] == pytest.approx(0.5, rel=0.05)


def test_a_silent_ping_has_no_candidates(make_cone: Callable[..., EchoCone]) -> None:
    assert len(candidate_cells(make_cone(), PARAMETERS).rows) == 0
