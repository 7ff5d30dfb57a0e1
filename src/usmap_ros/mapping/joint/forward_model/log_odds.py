"""From evidence to log-odds, and to how opaque cells are to sound."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.forward_model.cell_evidence import CellEvidence
from usmap_ros.numerics.arrays import BoolArray, FloatArray

#: A cell with less than this share of its strongest neighbour's evidence owes its block's to it;
#: the same for hiding what is behind, for a wall has no gaps between its strongest cells.
OWN_SHARE, HIDING_SHARE = 0.25, 0.1
#: Evidence from which on a cell is suspected, and at which it hides what is behind it, with the
#: steepness of that.
SUSPECTED, HIDING_EVIDENCE, HIDING_SLOPE = 1.0, 6.0, 0.5
#: Evidence below which a cell hides nothing, and beyond which it hides for certain.
HIDES_NOTHING, HIDES_CERTAINLY = 1.0, 20.0
#: Nothing hides with more certainty than this; and what a lone cell hides of its width.
MOST_CERTAIN, LONE_COVER = 0.98, 0.15
#: Logistic regression of whether a suspected cell holds or touches a surface, on the logarithms
#: of its evidence, of its block's, of how far the directions spread that it was heard from, of how
#: often it was heard, and of how many echoes crowd around its own, on the share of the echoes at
#: its distance that are its own, and on how many neighbours are suspected, too: fitted to scenes
#: of the benchmark with seeds 1000 to 1003.  `benchmarks/cell_odds.py` fits such, and judges these:
#: by its default seeds, log loss 0.29 there and 0.27 with others.
INTERCEPT, OF_EVIDENCE, OF_BLOCK, OF_SPREAD = 2.68, 0.16, 0.35, 0.49
OF_NEIGHBOURS, OF_CROWD, OF_SPREAD_IN_CROWD = 0.07, -1.20, -0.09
OF_HEARD, OF_SHARE = 0.46, 0.89
OF_FEATURES = (
    OF_EVIDENCE, OF_BLOCK, OF_SPREAD, OF_NEIGHBOURS, OF_CROWD, OF_SPREAD_IN_CROWD, OF_HEARD,
    OF_SHARE,
)  # fmt: skip
#: The same of the logarithm of its block's power over what is usual in the place, where that is
#: less, and where it is more; and beyond which logarithms it makes no difference.
OF_FAINTER, OF_LOUDER, FAINTEST, LOUDEST = 0.57, -1.12, -2.3, 1.15
#: Log-odds, of what was heard alone, from which on a cell tells what is usual, or the surer half.
TELLS_USUAL = 3.65
#: Neighbours that count at the most, and what keeps logarithms finite.
MOST_NEIGHBOURS, LEAST_SPREAD, LEAST_HEARD, TINY = 4, 0.01, 0.1, 1e-9
#: Log-odds of cells that are not suspected.
NOTHING = -9.0


def over_block(values: NDArray[Any], combine: np.ufunc = np.maximum) -> NDArray[Any]:
    """Combine each cell with its eight neighbours: their maximum, or with `np.add` their sum."""
    rows, columns = values.shape
    padded = np.zeros((rows + 2, columns + 2), values.dtype)
    padded[1:-1, 1:-1] = values
    rows_of = combine(padded[:-2], padded[1:-1])
    combine(rows_of, padded[2:], out=rows_of)
    result: NDArray[Any] = combine(rows_of[:, :columns], rows_of[:, 1 : columns + 1])
    combine(result, rows_of[:, 2:], out=result)
    return result


def judged(evidence: CellEvidence, shape: tuple[int, int]) -> NDArray[np.float32]:
    """Evidence of each cell: its block's, if it holds a fair share of it."""
    return strength_of(evidence.own.reshape(shape), evidence.block.reshape(shape))


def strength_of(own: NDArray[np.float32], block: NDArray[np.float32]) -> NDArray[np.float32]:
    """The same, of evidence of cells and of their blocks, (rows, columns)."""
    is_major = _stands_for_block(own, block, OWN_SHARE)
    return np.where(is_major, np.maximum(own, block), np.minimum(own, block))


def _stands_for_block(
    own: NDArray[np.float32], block: NDArray[np.float32], share: float
) -> BoolArray:
    """Whether a cell holds a fair share of what speaks for it and its neighbours.

    Where each cell alone explains the pings worse than none does, and all together explain them
    well, as a point does that is heard from poses that are a little off, it is the one in the
    middle of them.
    """
    greatest = over_block(own)
    return np.where(greatest > 0.0, own >= share * greatest, block >= over_block(block))


def direction_spread(evidence: CellEvidence) -> NDArray[np.float32]:
    """How well a cell's place is known: least eigenvalue of Σ u uᵀ over directions heard from."""
    spread: NDArray[np.float32] = 0.5 * (
        evidence.heard - np.hypot(evidence.axis_cos, evidence.axis_sin)
    )
    return spread


def cell_log_odds(
    evidence: CellEvidence, shape: tuple[int, int], power: NDArray[np.float32] | None = None
) -> FloatArray:
    """Log-odds that each cell holds or touches a surface; `NOTHING` where none is suspected.

    Parameters
    ----------
    evidence : CellEvidence
        Of all pings.
    shape : (int, int)
        Rows and columns.
    power : (rows, columns) float32 array, optional
        What each cell scatters: surfaces of a place do so alike, and what is left over for ghosts
        is less.  Without it log-odds are of what was heard alone.
    """
    log_odds = np.full(shape, NOTHING)
    # Nothing is suspected in most cells, and logarithms take long.
    suspected, features = cell_features(evidence, shape)
    of_heard = heard_log_odds(features)
    if power is not None and suspected.any():
        of_heard += _of_power(np.log(over_block(power, np.add)[suspected] + TINY), of_heard)
    log_odds[suspected] = of_heard
    return log_odds


def cell_features(evidence: CellEvidence, shape: tuple[int, int]) -> tuple[BoolArray, FloatArray]:
    """Cells that are suspected, and what their log-odds are linear in, in `OF_FEATURES`' order.

    Parameters
    ----------
    evidence, shape
        As in `cell_log_odds`.

    Returns
    -------
    (rows, columns) bool array, (suspected, features) array
        Where a surface is suspected, and the features of those cells, row by row.
    """
    strength = judged(evidence, shape)
    suspected = strength > SUSPECTED
    neighbours = (over_block(suspected.astype(np.int32), np.add) - suspected)[suspected]
    cells = suspected.ravel()
    of = CellEvidence(*(values[cells] for values in evidence))
    spread = np.log(np.maximum(direction_spread(of), 0.0) + LEAST_SPREAD)
    crowd = np.log1p(of.crowd / np.maximum(of.heard, TINY))
    features: FloatArray = np.stack(
        [
            np.log(np.maximum(strength[suspected], 1.0)),
            np.sign(of.block) * np.log1p(np.abs(of.block)),
            spread,
            np.minimum(neighbours, MOST_NEIGHBOURS),
            crowd,
            crowd * spread,
            np.log(of.heard + LEAST_HEARD),
            of.heard / np.maximum(of.asked, TINY),
        ],
        axis=1,
    )
    return suspected, features


def heard_log_odds(features: FloatArray) -> FloatArray:
    """Log-odds of cells by what was heard alone; features as `cell_features` has them."""
    log_odds: FloatArray = INTERCEPT + features @ np.array(OF_FEATURES)
    return log_odds


def _of_power(log_power: FloatArray, log_odds: FloatArray) -> FloatArray:
    """What powers of cells' blocks add to their log-odds."""
    weights = np.array([OF_FAINTER, OF_LOUDER])
    added: FloatArray = power_features(log_power, log_odds) @ weights
    return added


def power_features(log_power: FloatArray, log_odds: FloatArray) -> FloatArray:
    """By how much blocks are fainter than is usual in the place, and louder, in logarithms.

    Parameters
    ----------
    log_power : (cells,) array
        Natural logarithms of their powers.
    log_odds : (cells,) array
        Of what was heard of them alone: the surest tell what is usual.

    Returns
    -------
    (cells, 2) array
        At the most `FAINTEST`, negative, and `LOUDEST`.
    """
    tells = log_odds >= min(TELLS_USUAL, float(np.median(log_odds)))
    off = log_power - np.median(log_power[tells])
    features: FloatArray = np.stack(
        [np.clip(off, FAINTEST, 0.0), np.clip(off, 0.0, LOUDEST)], axis=1
    )
    return features


def hiding(evidence: CellEvidence, shape: tuple[int, int], walls: BoolArray) -> FloatArray:
    """Belief that each cell belongs to something that hides what is behind it.

    Parameters
    ----------
    evidence : CellEvidence
        Of all pings.
    shape : (int, int)
        Rows and columns.
    walls : (rows, columns) bool array
        Cells on lines, which hide anyway.
    """
    own, block = evidence.own.reshape(shape), evidence.block.reshape(shape)
    strength = np.maximum(own, block)
    hides = _stands_for_block(own, block, HIDING_SHARE) & (strength > 0.0)
    logits = np.clip(HIDING_SLOPE * (strength[hides] - HIDING_EVIDENCE), -30.0, 30.0)
    belief: FloatArray = np.where(walls, 0.97, 0.0)
    belief[hides] = np.maximum(1.0 / (1.0 + np.exp(-logits)), belief[hides])
    return belief


def may_hide(evidence: CellEvidence) -> BoolArray:
    """Whether it is open, of each cell, if it hides what is behind it."""
    strength = np.maximum(evidence.own, evidence.block)
    is_open: BoolArray = (strength > HIDES_NOTHING) & (strength < HIDES_CERTAINLY)
    return is_open


def optical_depth(belief: FloatArray, opacity: float) -> NDArray[np.float32]:
    """Optical depth of cells: -κ ln(1 - p), for lone ones with a share of p.

    Parameters
    ----------
    belief : (rows, columns) array
        That a cell hides what is behind it.
    opacity : float
        κ.
    """
    depth, hides = np.zeros(belief.shape, np.float32), belief > 0.0
    own, around = belief[hides], over_block(belief, np.add)[hides]
    cover = np.minimum(own * np.minimum(1.0, LONE_COVER + 0.5 * (around - own)), MOST_CERTAIN)
    depth[hides] = -opacity * np.log(1.0 - cover)
    depth[depth < 0.01] = 0.0
    return depth
