"""One object from traces to a map, which is the same whichever way it is driven."""

from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from usmap_ros.errors import MalformedMessageError
from usmap_ros.grids import NORMAL, GridGeometry, OccupancyMap
from usmap_ros.mapping.fusion import Fusion
from usmap_ros.mapping.yardsticks.cell_fusion import CellFusion
from usmap_ros.parameters import MappingParameters, PipelineParameters, ReconstructionParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.runs.pipeline import FUSIONS, Pipeline
from usmap_ros.simulation import Scenario, simulate

SCENARIO = Path(__file__).parents[3] / "config" / "scenarios" / "poles.yaml"


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
    assert occupied["additive"] > 2 * occupied["joint"] > 0


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


def test_sides_of_cells_that_nothing_is_known_of_are_not_resumed(traces: list[EchoTrace]) -> None:
    exported = Pipeline().occupancy_map()
    shape, unknown = (200, 200), np.float32(exported.log_odds[0, 0])
    observed = np.zeros(shape, dtype=bool)
    observed[:5, :5] = True
    blank = OccupancyMap(
        GridGeometry(exported.geometry.resolution_m, (0.0, 0.0), shape),
        np.where(observed, np.float32(-5.0), unknown),
        observed,
        "map",
        layers={NORMAL: np.full(shape, 1.0, np.float32)},
    )
    resumed = Pipeline()
    resumed.resume(blank)
    np.testing.assert_array_equal(resumed.occupancy_map().observed, observed[:5, :5])


def spoil(fusion: Fusion) -> None:
    """Leave numbers in two cells that are none."""
    assert isinstance(fusion, CellFusion)
    places = fusion._places(np.array([60, 60]), np.array([60, 61]))
    fusion._log_odds[places] = [np.inf, np.nan]


def test_a_ping_that_would_poison_the_map_is_left_out(
    traces: list[EchoTrace], monkeypatch: pytest.MonkeyPatch
) -> None:
    pipeline = Pipeline(PipelineParameters(mapping=MappingParameters(method="additive")))
    cones = [pipeline.reconstruct(trace) for trace in traces[:12]]
    for cone in cones[:6]:
        pipeline.fuse(cone)
    take_up = pipeline.fusion._take_up

    def take_up_badly(cone: EchoCone, source: str) -> None:
        take_up(cone, source)
        spoil(pipeline.fusion)

    with monkeypatch.context() as patched:
        patched.setattr(pipeline.fusion, "_take_up", take_up_badly)
        with pytest.raises(MalformedMessageError, match=r"amplitudes: .* in 2 cells .* not finite"):
            pipeline.fuse(cones[6])
    for cone in cones[7:]:
        pipeline.fuse(cone)
    occupancy = pipeline.occupancy_map()
    assert np.isfinite(occupancy.log_odds).all()
    assert np.count_nonzero(occupancy.observed) > 100


def test_no_number_that_is_not_finite_leaves_the_pipeline(
    traces: list[EchoTrace], caplog: pytest.LogCaptureFixture
) -> None:
    pipeline = Pipeline(PipelineParameters(mapping=MappingParameters(method="additive")))
    pipeline.process(traces[0])
    spoil(pipeline.fusion)
    assert np.isfinite(pipeline.occupancy_map().log_odds).all()
    assert "2 cells of the map held numbers that are not finite" in caplog.text
    caplog.clear()
    pipeline.occupancy_map()
    assert not caplog.text
