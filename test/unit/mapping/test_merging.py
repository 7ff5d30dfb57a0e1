"""Maps of several areas, or fusions, become one."""

import numpy as np
import pytest
from scipy.special import logit

from usmap_ros.errors import MapSizeError, UsmapError
from usmap_ros.grids import AMBIGUITY, NORMAL, GridGeometry, OccupancyMap
from usmap_ros.mapping.merging import merge_maps
from usmap_ros.parameters import MappingParameters

PARAMETERS = MappingParameters(resolution_m=0.1)
PRIOR = np.float32(logit(PARAMETERS.prior))


def one_cell(
    column: int, log_odds: float, frame_id: str = "map", stamp_ns: int = 1
) -> OccupancyMap:
    """Map of three cells in a row, of which the middle one is known."""
    values = np.array([[PRIOR, log_odds, PRIOR]], np.float32)
    known = np.array([[False, True, False]])
    layers = {
        NORMAL: np.where(known, np.float32(log_odds), np.float32(np.nan)),
        AMBIGUITY: np.where(known, np.float32(0.5), np.float32(0.0)),
    }
    geometry = GridGeometry(0.1, (0.1 * column, 0.0), (1, 3))
    return OccupancyMap(geometry, values, known, frame_id, stamp_ns, layers)


def test_maps_apart_keep_their_cells() -> None:
    merged = merge_maps([one_cell(-5, 2.0), one_cell(4, -7.0, stamp_ns=9)], PARAMETERS)
    assert merged.geometry == GridGeometry(0.1, (-0.5, 0.0), (1, 12))
    assert np.flatnonzero(merged.observed[0]).tolist() == [1, 10]
    assert merged.log_odds[0, [1, 10]] == pytest.approx([2.0, -7.0])
    assert merged.log_odds[0, [0, 5]] == pytest.approx([PRIOR, PRIOR])
    assert merged.layers[NORMAL][0, [1, 10]] == pytest.approx([2.0, -7.0])
    assert np.isnan(merged.layers[NORMAL][0, 5])
    assert merged.layers[AMBIGUITY][0, [1, 5, 10]] == pytest.approx([0.5, 0.0, 0.5])
    assert (merged.frame_id, merged.stamp_ns) == ("map", 9)


def test_evidence_of_maps_that_overlap_adds_up() -> None:
    merged = merge_maps([one_cell(0, PRIOR + 1.0), one_cell(0, PRIOR + 2.5)], PARAMETERS)
    assert merged.log_odds[0, 1] == pytest.approx(PRIOR + 3.5)
    # Of a direction there is no sum: the surer map has the word.
    assert merged.layers[NORMAL][0, 1] == pytest.approx(PRIOR + 2.5)
    certain = merge_maps([one_cell(0, 2.0), one_cell(0, 2.0)], PARAMETERS)
    assert certain.log_odds[0, 1] == PARAMETERS.greatest_log_odds


def test_maps_that_do_not_join_are_refused() -> None:
    with pytest.raises(UsmapError, match="frames 'map' and 'odom' do not join"):
        merge_maps([one_cell(0, 1.0), one_cell(9, 1.0, "odom")], PARAMETERS)
    other = one_cell(0, 1.0)
    coarse = OccupancyMap(
        GridGeometry(0.2, (0.0, 0.0), (1, 3)), other.log_odds, other.observed, "map"
    )
    with pytest.raises(UsmapError, match=r"0\.1 m and 0\.2 m do not join"):
        merge_maps([other, coarse], PARAMETERS)
    with pytest.raises(MapSizeError, match="so far apart"):
        merge_maps([one_cell(0, 1.0), one_cell(30_000_000, 1.0)], PARAMETERS)
