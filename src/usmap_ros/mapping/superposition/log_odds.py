"""Log-odds update: from evidence to what the map says, and how opaque each cell is to sound."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.superposition.cells import Tiles, slot_beside
from usmap_ros.numerics.compiled import compiled, compiled_within
from usmap_ros.numerics.special import logit
from usmap_ros.parameters import MappingParameters

#: A cell with less than this share of its strongest neighbour's evidence owes its block's to it.
OWN_SHARE = 0.25
#: The same for hiding what is behind: a wall has no gaps between its strongest cells.
HIDING_SHARE = 0.1
#: Evidence, over the threshold, and the log-odds of cells of that much to hold or touch a surface:
#: what those of the benchmark with seeds 911 to 934 had, between poles, which were always right,
#: and rooms.  It steps where they came to be right more often than not: what is less certain is
#: not shown.
CALIBRATION = (
    (0.125, -3.0), (0.19, 0.5), (1.05, 0.6), (1.06, 2.2), (2.6, 2.3), (4.0, 2.4), (2000.0, 30.0),
)  # fmt: skip
#: The same of cells through which sound is known to have gone all the same: less evidence will do.
PASSED_EVIDENCE, PASSED_LOG_ODDS = 0.25, 2.2
#: Nothing hides with more certainty than this.
MOST_CERTAIN = 0.98
#: Share of its width that a lone cell hides: a pole is narrower than its cell, and sound bends.
LONE_COVER = 0.15
#: Log-odds that each silent look takes from a cell in which nothing is suspected.
SILENT_LOOK = 0.2


class Scale(NamedTuple):
    """How evidence becomes log-odds.

    Parameters
    ----------
    threshold : float
        Evidence at which a cell is as likely occupied as free.
    slope : float
        Log-odds per unit of log-likelihood ratio; less than 1, as looks are not independent.
    least, greatest : float
        Bounds that log-odds are kept within.
    prior : float
        Log-odds of a cell of which nothing is known.
    """

    threshold: float
    slope: float
    least: float
    greatest: float
    prior: float


def scale_of(parameters: MappingParameters) -> Scale:
    """How evidence becomes log-odds by the parameters."""
    return Scale(
        threshold=parameters.evidence_threshold,
        slope=parameters.evidence_slope,
        least=parameters.least_log_odds,
        greatest=parameters.greatest_log_odds,
        prior=logit(parameters.prior),
    )


@compiled_within
def strongest_neighbour(
    slot: int, row: int, column: int, tiles: Tiles, own: NDArray[np.float32]
) -> float:
    """Greatest evidence of a cell by itself among a cell and its eight neighbours."""
    strongest = 0.0
    for rows in range(-1, 2):
        for columns in range(-1, 2):
            neighbour = slot_beside(slot, row, column, rows, columns, tiles)
            if neighbour >= 0:
                strongest = max(strongest, own[neighbour])
    return strongest


@compiled_within
def log_odds_of(evidence: float, scale: Scale) -> float:
    """Log-odds of a cell by its evidence: the prior without any, 0 at the threshold."""
    if evidence > scale.threshold:
        return scale.slope * (evidence - scale.threshold)
    return scale.prior * (1.0 - evidence / scale.threshold)


@compiled
def set_log_odds(
    slots: NDArray[np.intp],
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
    tiles: Tiles,
    own: NDArray[np.float32],
    block: NDArray[np.float32],
    scale: Scale,
    log_odds: NDArray[np.float32],
) -> None:
    """Set the log-odds of suspected cells.

    A block of nine cells may be certain of its object, and each cell by itself be dispensable:
    so the block's evidence counts for those of its cells that hold a fair share of it.

    Parameters
    ----------
    slots, rows, columns : (n,) integer arrays
        Place in memory, row and column of each suspected cell.
    tiles : Tiles
        Where the grid's cells are in memory.
    own, block : (slots,) float32 arrays
        Evidence of cells by themselves and with their neighbours.
    scale : Scale
        How it becomes log-odds.
    log_odds : (slots,) float32 array
        Set for these cells, to that they are occupied.
    """
    for index in range(len(slots)):
        slot = slots[index]
        strongest = strongest_neighbour(slot, rows[index], columns[index], tiles, own)
        evidence, by_itself = block[slot], own[slot]
        if by_itself < OWN_SHARE * strongest:
            evidence = min(evidence, by_itself)
        else:
            evidence = max(evidence, by_itself)
        value = log_odds_of(evidence, scale)
        log_odds[slot] = min(max(value, scale.least), scale.greatest)


@compiled
def find_hiding(
    slots: NDArray[np.intp],
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
    tiles: Tiles,
    own: NDArray[np.float32],
    block: NDArray[np.float32],
    scale: Scale,
    hiding: NDArray[np.float32],
) -> None:
    """Belief that suspected cells belong to something that hides what is behind it.

    Arguments are those of `set_log_odds`; `hiding` is set.
    """
    for index in range(len(slots)):
        slot = slots[index]
        hiding[slot] = 0.0
        strongest = strongest_neighbour(slot, rows[index], columns[index], tiles, own)
        if own[slot] > HIDING_SHARE * strongest:
            evidence = max(own[slot], block[slot])
            exponent = min(max(scale.slope * (evidence - scale.threshold), -30.0), 30.0)
            hiding[slot] = 1.0 / (1.0 + math.exp(-exponent))


@compiled
def set_depth(
    slots: NDArray[np.intp],
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
    tiles: Tiles,
    hiding: NDArray[np.float32],
    opacity: float,
    depth: NDArray[np.float32],
) -> None:
    """Optical depth of suspected cells: −κ ln(1 − p), for lone ones with a share of it.

    Arguments are those of `find_hiding`; `depth` is set.
    """
    for index in range(len(slots)):
        slot = slots[index]
        around = -hiding[slot]
        for up in range(-1, 2):
            for right in range(-1, 2):
                neighbour = slot_beside(slot, rows[index], columns[index], up, right, tiles)
                if neighbour >= 0:
                    around += hiding[neighbour]
        cover = hiding[slot] * min(1.0, LONE_COVER + 0.5 * around)
        depth[slot] = -opacity * math.log(1.0 - min(cover, MOST_CERTAIN))


def evidence_of(log_odds: NDArray[np.float32], scale: Scale) -> NDArray[np.float64]:
    """Return the evidence that gives log-odds: the inverse of `log_odds_of`."""
    below = scale.threshold * (1.0 - log_odds / scale.prior)
    above = log_odds / scale.slope + scale.threshold
    evidence: NDArray[np.float64] = np.where(log_odds > 0.0, above, below)
    return evidence


def calibrated(log_odds: NDArray[np.float32], scale: Scale) -> NDArray[np.float32]:
    """Log-odds that cells turned out to have whose evidence gives certain log-odds.

    Parameters
    ----------
    log_odds : (n,) float32 array
        By `set_log_odds`, not clamped.
    scale : Scale
        Of the evidence.

    Returns
    -------
    log_odds : (n,) float32 array
        Such that of cells with a probability of 0.8 four in five hold or touch a surface: see
        `CALIBRATION`.  They rise with the evidence as before.
    """
    evidence, found = _calibration(scale)
    turned_out = np.interp(evidence_of(log_odds, scale), evidence, found)
    return np.where(log_odds > scale.prior, turned_out, log_odds).astype(np.float32)


def beside_free_space(
    log_odds: NDArray[np.float32], shown: NDArray[np.float32], scale: Scale
) -> NDArray[np.float32]:
    """Log-odds that cells turned out to have which sound is known to have passed.

    Sound passes through a cell and comes back from it where a surface begins: a quarter of the
    evidence that other cells need is enough (see `CALIBRATION`).

    Parameters
    ----------
    log_odds : (n,) float32 array
        By `set_log_odds`, not clamped.
    shown : (n,) float32 array
        The same after `calibrated`.
    scale : Scale
        Of the evidence.
    """
    is_enough = evidence_of(log_odds, scale) >= PASSED_EVIDENCE * scale.threshold
    least = np.where(is_enough, np.float32(PASSED_LOG_ODDS), shown)
    raised: NDArray[np.float32] = np.maximum(shown, least)
    return raised


def uncalibrated(log_odds: NDArray[np.float32], scale: Scale) -> NDArray[np.float64]:
    """Return the evidence that `calibrated` turns into log-odds."""
    evidence, found = _calibration(scale)
    below = evidence_of(log_odds, scale)
    return np.where(log_odds > scale.prior, np.interp(log_odds, found, evidence), below)


def _calibration(scale: Scale) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Evidence and log-odds at the corners of the calibration."""
    evidence, found = np.array([(0.0, scale.prior), *CALIBRATION]).T
    return scale.threshold * evidence, found


def seen_free(
    clear: NDArray[np.float32],
    silent: NDArray[np.float32],
    proof: float,
    observed_exposure: float,
) -> NDArray[np.float32]:
    """Exposure of cells: proven rays and trusted silence on one scale."""
    exposure: NDArray[np.float32] = np.maximum(silent, (observed_exposure / proof) * clear)
    return exposure
