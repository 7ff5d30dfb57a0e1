"""How the cost of a map grows: with pings, robots, range, cell size, area, and cores.

Everything but one thing is as in ``config/scenarios/poles.yaml``, for so long that there are 1,200
pings.  Each map is made in a process of its own, on one core, after a small one that loads what is
compiled; with more cores seconds of the clock count, so nothing else should go on then.

    python benchmarks/growth.py --page docs/scaling.md
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib.pyplot as plt
import numpy as np
import recordings
from pages import put_with_picture

from usmap_ros.mapping.joint.fusion import JointFusion
from usmap_ros.parameters import MappingParameters, ReconstructionParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.simulation import Scenario

SCENARIO = Path(__file__).parents[1] / "config/scenarios/poles.yaml"
#: Pings of each robot a second, and poles in a square metre, of that scenario.
RATE_HZ, POLES_M2 = 10.0, 0.3
#: Maps of each kind, of which the fastest counts.
TIMES = 3


class Setting(NamedTuple):
    """What is mapped."""

    pings: int = 1200
    robots: int = 3
    range_m: float = 5.0
    cell_m: float = 0.05
    side_m: float = 10.0
    cores: int = 1


BASE = Setting()
#: What is varied, what it is called, and what it is multiplied with.
FACTORS: dict[str, tuple[str, tuple[float, ...]]] = {
    "pings": ("pings", (300, 600, 1200, 2400, 4800)),
    "robots": ("robots, with as many pings in all", (1, 3, 6, 12)),
    "range_m": ("range, m", (2.5, 5.0, 10.0)),
    "cell_m": ("side of a cell, m", (0.1, 0.05, 0.025)),
    "side_m": ("side of the area, m, with as many poles a square metre", (10.0, 20.0, 40.0)),
    "cores": ("cores, seconds by the clock", (1, 2, 4, 8)),
}


def scenario(setting: Setting) -> Scenario:
    """The scenario of a setting."""
    made = Scenario.load(SCENARIO)
    world = made.world.model_copy(
        update={
            "area_m": (0.0, setting.side_m, 0.0, setting.side_m),
            "random_poles": made.world.random_poles.model_copy(
                update={"count": round(POLES_M2 * setting.side_m**2)}
            ),
        }
    )
    (transducer,) = made.robots[0].transducers
    transducer = transducer.model_copy(update={"max_range_m": setting.range_m})
    robots = [
        made.robots[0].model_copy(update={"name": f"robot{n + 1}", "transducers": [transducer]})
        for n in range(setting.robots)
    ]
    seconds = setting.pings / setting.robots / RATE_HZ
    return made.model_copy(update={"world": world, "robots": robots, "duration_s": seconds})


def map_of(cones: list[EchoCone], cell_m: float) -> tuple[float, float]:
    """Seconds of processor time and of the clock that a map takes."""
    fusion = JointFusion(MappingParameters(resolution_m=cell_m))
    started = time.process_time(), time.perf_counter()
    for cone in cones:
        fusion.fuse(cone)
    fusion.occupancy_map()
    return time.process_time() - started[0], time.perf_counter() - started[1]


def measure(setting: Setting, kept: Path) -> dict[str, Any]:
    """Map one setting, in this process."""
    made = recordings.cones(scenario(setting), ReconstructionParameters(), kept)
    cones = [cone for _, cone in made]
    map_of(cones[:60], setting.cell_m)
    times_s = [map_of(cones, setting.cell_m) for _ in range(TIMES)]
    processor_s, clock_s = np.min(times_s, axis=0)
    return {"pings": len(cones), "processor_s": processor_s, "clock_s": clock_s}


def apart(setting: Setting, kept: Path) -> dict[str, Any]:
    """The same in a process of its own, with as many cores."""
    cores = set(sorted(os.sched_getaffinity(0))[: setting.cores])
    command = [sys.executable, __file__, "--one", json.dumps(setting), "--cache", str(kept)]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        command, stdout=subprocess.PIPE, check=True, env=environment,
        preexec_fn=lambda: os.sched_setaffinity(0, cores),
    )  # fmt: skip
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def rows_of(kept: Path) -> list[dict[str, Any]]:
    """A row for each setting."""
    rows = []
    there = len(os.sched_getaffinity(0))
    for factor, (shown, values) in FACTORS.items():
        for value in values:
            if factor == "cores" and value > there:
                continue
            setting = BASE._replace(**{factor: value})
            found = apart(setting, kept)
            seconds = found["clock_s" if factor == "cores" else "processor_s"]
            row = {"factor": factor, "shown": shown, "value": value, "seconds": seconds}
            rows.append(row | {"pings": found["pings"]})
            print(json.dumps(rows[-1]), file=sys.stderr, flush=True)
    return rows


def table(rows: list[dict[str, Any]]) -> str:
    """Rows as a table."""
    lines = ["| what is varied | value | pings | s a map | ms a ping | times the usual |"]
    lines.append("|---|---:|---:|---:|---:|---:|")
    for row in rows:
        usual = _usual(rows, row["factor"])
        lines.append(
            f"| {row['shown']} | {row['value']:g} | {row['pings']:,} | {row['seconds']:.2f}"
            f" | {1e3 * row['seconds'] / row['pings']:.2f} | {row['seconds'] / usual:.2f} |"
        )
    return "\n".join(lines)


def _usual(rows: list[dict[str, Any]], factor: str) -> float:
    """Seconds with nothing varied, as they were measured beside others of a factor."""
    base = getattr(BASE, factor)
    return float(next(r["seconds"] for r in rows if (r["factor"], r["value"]) == (factor, base)))


def draw(rows: list[dict[str, Any]], path: Path) -> None:
    """Draw by how much a map costs more as each thing grows."""
    figure, axes = plt.subplots(figsize=(7.0, 4.2), layout="constrained")
    for factor, (shown, _) in FACTORS.items():
        own = [row for row in rows if row["factor"] == factor]
        grown = [row["value"] / getattr(BASE, factor) for row in own]
        cost = [row["seconds"] / _usual(rows, factor) for row in own]
        axes.plot(grown, cost, "o-", label=shown)
    axes.set(xlabel="times as much", ylabel="times the time of a map")
    for axis, set_scale in ((axes.xaxis, axes.set_xscale), (axes.yaxis, axes.set_yscale)):
        set_scale("log", base=2)
        axis.set_major_formatter("{x:g}")
    axes.grid(visible=True, alpha=0.3)
    axes.legend(fontsize="small")
    figure.savefig(path, dpi=100)
    plt.close(figure)


def main() -> None:
    """Print the table, or put it on a page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--page", type=Path, help="put table and picture there")
    parser.add_argument("--cache", type=Path, help="folder where cones are kept")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    kept = arguments.cache or Path(os.environ.get("TMPDIR", "/tmp"), "usmap_bench")
    kept.mkdir(exist_ok=True, parents=True)
    if arguments.one:
        print(json.dumps(measure(Setting(*json.loads(arguments.one)), kept)))
        return
    rows = rows_of(kept)
    text = table(rows)
    if arguments.page is None:
        print(text)
    else:
        caption = "How many times as long a map takes as each thing grows"
        put_with_picture(arguments.page, "growth", text, caption, lambda path: draw(rows, path))


if __name__ == "__main__":
    main()
