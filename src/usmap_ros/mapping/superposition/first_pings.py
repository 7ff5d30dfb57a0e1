"""The first pings: every cell weighed that may have returned an echo, without picking any.

Superposition finds powers that explain what was heard; with few pings there are many such, and
where the search ends depends on where it starts.  So it starts from the odds of a simpler model,
in which each quarter of a cell holds an object or none.  An echo has one source: its
likelihood is a noisy-OR of all quarters on its ring, each with the density of the echo's power
if it came from there, given what the other pings heard of it.  Belief propagation between
echoes and quarters gives the odds of each.

References
----------
.. [1] Pearl, "Probabilistic Reasoning in Intelligent Systems" (1988), section 4.3: noisy-OR.
.. [2] Thrun, "Learning occupancy grid maps with forward sensor models", Autonomous Robots 15
   (2003) 111-127: explaining readings together, rather than cell by cell.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.superposition.cells import QUARTERS, Tiles, slot_beside
from usmap_ros.mapping.superposition.log_odds import OWN_SHARE, Scale
from usmap_ros.mapping.superposition.object_powers import judge_alone, power_steps
from usmap_ros.mapping.superposition.ping_bins import ECHO, SILENCE, Look
from usmap_ros.mapping.superposition.sources import Sources, compare, no_sources, tally
from usmap_ros.mapping.superposition.visible_cells import VisibleCells
from usmap_ros.numerics.compiled import compiled
from usmap_ros.numerics.special import logistic, logit
from usmap_ros.parameters import MappingParameters

#: Density, per unit of the logarithm of power, of echoes that come from nowhere.
CLUTTER_DENSITY = 3e-3
#: Quarters, times looks, that are compared at the most.
MOST_PAIRS = 200_000
#: Rounds of belief propagation, and the share of its last message that each keeps.
ROUNDS, DAMPING = 15, 0.3


@compiled
def weigh_sources(
    sources: Sources,
    density: NDArray[np.float64],
    bin_count: int,
    detection_probability: float,
    prior_log_odds: float,
    log_odds: NDArray[np.float64],
) -> None:
    """Log-odds of the sources, by belief propagation between them and the echoes.

    Parameters
    ----------
    sources, density
        After `judge_alone`.
    bin_count : int
        Of the look with most range bins.
    detection_probability : float
        Probability that an object that is loud enough is heard.
    prior_log_odds : float
        Of a quarter.
    log_odds : (quarters,) float64 array
        Set to those that each quarter holds an object.
    """
    looks_count, quarters = sources.kind.shape
    message = np.zeros((looks_count, quarters))
    explained = np.empty(bin_count)
    share = np.empty(quarters)
    log_odds[:] = prior_log_odds
    for _ in range(ROUNDS):
        for index in range(looks_count):
            explained[:] = CLUTTER_DENSITY
            for here in range(quarters):
                if sources.kind[index, here] == ECHO:
                    odds = math.exp(min(log_odds[here] - message[index, here], 30.0))
                    share[here] = odds / (1.0 + odds) * density[index, here]
                    explained[sources.bin[index, here]] += share[here]
            for here in range(quarters):
                new = 0.0
                if sources.kind[index, here] == ECHO:
                    rest = explained[sources.bin[index, here]] - share[here]
                    rest = max(rest, CLUTTER_DENSITY)
                    new = math.log(
                        detection_probability * density[index, here] / rest
                        + 1.0
                        - detection_probability
                    )
                elif sources.kind[index, here] == SILENCE:
                    new = math.log(
                        detection_probability * density[index, here] + 1.0 - detection_probability
                    )
                new = DAMPING * message[index, here] + (1.0 - DAMPING) * new
                log_odds[here] += new - message[index, here]
                message[index, here] = new


class Explained(NamedTuple):
    """What few pings say of the cells that may have returned their echoes.

    Parameters
    ----------
    slots : (cells,) integer array
        Places in memory of the cells that may hold an object.
    vacancy : (cells,) float64 array
        Logarithm of the probability that no quarter of a cell holds an object.
    power : (cells, QUARTERS) float64 array
        Mean power of each quarter.
    """

    slots: NDArray[np.intp]
    vacancy: NDArray[np.float64]
    power: NDArray[np.float64]


def explain(
    looks: Sequence[Look],
    find: Callable[[Look, NDArray[np.float32]], tuple[VisibleCells, int]],
    cells: int,
    parameters: MappingParameters,
) -> Explained | None:
    """Weigh all cells that may have returned any echo of some pings.

    Parameters
    ----------
    looks : sequence of Look
        The few pings, in bins of range.
    find : callable
        Finds the cells that a ping sees, of those that are not 0 in a layer.
    cells : int
        Number of slots of a layer.
    parameters : MappingParameters
        What is known of objects beforehand.

    Returns
    -------
    explained : Explained or None
        None if there are too many cells and pings to compare.
    """
    everywhere, sums = np.ones(cells, np.float32), np.zeros(cells, np.float32)
    for look in looks:
        seen, count = find(look, everywhere)
        tally(look, seen, count, parameters.reflectivity**2, sums)
    slots = np.flatnonzero(sums > 0.0)
    if len(slots) * QUARTERS * len(looks) > MOST_PAIRS:
        return None
    suspected = (sums > 0.0).astype(np.float32)
    sources = no_sources(slots, cells, len(looks))
    for index, look in enumerate(looks):
        seen, count = find(look, suspected)
        compare(look, index, seen, count, parameters.resolution_m, sources)
    bin_count = max(len(look.kind) for look in looks)
    return Explained(slots, *_weighed(sources, bin_count, parameters))


def _weighed(
    sources: Sources, bin_count: int, parameters: MappingParameters
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Vacancy of the sources, and mean power of each quarter: see `Explained`."""
    quarters = sources.kind.shape[1]
    density, power = np.empty(sources.kind.shape), np.empty(quarters)
    judge_alone(sources, power_steps(parameters), parameters.fluctuation, density, power)
    log_odds = np.empty(quarters)
    prior = logit(parameters.prior / QUARTERS)
    weigh_sources(sources, density, bin_count, parameters.detection_probability, prior, log_odds)
    vacancy = -np.logaddexp(0.0, log_odds).reshape(-1, QUARTERS).sum(axis=1)
    return vacancy, (logistic(log_odds) * power).reshape(-1, QUARTERS)


@compiled
def set_first_log_odds(
    slots: NDArray[np.intp],
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
    tiles: Tiles,
    vacancy: NDArray[np.float32],
    scale: Scale,
    log_odds: NDArray[np.float32],
) -> None:
    """Set the log-odds of suspected cells by what few pings say of them.

    As in `usmap_ros.mapping.superposition.log_odds.set_log_odds`, what is certain of a block of
    nine cells counts for those that hold a fair share of it.  Cells that are acquitted are left
    alone.

    Parameters
    ----------
    slots, rows, columns : (n,) integer arrays
        Place in memory, row and column of each suspected cell.
    tiles : Tiles
        Where the grid's cells are in memory.
    vacancy : (slots,) float32 array
        Logarithm of the probability that no quarter of a cell holds an object.
    scale : Scale
        Clamps, and the prior.
    log_odds : (slots,) float32 array
        Set for these cells, to that they are occupied.
    """
    for index in range(len(slots)):
        slot = slots[index]
        own, strongest, block = vacancy[slot], 0.0, 0.0
        for up in range(-1, 2):
            for right in range(-1, 2):
                neighbour = slot_beside(slot, rows[index], columns[index], up, right, tiles)
                if neighbour >= 0:
                    strongest = min(strongest, vacancy[neighbour])
                    block += vacancy[neighbour]
        if math.expm1(own) > OWN_SHARE * math.expm1(strongest):
            block = own
        value = math.log(max(-math.expm1(block), 1e-30)) - block
        if value > scale.prior:
            log_odds[slot] = min(max(value, scale.least), scale.greatest)
