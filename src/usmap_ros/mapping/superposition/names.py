"""Names of the layers that a map by superposition is kept in."""

from __future__ import annotations

from usmap_ros.mapping.superposition.cells import QUARTERS
from usmap_ros.mapping.superposition.shares import Shares
from usmap_ros.mapping.superposition.snapshot import CLEAR, SILENT

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
#: Evidence: of cells by themselves, of blocks, of rays that passed, of silence; and the cells'
#: shares in what was heard.
EVIDENCE = ("own", "block", CLEAR, SILENT, *Shares._fields)
#: It is kept thrice: what the map shows, what the pass under way has gathered so far, and what
#: pings have left behind that are no longer in the window.
SHOWN, GATHERED, LASTING = "shown", "gathered", "lasting"
#: Layers with several values a cell.
SEVERAL = dict.fromkeys((POWER, ATTRACTION, PRESSURE), QUARTERS)


def layer_of(kind: str, name: str) -> str:
    """Name of a layer of evidence."""
    return f"{kind} {name}"


#: The value of cells of which nothing is known.
DEFAULTS: dict[str, float] = {
    **dict.fromkeys(
        (POWER, ATTRACTION, PRESSURE, LOOKS, ALIVE, BELIEF, HIDING, DEPTH, RELEVANT, VACANCY), 0.0
    ),
    **{layer_of(kind, name): 0.0 for kind in (SHOWN, GATHERED, LASTING) for name in EVIDENCE},
    EVERYWHERE: 1.0,
}
