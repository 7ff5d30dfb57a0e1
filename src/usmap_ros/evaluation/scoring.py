"""How good a map is: the project's fixed definition of a score."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, distance_transform_edt

from usmap_ros.evaluation.alignment import align
from usmap_ros.evaluation.drivability import Drivability, drivability
from usmap_ros.grids import FREE_PROBABILITY, OccupancyMap, TruthMap
from usmap_ros.pings.fields_of_view import PingViews

#: Cells (Chebyshev) within which a predicted cell counts as right.
TOLERANCE_CELLS = 1
#: Probabilities are kept this far from 0 and 1 in the log loss.
LOG_LOSS_CLIP = 1e-6


@dataclass(frozen=True)
class Score:
    """Agreement of a map with the truth, over the observed cells.

    Parameters
    ----------
    precision : float
        Share of predicted cells within one cell of a truth cell.
    recall : float
        Share of observed truth cells within one cell of a predicted one.
    f1 : float
        Harmonic mean of the two.
    log_loss, brier : float
        Mean over the observed cells, nats and squared probability.
    mean_distance_m : float
        From predicted to nearest truth cells; NaN if nothing is predicted.
    truth_called_free : float
        Share of observed truth cells with a probability of at most 0.35.
    predicted_cells, truth_cells : int
        Observed cells predicted occupied, and observed truth cells.
    leak, lost, escape_m2 : float
        See `Drivability`; NaN if it is not known what the pings looked at.
    """

    precision: float
    recall: float
    f1: float
    log_loss: float
    brier: float
    mean_distance_m: float
    truth_called_free: float
    predicted_cells: int
    truth_cells: int
    leak: float
    lost: float
    escape_m2: float


def score(occupancy: OccupancyMap, truth: TruthMap, views: PingViews | None = None) -> Score:
    """Score a map against the truth.

    Parameters
    ----------
    occupancy : OccupancyMap
        The map.
    truth : TruthMap
        What is there; on cells of another size, see `usmap_ros.evaluation.alignment.align`.
    views : PingViews, optional
        What the pings that made the map looked at; without them it is not known whether one
        can drive by it.
    """
    maps = align(occupancy, truth)
    probability, observed, occupied = maps.probability, maps.observed, maps.occupied
    predicted = maps.predicted
    seen_truth = observed & occupied
    neighbourhood = np.ones((2 * TOLERANCE_CELLS + 1,) * 2, dtype=bool)
    precision = _share(binary_dilation(occupied, neighbourhood), predicted)
    recall = _share(binary_dilation(predicted, neighbourhood), seen_truth)
    total = precision + recall
    seen_probability = np.clip(probability[observed], LOG_LOSS_CLIP, 1.0 - LOG_LOSS_CLIP)
    is_occupied = occupied[observed]
    losses = -np.log(np.where(is_occupied, seen_probability, 1.0 - seen_probability))
    driving = Drivability(*[float("nan")] * 3) if views is None else drivability(maps, views)
    return Score(
        precision=precision,
        recall=recall,
        f1=2.0 * precision * recall / total if total > 0.0 else 0.0,
        log_loss=_mean(losses),
        brier=_mean((probability[observed] - is_occupied) ** 2),
        mean_distance_m=_mean_distance_m(predicted, occupied, occupancy.geometry.resolution_m),
        truth_called_free=_share(probability <= FREE_PROBABILITY, seen_truth),
        predicted_cells=int(np.count_nonzero(predicted)),
        truth_cells=int(np.count_nonzero(seen_truth)),
        leak=driving.leak,
        lost=driving.lost,
        escape_m2=driving.escape_m2,
    )


def _share(property_: NDArray[np.bool_], among: NDArray[np.bool_]) -> float:
    """Share of the cells `among` that have a property; 0 if there are none."""
    count = np.count_nonzero(among)
    return float(np.count_nonzero(property_ & among) / count) if count else 0.0


def _mean(values: NDArray[np.float64]) -> float:
    return float(values.mean()) if values.size else float("nan")


def _mean_distance_m(
    predicted: NDArray[np.bool_], occupied: NDArray[np.bool_], resolution_m: float
) -> float:
    if not predicted.any() or not occupied.any():
        return float("nan")
    distance = distance_transform_edt(~occupied) * resolution_m
    return float(distance[predicted].mean())
