"""How likely it is that walls which are heard squarely are mirrors, and not lines by chance.

Rough walls and scattered objects line up, too: what they return varies, others follow it, others
came before it, and points explain it as well.  Each of these is little by itself; together they are
log-odds, by logistic regression over simulated recordings of other sensors than the usual one
(`benchmarks/mirror_odds.py`).
"""

import math
from collections.abc import Sequence

import numpy as np

from usmap_ros.mapping.joint.surfaces.mirrors import MirrorWall
from usmap_ros.numerics.arrays import FloatArray

#: Weights of what `signs_of` gives.
WEIGHTS = 6.3, -1.34, -1.36, 1.62, -0.3, -3.25, -1.74
#: By how much a point may explain each echo of a wall better or worse, and what one wall says at
#: the most.
MOST_OVER_POINT, MOST_ODDS = 1.5, 4.0
#: Log-odds of all walls of a place together from which on it has mirrors.
LEAST_ODDS = 3.0


def mirror_odds(walls: Sequence[MirrorWall], explained: float) -> FloatArray:
    """Log-odds that walls are mirrors, each by itself.

    Parameters
    ----------
    walls : sequence of MirrorWall
        The walls.
    explained : float
        Share of all echoes that reliable cells explain.

    Returns
    -------
    log_odds : (walls,) array
        Of each.
    """
    return np.clip(signs_of(walls, explained) @ WEIGHTS, -MOST_ODDS, MOST_ODDS)


def signs_of(walls: Sequence[MirrorWall], explained: float) -> FloatArray:
    """What tells mirrors from chance: (walls, signs) array; arguments as of `mirror_odds`."""
    signs = [_signs(wall, explained) for wall in walls]
    return np.array(signs).reshape(-1, len(WEIGHTS))


def _signs(wall: MirrorWall, explained: float) -> tuple[float, ...]:
    hits = len(wall.echoes)
    over_point = min(max(wall.over_point / hits, -MOST_OVER_POINT), MOST_OVER_POINT)
    return (
        1.0, math.log1p(wall.following), wall.deviation, over_point, math.log(hits), explained,
        math.log1p(wall.before),
    )  # fmt: skip
