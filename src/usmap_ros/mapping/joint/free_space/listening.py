"""What pings heard, and were to hear, beside what is known to stand."""

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.forward_model.log_odds import over_block
from usmap_ros.mapping.joint.forward_model.powers import Powers
from usmap_ros.mapping.joint.free_space.response import HeardBins, listen
from usmap_ros.mapping.joint.free_space.silence import walled_share
from usmap_ros.mapping.joint.surfaces.lines import drawn
from usmap_ros.mapping.joint.surfaces.smooth_surfaces import SmoothSurfaces
from usmap_ros.mapping.joint.surfaces.walls import Walls
from usmap_ros.mapping.ping_table import BIN_M, GREATEST_RANGE, LEAST_RANGE
from usmap_ros.numerics.arrays import BoolArray, FloatArray

#: Range bins, in cells, to either side of a cell's that belong to it.
LISTENING_CELLS = 0.75
#: How far echoes are taken for those of what is estimated and not shown, in cells that scatter
#: little themselves: less than so many times what estimates leave out.  Of an echo that nothing
#: shown explains, any cell at its range may be the source; but what all pings together have it come
#: from is right more often than not.
TRUSTED, SCATTERS = 0.7, 100.0
#: Pings up to which estimates are not trusted for that, and from which on they are.
FEW_PINGS, MANY_PINGS = 100.0, 300.0
#: By how much things are taken to be fainter from where they are near to where they are as far as
#: a sensor that reports the first thing only hears, and louder where they are near, dB.
FADING_DB, NEAR_DB = 20.0, 6.0


def listening_beside(
    walls: Walls,
    smooth: SmoothSurfaces,
    powers: Powers,
    numbers: FloatArray,
    pings: NDArray[np.int64],
    first_only: BoolArray,
    resolution_m: float,
    trusted: float,
) -> HeardBins:
    """What was heard, and was to be heard by what stands.

    What is estimated and not shown counts apart: an unsure wall must not explain its own echoes.

    Parameters
    ----------
    walls, smooth, powers
        What stands, and what it scatters.
    numbers : (pings, columns) array
        Of the pings, as in a `PingTable`.
    pings : (pings,) integer array
        Their rows in that.
    first_only : (pings,) bool array
        Pings of sensors that report the first thing only.
    resolution_m : float
        Side of a cell.
    trusted : float
        How far what is estimated and not shown is trusted, by `trust`.
    """
    expected = powers.expected_of(over_block(walls.shown).ravel())
    reach = max(1, round(LISTENING_CELLS * resolution_m / float(np.median(numbers[:, BIN_M]))))
    listening = listen(smooth.put_back(expected), pings, expected, reach)
    _fade(listening, numbers, first_only)
    if not trusted:
        return listening
    # What smooth things return is added to it.
    every = powers.expected.copy()
    likely = listen(smooth.put_back(every), pings, every, reach).chance
    np.multiply(likely, np.float32(trusted), out=likely)
    np.maximum(likely, listening.chance, out=likely)
    return listening._replace(likely=likely)


def trust(pings: float, walls: Walls) -> float:
    """How far an estimate is trusted, where it is not shown.

    Among lone things it explains little that is not shown, and poles that were missed are lost.

    Parameters
    ----------
    pings : float
        How many pings it is made from, those from one place being one.
    walls : Walls
        What is shown.
    """
    near_lines = over_block(drawn(walls.all_lines, walls.shown.shape))
    share = float(np.interp(pings, (FEW_PINGS, MANY_PINGS), (0.0, 1.0)))
    return TRUSTED * share * walled_share(walls.shown, near_lines)


def scattering(powers: Powers) -> BoolArray:
    """Cells that echoes may well be of, by the estimate: their own, or those of cells beside them.

    Parameters
    ----------
    powers : Powers
        The estimate.
    """
    return over_block(powers.of_cells > SCATTERS * powers.limits.least)


def _fade(listening: HeardBins, numbers: FloatArray, first_only: BoolArray) -> None:
    """Let what is far be fainter to sensors that report the first thing only.

    They do not say how loud things are: a surface that is sure to be heard nearby, round or not,
    may be too faint far away.  Where it is not, that is learnt.
    """
    limit = listening.limit
    listening.fainter[first_only] = 0
    those = numbers[first_only]
    bins = np.arange(limit.shape[1]) + 0.5
    ranges_m = those[:, LEAST_RANGE, np.newaxis] + those[:, BIN_M, np.newaxis] * bins
    share = np.minimum(ranges_m / those[:, GREATEST_RANGE, np.newaxis], 1.0)
    limit[first_only] *= 10.0 ** (0.1 * (share * FADING_DB - NEAR_DB))
