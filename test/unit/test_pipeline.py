"""One object from traces to a map, which is the same whichever way it is driven."""

from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from usmap_ros.parameters import MappingParameters, PipelineParameters, ReconstructionParameters
from usmap_ros.pipeline import FUSIONS, Pipeline
from usmap_ros.simulation import Scenario, simulate
from usmap_ros.trace import EchoTrace

SCENARIO = Path(__file__).parents[2] / "config" / "scenarios" / "poles.yaml"


@pytest.fixture(scope="module")
def traces() -> list[EchoTrace]:
    return [trace for _, trace in islice(simulate(Scenario.load(SCENARIO)), 24)]


def test_the_method_of_fusion_is_a_parameter(traces: list[EchoTrace]) -> None:
    occupied = {}
    for method in FUSIONS:
        pipeline = Pipeline(PipelineParameters(mapping=MappingParameters(method=method)))
        for trace in traces:
            pipeline.process(trace)
        occupied[method] = np.count_nonzero(pipeline.occupancy_map().trinary() == 100)
    # Added up cell by cell, echoes draw arcs.
    assert occupied["additive"] > 2 * occupied["superposition"] > 0


def test_recorded_cones_fuse_to_the_map_that_their_traces_give(traces: list[EchoTrace]) -> None:
    first, second = Pipeline(), Pipeline()
    cones = [first.process(trace) for trace in traces]
    for cone in cones:
        second.fuse(cone)
    np.testing.assert_array_equal(first.occupancy_map().log_odds, second.occupancy_map().log_odds)


def test_looking_at_the_map_does_not_change_it(traces: list[EchoTrace]) -> None:
    watched, left_alone = Pipeline(), Pipeline()
    for trace in traces:
        watched.process(trace)
        watched.occupancy_map().log_odds[:] = 0.0
        left_alone.process(trace)
    np.testing.assert_array_equal(
        watched.occupancy_map().log_odds, left_alone.occupancy_map().log_odds
    )


def test_the_papers_dictionary_of_cells_hears_the_same_poles(traces: list[EchoTrace]) -> None:
    cells = Pipeline(
        PipelineParameters(reconstruction=ReconstructionParameters(dictionary="cells"))
    )
    delays = Pipeline()
    trace = max(traces, key=lambda trace: np.abs(trace.samples).max())
    loudest = [
        cone.ranges_m[cone.amplitudes.argmax()]
        for cone in (cells.reconstruct(trace), delays.reconstruct(trace))
    ]
    assert loudest[0] == pytest.approx(loudest[1], abs=0.05)


def test_a_pipeline_resumes_the_map_that_another_one_left(traces: list[EchoTrace]) -> None:
    first, second = Pipeline(), Pipeline()
    for trace in traces:
        first.process(trace)
    second.resume(first.occupancy_map())
    again, exported = second.occupancy_map(), first.occupancy_map()
    np.testing.assert_array_equal(again.observed, exported.observed)
    np.testing.assert_allclose(again.log_odds, exported.log_odds, atol=1e-5)
