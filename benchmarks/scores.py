"""How good maps are at default settings, beside the range-only sonar model.

Simulates the shipped scenarios with the seeds below, maps them and prints a table in Markdown.

python benchmarks/scores.py [--readme README.md]
"""

from __future__ import annotations

import argparse
from pathlib import Path

from rich.progress import track

from usmap_ros.mapping.range_sensor import RangeSensorFusion
from usmap_ros.mapping.scoring import score
from usmap_ros.parameters import MappingParameters
from usmap_ros.pipeline import Pipeline
from usmap_ros.simulation.scenario import Scenario
from usmap_ros.simulation.simulator import simulate

SCENARIOS = Path(__file__).parent.parent / "config" / "scenarios"
#: Scenario files, with what they show.
SHOWN = {
    "poles": "30 poles, three robots",
    "pose_error": "the same with poses off by 3 cm and 0.6°",
    "floor": "20 poles above a reflecting floor",
    "room": "a room with rough walls, poles and pillars (the demo)",
    "nav2_map": "a flat with smooth walls, from a nav2 map",
}
SEEDS = (1, 2, 3)
START, END = "<!-- scores -->\n", "<!-- /scores -->"


def run() -> dict[str, float]:
    """F1 of every scenario, mean over the seeds, for both models."""
    results: dict[str, float] = {}
    for name in track(SHOWN, description="Scoring", transient=True):
        pairs = [scores(name, seed) for seed in SEEDS]
        results[f"{name}_f1"] = sum(ours for ours, _ in pairs) / len(pairs)
        results[f"{name}_range_only_f1"] = sum(theirs for _, theirs in pairs) / len(pairs)
    return results


def scores(name: str, seed: int) -> tuple[float, float]:
    """F1 of the pipeline and of the range-only model on one simulated recording."""
    scenario = Scenario.load(SCENARIOS / f"{name}.yaml").model_copy(update={"seed": seed})
    pipeline, range_only = Pipeline(), RangeSensorFusion(MappingParameters())
    for _, trace in simulate(scenario):
        range_only.fuse(pipeline.process(trace))
    truth = scenario.truth_map()
    return (
        score(pipeline.occupancy_map(), truth).f1,
        score(range_only.occupancy_map(), truth).f1,
    )


def markdown(results: dict[str, float]) -> str:
    """The results as a table."""
    lines = ["| scene | usmap_ros | range only |", "|---|---|---|"]
    for name, shown in SHOWN.items():
        ours, theirs = results[f"{name}_f1"], results[f"{name}_range_only_f1"]
        lines.append(f"| {shown} | {ours:.2f} | {theirs:.2f} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Print the table, and put it into a page if one is named."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--readme", type=Path, help="page to put the table into")
    arguments = parser.parse_args()
    table = markdown(run())
    print(table, end="")
    if arguments.readme is not None:
        page = arguments.readme.read_text(encoding="utf-8")
        before, rest = page.split(START)
        _, after = rest.split(END)
        arguments.readme.write_text(f"{before}{START}{table}{END}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
