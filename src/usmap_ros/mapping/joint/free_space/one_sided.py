"""Places that were looked at from one side only, as by robots that look ahead and go round.

Whoever hears a thing from ahead alone knows how far away it is, and not where across: any cell of
the arc in its beam explains the echoes as well, and what was not looked at aslant does not tell how
it answers.  Where most of what stands was heard so, sound need not have come back from where it is
drawn, and grazing silence says nothing.
"""

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.forward_model.cell_evidence import CellEvidence
from usmap_ros.mapping.joint.forward_model.log_odds import over_block
from usmap_ros.numerics.arrays import BoolArray, FloatArray

#: Medians, over what stands, of how far directions spread that it was heard from, up to which a
#: place was looked at from one side, and from which on it was from several.  Of robots that wander,
#: or look to several sides, medians are 0.26 to 0.51 in 16 rooms; of those that look ahead and go
#: round, 0.02 to 0.2 in seven.
ONE_SIDE, SEVERAL_SIDES = 0.12, 0.25
#: Spread from which on a cell is where it is drawn.
SURE = 0.15
#: Echoes of a cell that tell where it was heard from.
LEAST_HEARD = 0.5


def spreads(evidence: CellEvidence) -> FloatArray:
    """Root mean square sine of directions that cells were heard from, off the one of most of it.

    Parameters
    ----------
    evidence : CellEvidence
        Of the cells.

    Returns
    -------
    spreads : (cells,) array
        Of each; 0 for what was not heard.
    """
    heard = np.maximum(evidence.heard, 1e-6)
    square = 0.5 * (1.0 - np.hypot(evidence.axis_cos, evidence.axis_sin) / heard)
    return np.where(evidence.heard > 0.0, np.sqrt(np.maximum(square, 0.0)), 0.0)


def one_sided_share(evidence: CellEvidence, occupied: BoolArray) -> float:
    """How far a place was looked at from one side only, from 0 to 1.

    Parameters
    ----------
    evidence : CellEvidence
        Of its cells.
    occupied : (rows, columns) bool array
        What stands by it.
    """
    tells = occupied.ravel() & (evidence.heard > LEAST_HEARD)
    if not tells.any():
        return 0.0
    usual = float(np.median(spreads(evidence)[tells]))
    return float(np.interp(usual, (ONE_SIDE, SEVERAL_SIDES), (1.0, 0.0)))


def surely_returned(
    evidence: CellEvidence, shown: BoolArray, power: NDArray[np.float32], one_sided: float
) -> NDArray[np.float32]:
    """Power of what stands, as far as that is known to be where it is drawn.

    Parameters
    ----------
    evidence : CellEvidence
        Of cells.
    shown : (rows, columns) bool array
        What stands.
    power : (rows, columns) float32 array
        What cells return.
    one_sided : float
        By `one_sided_share`.
    """
    doubted = 1.0 - np.minimum(spreads(evidence).reshape(shown.shape) / SURE, 1.0) ** 2
    sure = np.where(over_block(shown), 1.0 - one_sided * doubted, 0.0)
    return (power * sure).astype(np.float32)
