"""A second look at all cones, for those who have the time."""

import numpy as np
import pytest

import usmap_ros
from usmap_ros.errors import UsmapError
from usmap_ros.parameters import MappingParameters, PipelineParameters


def pipeline_with_pings(method: str = "joint") -> usmap_ros.Pipeline:
    mapping = MappingParameters(method=method)
    pipeline = usmap_ros.Pipeline(PipelineParameters(mapping=mapping))
    for x_m, y_m in [(0.0, 0.0), (0.5, 0.2), (1.0, -0.4), (1.2, 0.5), (1.5, 1.2)]:
        pose = usmap_ros.Pose.planar(x_m, y_m, float(np.arctan2(0.3 - y_m, 2.0 - x_m)))
        pipeline.process(usmap_ros.hear([(2.0, 0.3)], pose=pose))
    return pipeline


def test_no_pass_changes_nothing() -> None:
    pipeline = pipeline_with_pings()
    before = pipeline.occupancy_map()
    pipeline.refine(0)
    assert pipeline.fusion.is_whole
    assert np.array_equal(pipeline.occupancy_map().log_odds, before.log_odds)


def test_a_few_passes_are_those_that_further_pings_would_have_brought() -> None:
    once, twice = pipeline_with_pings(), pipeline_with_pings()
    once.refine(4)
    twice.refine(2)
    twice.refine(2)
    assert np.array_equal(once.occupancy_map().log_odds, twice.occupancy_map().log_odds)


def test_the_pole_stays_where_it_is() -> None:
    pipeline = pipeline_with_pings()
    pipeline.refine(5)
    occupancy = pipeline.occupancy_map()
    rows, columns = np.nonzero(occupancy.predicted())
    centers_m = occupancy.geometry.cell_centers_m(rows, columns)
    assert len(centers_m) > 0
    assert np.abs(centers_m - [2.0, 0.3]).max() < 0.1


def test_a_method_that_has_no_use_for_it_says_so() -> None:
    with pytest.raises(UsmapError, match="additive has no use for more passes"):
        pipeline_with_pings("additive").refine(1)
