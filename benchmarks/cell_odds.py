"""How well suspected cells' log-odds tell what stands, and the weights by which they do.

Scenes are recorded and mapped; each cell in which a surface is suspected then either holds or
touches one or does not.  Weights of `usmap_ros.mapping.joint.forward_model.log_odds` are fitted by
logistic regression to the cells of some seeds, and judged by those of others; all scenes count by
the square root of their cells.  Weights of powers are fitted together with those of what was heard.

python benchmarks/cell_odds.py [--seeds 1000 1001] [--judged 1240 1241] [--cache FOLDER]
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple
from unittest.mock import patch

import numpy as np
from logistic import logistic_weights
from methods import METHODS
from numpy.typing import NDArray
from recordings import cones
from rich.progress import track
from scenes import CONDITIONS, scenario

from usmap_ros.mapping.joint.estimate import JointEstimate
from usmap_ros.mapping.joint.forward_model import log_odds
from usmap_ros.mapping.joint.surfaces.walls import Walls
from usmap_ros.mapping.joint.visibility.field import QUARTERS

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
SCENES = (
    ("sandbox", "plain"), ("flat_rough", "plain"), ("columns_rough", "plain"), ("depot", "plain"),
    ("turned_rough", "plain"), ("mixed", "plain"), ("flat_smooth", "plain"), ("clutter", "plain"),
    ("warehouse", "plain"), ("poles", "few_pings"), ("poles", "noisy"),
    ("rough_rooms", "poses_off"),
)  # fmt: skip
#: Ridge of the fit.
RIDGE = 1e-3


class Cells(NamedTuple):
    """Suspected cells of one map."""

    #: (cells, features) array, as `log_odds.cell_features` has them; and log-powers of blocks.
    heard: FloatArray
    log_power: FloatArray
    #: (cells,) bool array: which hold or touch a surface.
    are_surface: BoolArray


def suspected_cells(scene: str, condition: str, seed: int, cache: Path | None) -> Cells:
    """Map a scene, and note what is told of its cells."""
    world, method = scenario(scene, condition, seed), METHODS["ours"]
    recorded = cones(world, method.parameters().reconstruction, cache, CONDITIONS[condition].sensor)
    found = list[Cells]()
    as_ever, truth = JointEstimate.free_space, world.truth_map()
    places_m = truth.geometry.cell_centers_m(*np.nonzero(truth.occupied)).T

    def note(estimate: JointEstimate, walls: Walls) -> tuple[Walls, BoolArray]:
        field = estimate.field
        where, heard = log_odds.cell_features(estimate.evidence, field.shape)
        power = estimate.power.reshape(*field.shape, QUARTERS).sum(axis=2)
        of_block = log_odds.over_block(power, np.add)[where]
        near = log_odds.over_block(field.cells_at(*places_m))
        found.append(Cells(heard, np.log(of_block + log_odds.TINY), near[where]))
        return as_ever(estimate, walls)

    with patch.object(JointEstimate, "free_space", note):
        method.map(recorded)
    return Cells(*(np.concatenate(values) for values in zip(*found, strict=True)))


def features(cells: Cells) -> FloatArray:
    """A constant, what was heard, and powers, (cells, features)."""
    powers = log_odds.power_features(cells.log_power, log_odds.heard_log_odds(cells.heard))
    return np.hstack([np.ones((len(powers), 1)), cells.heard, powers])


def fitted(among: Sequence[Cells], count: int) -> FloatArray:
    """Weights of the first so many features."""
    told = np.concatenate([features(cells)[:, :count] for cells in among])
    is_surface = np.concatenate([cells.are_surface for cells in among])
    return logistic_weights(told, is_surface, RIDGE, _counts(among))


def log_loss(among: Sequence[Cells], weights: FloatArray) -> float:
    """Mean of -ln of the probability of what is so."""
    told = np.concatenate([features(cells)[:, : len(weights)] for cells in among])
    sign = np.where(np.concatenate([cells.are_surface for cells in among]), -1.0, 1.0)
    return float(np.average(np.logaddexp(0.0, sign * (told @ weights)), weights=_counts(among)))


def _counts(among: Sequence[Cells]) -> FloatArray:
    """How much each cell counts."""
    return np.concatenate(
        [np.full(len(cells.are_surface), len(cells.are_surface) ** -0.5) for cells in among]
    )


def main() -> None:
    """Print weights, and how well they tell."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=[1000, 1001])
    parser.add_argument("--judged", type=int, nargs="+", default=[1240, 1241])
    parser.add_argument("--cache", type=Path)
    given = parser.parse_args()
    todo = [(*pair, seed) for pair in SCENES for seed in (*given.seeds, *given.judged)]
    cells = {
        each: suspected_cells(*each, given.cache)
        for each in track(todo, description="Mapping", transient=True)
    }
    fit, judge = ([cells[each] for each in todo if each[2] in seeds]
                  for seeds in (given.seeds, given.judged))  # fmt: skip
    heard = 1 + len(log_odds.OF_FEATURES)
    own = np.array(
        [log_odds.INTERCEPT, *log_odds.OF_FEATURES, log_odds.OF_FAINTER, log_odds.OF_LOUDER]
    )
    print("| weights | | log loss, fitted to | others |")
    print("|---|---|---:|---:|")
    for name, weights in (
        ("of what was heard", fitted(fit, heard)), ("of powers, too", fitted(fit, len(own))),
        ("the product's", own),
    ):  # fmt: skip
        losses = f"{log_loss(fit, weights):.3f} | {log_loss(judge, weights):.3f}"
        print(f"| {name} | {weights.round(2).tolist()} | {losses} |")


if __name__ == "__main__":
    main()
