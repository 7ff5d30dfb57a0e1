"""Compile the loops that tests need, once, before several test processes would each do it."""

from itertools import islice
from pathlib import Path

from usmap_ros.mapping.next_view import best_views, candidate_poses
from usmap_ros.pipeline import Pipeline
from usmap_ros.simulation import Scenario, simulate

POLES = Path(__file__).parents[1] / "config/scenarios/poles.yaml"


def main() -> None:
    """Map a few pings, and ask what there is to ask of a map."""
    pipeline = Pipeline()
    pings = islice(simulate(Scenario.load(POLES)), 6)
    cones = [pipeline.process(trace) for _, trace in pings]
    pipeline.fusion.expected_by_others({cone.child_frame_id: [cone] for cone in cones})
    occupancy = pipeline.occupancy_map()
    best_views(occupancy, candidate_poses(occupancy), cones[0].transducer, 1)


if __name__ == "__main__":
    main()
