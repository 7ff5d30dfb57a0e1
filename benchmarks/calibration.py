"""Whether maps mean their probabilities: of cells given 0.8, about 80 % should be occupied.

Pools the observed cells of maps of several simulated worlds, none of which the parameters were
chosen on, and prints, for bins of probability, the share that is occupied, exactly and within one
cell.

python benchmarks/calibration.py
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from usmap_ros.grids import OccupancyMap, TruthMap
from usmap_ros.mapping.scoring import calibration
from usmap_ros.pipeline import Pipeline
from usmap_ros.simulation import Scenario, simulate

SCENARIOS = Path(__file__).parents[1] / "config/scenarios"
NAMES = ("poles", "floor", "pose_error")
SEEDS = range(301, 309)
#: Borders of the bins: most cells are surely free, and nothing is surer than the upper clamp.
BORDERS = np.array([0.0, 0.02, 0.2, 0.4, 0.6, 0.8, 1.0])
#: Of the fine bins that are pooled into those.
FINE = 50

Counts = NDArray[np.float64]


def counts(occupancy: OccupancyMap, truth: TruthMap) -> Counts:
    """Sums over the observed cells of each bin: probability, occupied, occupied nearby, cells.

    Shape (bins, 4).
    """
    near = TruthMap(truth.geometry, binary_dilation(truth.occupied, np.ones((3, 3), dtype=bool)))
    mean, exact, number = calibration(occupancy, truth, FINE)
    _, nearby, _ = calibration(occupancy, near, FINE)
    fine = np.nan_to_num(np.column_stack([mean, exact, nearby])) * number[:, np.newaxis]
    fine = np.column_stack([fine, number])
    first = np.rint(BORDERS[:-1] * FINE).astype(int)
    return np.add.reduceat(fine, first, axis=0)


def pooled(names: tuple[str, ...] = NAMES) -> Counts:
    """`counts` of all scenes together."""
    total = np.zeros((len(BORDERS) - 1, 4))
    for name in names:
        for seed in SEEDS:
            scenario = Scenario.load(SCENARIOS / f"{name}.yaml").model_copy(update={"seed": seed})
            pipeline = Pipeline()
            for _, trace in simulate(scenario):
                pipeline.process(trace)
            total += counts(pipeline.occupancy_map(), scenario.truth_map())
    return total


def run() -> dict[str, Any]:
    """Share of occupied cells by probability, exactly and within one cell."""
    results: dict[str, Any] = {}
    for low, high, row in zip(BORDERS[:-1], BORDERS[1:], pooled(), strict=True):
        probability, exact, nearby, number = row
        results[f"from_{low:g}_to_{high:g}"] = (
            f"{probability / number:.4f}: {exact / number:.4f} exactly,"
            f" {nearby / number:.4f} within one of {number:.0f}"
            if number
            else "none"
        )
    return results


def main() -> None:
    """Print the figures as tables in Markdown."""
    for names in (NAMES, ("room",)):
        print(f"\n{', '.join(names)}, seeds {SEEDS[0]} to {SEEDS[-1]}\n")
        print("| probability | cells | mean | occupied | occupied within one cell |")
        print("|---|---:|---:|---:|---:|")
        for low, high, row in zip(BORDERS[:-1], BORDERS[1:], pooled(names), strict=True):
            probability, exact, nearby, number = row
            shares = (value / max(number, 1.0) for value in (probability, exact, nearby))
            columns = " | ".join(f"{share:.4f}" for share in shares)
            print(f"| {low:g} to {high:g} | {number:.0f} | {columns} |")


if __name__ == "__main__":
    main()
