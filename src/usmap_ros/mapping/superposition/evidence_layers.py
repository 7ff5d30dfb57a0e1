"""The layers of the grid that hold evidence, and the evidence that they hold."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.superposition.cells import QUARTERS
from usmap_ros.mapping.superposition.inverse_sensor_model import Evidence
from usmap_ros.mapping.superposition.ping_update import Accumulators
from usmap_ros.mapping.superposition.responsibilities import Responsibilities

#: Power of each quarter of a cell, the two averages that it is learnt from, from how many looks,
#: and whether there is any.
POWER, ATTRACTION, PRESSURE, LOOKS = "power", "attraction", "pressure", "looks"
ALIVE = "alive"
#: As of the end of the last pass: log-odds, the belief that a cell belongs to something that hides
#: what is behind it, and its optical depth; and cells of which the pass under way said anything.
BELIEF, HIDING, DEPTH, RELEVANT = "belief", "hiding", "depth", "relevant"
#: By the first few pings: logarithm of the probability that a cell is empty.
VACANCY = "vacancy"
#: A layer of ones.
EVERYWHERE = "everywhere"
#: What pings say of cells is kept in a layer for each field of `Accumulators`, by its name; but for
#: `RELEVANT`, which is of one pass only.
EVIDENCE = (*(name for name in Evidence._fields if name != RELEVANT), *Responsibilities._fields)
#: It is kept thrice: what the map shows, what the pass under way has gathered so far, and what
#: pings have left behind that are no longer in the window.
SHOWN, GATHERED, LASTING = "shown", "gathered", "lasting"
#: Layers with several values a cell.
SEVERAL = dict.fromkeys((POWER, ATTRACTION, PRESSURE), QUARTERS)


def layer_of(stage: str, name: str) -> str:
    """Name of the layer that holds a field of the evidence of a stage."""
    return f"{stage} {name}"


def accumulators_of(layer: Callable[[str], NDArray[np.float32]], stage: str) -> Accumulators:
    """Evidence of a stage: `SHOWN`, `GATHERED` or `LASTING`.

    Parameters
    ----------
    layer : callable
        Values of a layer of the grid by its name, (slots,) float32 arrays that share its memory.
    stage : str
        Which of the three.
    """
    return Accumulators(
        Evidence(
            **{name: layer(layer_of(stage, name)) for name in Evidence._fields if name in EVIDENCE},
            relevant=layer(RELEVANT),
        ),
        responsibilities_of(layer, stage),
    )


def responsibilities_of(
    layer: Callable[[str], NDArray[np.float32]], stage: str
) -> Responsibilities:
    """The cells' shares in what was heard, as `accumulators_of` has them."""
    return Responsibilities(
        **{name: layer(layer_of(stage, name)) for name in Responsibilities._fields}
    )


#: The value of cells of which nothing is known.
DEFAULTS: dict[str, float] = {
    **dict.fromkeys(
        (POWER, ATTRACTION, PRESSURE, LOOKS, ALIVE, BELIEF, HIDING, DEPTH, RELEVANT, VACANCY), 0.0
    ),
    **{layer_of(stage, name): 0.0 for stage in (SHOWN, GATHERED, LASTING) for name in EVIDENCE},
    EVERYWHERE: 1.0,
}
