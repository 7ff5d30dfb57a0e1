"""How good a map is: the project's fixed definition of a score."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, distance_transform_edt

from usmap_ros.grids import FREE_PROBABILITY, OCCUPIED_PROBABILITY, OccupancyMap, TruthMap

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


def score(occupancy: OccupancyMap, truth: TruthMap) -> Score:
    """Score a map against the truth.

    Raises
    ------
    ValueError
        If the two have different resolutions, or origins that are not whole cells apart.
    """
    probability, observed, occupied = _aligned(occupancy, truth)
    predicted = observed & (probability >= OCCUPIED_PROBABILITY)
    seen_truth = observed & occupied
    neighbourhood = np.ones((2 * TOLERANCE_CELLS + 1,) * 2, dtype=bool)
    precision = _share(binary_dilation(occupied, neighbourhood), predicted)
    recall = _share(binary_dilation(predicted, neighbourhood), seen_truth)
    total = precision + recall
    seen_probability = np.clip(probability[observed], LOG_LOSS_CLIP, 1.0 - LOG_LOSS_CLIP)
    is_occupied = occupied[observed]
    losses = -np.log(np.where(is_occupied, seen_probability, 1.0 - seen_probability))
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
    )


def calibration(
    occupancy: OccupancyMap, truth: TruthMap, bins: int = 10
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Mean probability, share really occupied and number of observed cells in probability bins.

    Bins without a cell have NaN for the first two.
    """
    probability, observed, occupied = _aligned(occupancy, truth)
    index = np.minimum((probability[observed] * bins).astype(np.int64), bins - 1)
    count = np.bincount(index, minlength=bins)
    with np.errstate(invalid="ignore"):
        mean = np.bincount(index, probability[observed], bins) / count
        share = np.bincount(index, occupied[observed], bins) / count
    return mean, share, count


def _aligned(
    occupancy: OccupancyMap, truth: TruthMap
) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]]:
    """Probability, observed and occupied on one grid that holds both maps."""
    ours, theirs = occupancy.geometry, truth.geometry
    resolution_m = ours.resolution_m
    if not np.isclose(resolution_m, theirs.resolution_m, rtol=1e-6):
        raise ValueError(
            f"the map's cells are {resolution_m:g} m and the truth's {theirs.resolution_m:g} m"
        )
    offset = (np.array(theirs.origin_m) - np.array(ours.origin_m)) / resolution_m
    if np.any(np.abs(offset - np.rint(offset)) > 0.01):
        raise ValueError("the origins of map and truth are not whole cells apart")
    column, row = (int(value) for value in np.rint(offset))
    top, left = min(0, row), min(0, column)
    shape = (
        max(ours.shape[0], row + theirs.shape[0]) - top,
        max(ours.shape[1], column + theirs.shape[1]) - left,
    )
    inside = _window(-top, -left, ours.shape)
    probability = np.zeros(shape)
    probability[inside] = occupancy.probability()
    observed = np.zeros(shape, dtype=np.bool_)
    observed[inside] = occupancy.observed
    occupied = np.zeros(shape, dtype=np.bool_)
    occupied[_window(row - top, column - left, theirs.shape)] = truth.occupied
    return probability, observed, occupied


def _window(row: int, column: int, shape: tuple[int, int]) -> tuple[slice, slice]:
    return slice(row, row + shape[0]), slice(column, column + shape[1])


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
