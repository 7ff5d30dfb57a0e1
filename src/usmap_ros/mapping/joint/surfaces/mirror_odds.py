"""How likely it is that walls which are heard squarely are mirrors, and not lines by chance.

Rough walls and scattered objects line up, too: what they return varies, others follow it, others
came before it, and points explain it as well.  Each of these is little by itself; together they are
log-odds, by logistic regression over simulated recordings of other sensors than the usual one
(`benchmarks/mirror_odds.py`).  A pane of glass among bricks is told from lines of their lone echoes
by weights of its own.
"""

import math
from collections.abc import Sequence

import numpy as np

from usmap_ros.mapping.joint.surfaces.mirrors import MirrorWall
from usmap_ros.numerics.arrays import BoolArray, FloatArray

#: Weights of what `signs_of` gives.
WEIGHTS = 6.3, -1.34, -1.36, 1.62, -0.3, -3.25, -1.74
#: By how much a point may explain each echo of a wall better or worse, and what one wall says at
#: the most.
MOST_OVER_POINT, MOST_ODDS = 1.5, 4.0
#: Log-odds of all walls of a place together from which on it has mirrors.
LEAST_ODDS = 3.0
#: Weights of what `pane_signs_of` gives, and log-odds of a pane before a line was looked at.
PANE_WEIGHTS, PANE_BEFORE = (-1.6, -1.2, -5.5, -2.7, 1.1, -1.2), -1.5
#: By how much a point may explain all echoes of such a line better or worse, and the deviation
#: below which it is no steadier.
MOST_OVER, STEADIEST = 30.0, 0.02


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


def expected_panes(lines: Sequence[MirrorWall], explained: float, is_explained: BoolArray) -> float:
    """How many of some lines of lone echoes are mirrors, in a place that seems to have none.

    Parameters
    ----------
    lines, explained
        As of `mirror_odds`.
    is_explained : (echoes,) bool array
        Whether reliable cells explain an echo.
    """
    odds = pane_signs_of(lines, explained, is_explained) @ PANE_WEIGHTS
    return float((1.0 / (1.0 + np.exp(-odds - PANE_BEFORE))).sum())


def pane_signs_of(
    lines: Sequence[MirrorWall], explained: float, is_explained: BoolArray
) -> FloatArray:
    """What tells panes from chance: (lines, signs) array; arguments as of `expected_panes`."""
    signs = [
        (
            1.0, math.log(max(line.deviation, STEADIEST)), explained,
            float(is_explained[line.echoes].mean()),
            math.copysign(math.sqrt(min(abs(line.over_point), MOST_OVER)), line.over_point),
            math.log1p(line.before),
        )
        for line in lines
    ]  # fmt: skip
    return np.array(signs).reshape(-1, len(PANE_WEIGHTS))


def _signs(wall: MirrorWall, explained: float) -> tuple[float, ...]:
    hits = len(wall.echoes)
    over_point = min(max(wall.over_point / hits, -MOST_OVER_POINT), MOST_OVER_POINT)
    return (
        1.0, math.log1p(wall.following), wall.deviation, over_point, math.log(hits), explained,
        math.log1p(wall.before),
    )  # fmt: skip
