"""Map, and score the map beside what single ranges would have given."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NoReturn

from usmap_ros.errors import MalformedMessageError
from usmap_ros.evaluation.scoring import Score, score
from usmap_ros.grids import OccupancyMap, TruthMap
from usmap_ros.mapping.yardsticks.range_only import RangeSensorFusion
from usmap_ros.parameters import PipelineParameters
from usmap_ros.pings.fields_of_view import PingViews
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.runs.parallel import cones_of
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.simulation.recording import simulate
from usmap_ros.simulation.scenario import Scenario


@dataclass(frozen=True)
class Trial:
    """A map, the map that the range model makes of the same pings, and how good either is."""

    #: The pipeline's, and that of `RangeSensorFusion` from each ping's first echo.
    occupancy: OccupancyMap
    range_only: OccupancyMap
    #: What is there.
    truth: TruthMap
    #: What the pings looked at.
    views: PingViews
    #: Of either map against it.
    score: Score
    range_only_score: Score


def try_traces(
    traces: Iterable[tuple[str, EchoTrace]],
    truth: TruthMap,
    parameters: PipelineParameters | None = None,
) -> Trial:
    """Map traces, and score the map.

    Parameters
    ----------
    traces : iterable of (topic, EchoTrace)
        In the order of their stamps, as `simulate` and `BagReader.traces` give them.
    truth : TruthMap
        What is there.
    parameters : PipelineParameters, optional
        Of the pipeline; the range model gets its cells from them.

    Raises
    ------
    MalformedMessageError
        If a trace cannot be reconstructed.
    """
    pipeline = Pipeline(parameters)
    range_only = RangeSensorFusion(pipeline.parameters.mapping)
    cones = []
    for _, cone in cones_of(traces, pipeline, _refuse):
        pipeline.fuse(cone)
        range_only.fuse(cone)
        cones.append(cone)
    views = PingViews.of(cones)
    occupancy, range_map = pipeline.occupancy_map(), range_only.occupancy_map()
    return Trial(
        occupancy=occupancy,
        range_only=range_map,
        truth=truth,
        views=views,
        score=score(occupancy, truth, views),
        range_only_score=score(range_map, truth, views),
    )


def _refuse(source: str, error: MalformedMessageError) -> NoReturn:
    raise error


def try_scenario(scenario: Scenario, parameters: PipelineParameters | None = None) -> Trial:
    """Simulate a scenario, map it, and score the map.

    Parameters
    ----------
    scenario : Scenario
        World, robots, noise; its truth has cells as large as the map's.
    parameters : PipelineParameters, optional
        Of the pipeline.
    """
    parameters = parameters or PipelineParameters()
    truth = scenario.truth_map(parameters.mapping.resolution_m)
    return try_traces(simulate(scenario), truth, parameters)
