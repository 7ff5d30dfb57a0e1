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
#: of its evidence, of how far the directions spread that it was heard from, of how often it was
#: heard, and of how many echoes crowd around its own, and on how many neighbours are suspected,
#: too: fitted to scenes of the benchmark with seed 911, log loss 0.31 there and 0.30 with 912.
INTERCEPT, OF_EVIDENCE, OF_SPREAD, OF_NEIGHBOURS = 1.57, 0.15, 0.52, 0.16
OF_CROWD, OF_SPREAD_IN_CROWD, OF_HEARD = -1.37, -0.14, 1.18
#: Neighbours that count at the most, and what keeps logarithms finite.
MOST_NEIGHBOURS, LEAST_SPREAD, LEAST_HEARD = 4, 0.01, 0.1
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


def cell_log_odds(evidence: CellEvidence, shape: tuple[int, int]) -> FloatArray:
    """Log-odds that each cell holds or touches a surface; `NOTHING` where none is suspected.

    Parameters
    ----------
    evidence : CellEvidence
        Of all pings.
    shape : (int, int)
        Rows and columns.
    """
    strength = judged(evidence, shape)
    suspected = strength > SUSPECTED
    neighbours = (over_block(suspected.astype(np.int32), np.add) - suspected)[suspected]
    # Nothing is suspected in most cells, and logarithms take long.
    strength, cells = strength[suspected], suspected.ravel()
    evidence = CellEvidence(*(values[cells] for values in evidence))
    spread = np.log(np.maximum(direction_spread(evidence), 0.0) + LEAST_SPREAD)
    heard = evidence.heard
    crowd = np.log1p(evidence.crowd / np.maximum(heard, 1e-6))
    log_odds = np.full(shape, NOTHING)
    log_odds[suspected] = (
        INTERCEPT
        + OF_EVIDENCE * np.log(np.maximum(strength, 1.0))
        + OF_SPREAD * spread
        + OF_NEIGHBOURS * np.minimum(neighbours, MOST_NEIGHBOURS)
        + OF_CROWD * crowd
        + OF_SPREAD_IN_CROWD * crowd * spread
        + OF_HEARD * np.log(heard + LEAST_HEARD)
    )
    return log_odds


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
