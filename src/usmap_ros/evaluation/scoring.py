"""How good a map is: the project's fixed definition of a score."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, distance_transform_edt

from usmap_ros.evaluation.alignment import AlignedMaps, align
from usmap_ros.evaluation.drivability import Drivability, drivability, share
from usmap_ros.evaluation.line_of_sight import pings_in_sight
from usmap_ros.evaluation.sight import InSight, in_sight
from usmap_ros.grids import OccupancyMap, TruthMap
from usmap_ros.pings.fields_of_view import PingViews

#: Cells (Chebyshev) within which a predicted cell counts as right.
TOLERANCE_CELLS = 1
#: Probabilities are kept this far from 0 and 1 in the log loss.
LOG_LOSS_CLIP = 1e-6


@dataclass(frozen=True)
class Score:
    """Agreement of a map with the truth, over what could be known; shares of nothing are 0."""

    #: Harmonic mean of precision and recall.
    f1: float
    #: Share of predicted cells within one cell of a truth cell.
    precision: float
    #: Share of surface cells in sight within one cell of a predicted one; an unknown cell is not
    #: found.
    recall: float
    #: Share of open cells in sight that are called free.
    known: float
    #: See `Drivability`; NaN if it is not known what the pings looked at.
    leak: float
    lost: float
    escape_m2: float
    #: Mean over the cells in sight, nats and squared probability; cells that are neither predicted
    #: nor free count with their probability, but at most with 0.5.
    log_loss: float
    brier: float
    #: From predicted to nearest truth cells; NaN if nothing is predicted.
    mean_distance_m: float
    #: How many are predicted, and how many of either kind are in sight.
    predicted_cells: int
    surface_cells: int
    open_cells: int
    #: Whether it is known what was in sight. If not, all that lies within one cell of an observed
    #: cell stands in for it, and a map that says less is asked less.
    sight_known: bool


def score(
    occupancy: OccupancyMap,
    truth: TruthMap,
    views: PingViews | None = None,
    audible: TruthMap | None = None,
) -> Score:
    """Score a map against the truth: what could be known counts, whether or not the map knows it.

    Parameters
    ----------
    occupancy : OccupancyMap
        The map to be scored, on any grid of the truth's frame.
    truth : TruthMap
        What is there; on cells of another size, see `usmap_ros.evaluation.alignment.align`.
    views : PingViews, optional
        What the pings that made the map looked at; without them it is not known what was in
        sight, nor whether one can drive by the map.
    audible : TruthMap, optional
        Where it is known, as in simulations, the part of the truth that is loud enough to be
        heard: recall asks for no other surfaces.  None: all of it is.
    """
    maps = align(occupancy, truth)
    sightings = None if views is None else pings_in_sight(maps.occupied, maps.geometry, views)
    seen = in_sight(maps, truth, views, sightings)
    if audible is not None:
        seen = replace(seen, surface=seen.surface & align(occupancy, audible).occupied)
    predicted = maps.predicted
    neighbourhood = np.ones((2 * TOLERANCE_CELLS + 1,) * 2, dtype=bool)
    precision = share(binary_dilation(maps.occupied, neighbourhood), predicted)
    recall = share(binary_dilation(predicted, neighbourhood), seen.surface)
    total = precision + recall
    unknown = Drivability(*[float("nan")] * 3)
    driving = unknown if views is None else drivability(maps, views, sightings)
    log_loss, brier = _losses(maps, seen)
    return Score(
        f1=2.0 * precision * recall / total if total > 0.0 else 0.0,
        precision=precision,
        recall=recall,
        known=share(maps.free, seen.open),
        leak=driving.leak,
        lost=driving.lost,
        escape_m2=driving.escape_m2,
        log_loss=log_loss,
        brier=brier,
        mean_distance_m=_mean_distance_m(predicted, maps.occupied, maps.geometry.resolution_m),
        predicted_cells=int(np.count_nonzero(predicted)),
        surface_cells=int(np.count_nonzero(seen.surface)),
        open_cells=int(np.count_nonzero(seen.open)),
        sight_known=views is not None,
    )


def _losses(maps: AlignedMaps, seen: InSight) -> tuple[float, float]:
    """Log loss and Brier score over the cells in sight."""
    unknown = ~(maps.predicted | maps.free)
    probability = np.where(unknown, np.minimum(maps.probability, 0.5), maps.probability)[seen.cells]
    is_occupied = maps.occupied[seen.cells]
    clipped = np.clip(probability, LOG_LOSS_CLIP, 1.0 - LOG_LOSS_CLIP)
    losses = -np.log(np.where(is_occupied, clipped, 1.0 - clipped))
    return _mean(losses), _mean((probability - is_occupied) ** 2)


def _mean(values: NDArray[np.float64]) -> float:
    return float(values.mean()) if values.size else float("nan")


def _mean_distance_m(
    predicted: NDArray[np.bool_], occupied: NDArray[np.bool_], resolution_m: float
) -> float:
    if not predicted.any() or not occupied.any():
        return float("nan")
    distance = distance_transform_edt(~occupied) * resolution_m
    return float(distance[predicted].mean())
