"""What fleets of 10, 1,000 and 100,000 robots need, by a model of measured figures.

The model is a sum: robots times pings times what each ping costs.  It holds because a robot's
pings are reconstructed by themselves, because fusion's time for a cone does not depend on the area
of the map (benchmarks/cones.py), and because areas are fused apart and joined as tiles.  Measured
figures are arguments, with defaults from docs/scaling.md.

    python benchmarks/fleets.py --ms-reconstruction 1.0 --ms-fusion 2.4
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass

#: Kilobytes of a cone on the link, with its packets' headers: benchmarks/hosts.py.
CONE_KB = 1.1
#: Bytes of a cell that was in reach of a ping: `Fusion.memory_bytes` over its tiles' cells.
CELL_BYTES = 208
#: Share of a core that is planned with: the rest is for what comes at once, and for publishing.
LOAD = 0.5
#: Area that one robot keeps mapping, m², in cells of 5 cm.
ROBOT_AREA_M2, CELL_M = 100.0, 0.05


@dataclass(frozen=True)
class Costs:
    """What a ping costs.

    Parameters
    ----------
    ms_reconstruction, ms_fusion : float
        Of one core, for a ping and for its cone.
    pings_hz : float
        Of each robot.
    cores : int
        Of a host.
    """

    ms_reconstruction: float
    ms_fusion: float
    pings_hz: float
    cores: int


def needs(robots: int, costs: Costs) -> dict[str, float]:
    """What a fleet needs.

    Returns
    -------
    dict
        Pings a second; cores that reconstruct, on the robots or elsewhere; robots that one fusion
        takes, fusions, and hosts for both; Mbit/s of cones in all, and into one fusion; GB of
        cells.
    """
    pings_s = robots * costs.pings_hz
    reconstruction = pings_s * costs.ms_reconstruction / 1e3 / LOAD
    robots_a_fusion = max(1, math.floor(LOAD * 1e3 / costs.ms_fusion / costs.pings_hz))
    fusions = math.ceil(robots / robots_a_fusion)
    cells = robots * ROBOT_AREA_M2 / CELL_M**2
    return {
        "pings/s": pings_s,
        "cores reconstructing": reconstruction,
        "robots a fusion": min(robots, robots_a_fusion),
        "fusions": fusions,
        "hosts": math.ceil((reconstruction + fusions) / costs.cores),
        "Mbit/s": pings_s * CONE_KB * 8e-3,
        "Mbit/s a fusion": min(robots, robots_a_fusion) * costs.pings_hz * CONE_KB * 8e-3,
        "cells": cells,
        "GB": cells * CELL_BYTES / 1e9,
    }


def table(costs: Costs, fleets: tuple[int, ...] = (10, 1_000, 100_000)) -> str:
    """All of it in Markdown, a column for each fleet."""
    columns = [needs(robots, costs) for robots in fleets]
    lines = ["| | " + " | ".join(f"{robots:,} robots" for robots in fleets) + " |"]
    lines.append("|---|" + "---:|" * len(fleets))
    for name in columns[0]:
        lines.append(f"| {name} | " + " | ".join(shown(one[name]) for one in columns) + " |")
    return "\n".join(lines)


def shown(value: float) -> str:
    """Three figures."""
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ms-reconstruction", type=float, default=1.0)
    parser.add_argument("--ms-fusion", type=float, default=2.4)
    parser.add_argument("--rate", type=float, default=15.0, help="pings a robot, Hz")
    parser.add_argument("--cores", type=int, default=8, help="of a host")
    given = parser.parse_args()
    print(table(Costs(given.ms_reconstruction, given.ms_fusion, given.rate, given.cores)))


if __name__ == "__main__":
    main()
