"""How long programs take to start, the inner loops being compiled already.

Processor time, in milliseconds, of a whole process: the least of several.  The map is that of the
first ten pings of a scenario of poles, so that little of its time is work.  Python keeps what it
makes of sources, as it does of an installed package.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
from itertools import islice
from pathlib import Path
from typing import Any

from usmap_ros.io.bags import write_bag
from usmap_ros.simulation import Scenario, simulate

SCENARIO = Path(__file__).parents[1] / "config/scenarios/poles.yaml"
USMAP = [sys.executable, "-m", "usmap_ros"]


def run() -> dict[str, Any]:
    """Measure."""
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / "bag"
        write_bag(bag, islice(simulate(Scenario.load(SCENARIO)), 10))
        programs = {
            "python": [sys.executable, "-c", ""],
            "numpy": [sys.executable, "-c", "import numpy"],
            "usmap_version": [*USMAP, "--version"],
            "usmap_info": [*USMAP, "info", str(bag)],
            "pipeline": [sys.executable, "-c", "import usmap_ros.runs.pipeline"],
            "usmap_map": [*USMAP, "map", str(bag), "-o", f"{folder}/map", "-j", "1"],
        }
        return {f"{name}_ms": milliseconds(command) for name, command in programs.items()}


def milliseconds(command: list[str], turns: int = 5) -> float:
    """Processor time of a program, with that of its own."""
    spent = []
    kept = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
    # The first run fills caches.
    for _ in range(1 + turns):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(command, stdout=subprocess.DEVNULL, check=True, env=kept)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        spent.append(1e3 * (after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime))
    return min(spent[1:])


if __name__ == "__main__":
    print(json.dumps(run(), indent=2))
