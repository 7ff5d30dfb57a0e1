"""How much memory ``usmap map`` takes for a long recording.

The recording is made first: pings of three robots that go round among poles again and again, each
with as many samples behind its greatest range as its size asks for.  It is removed at the end.

    nice -n 19 python benchmarks/long_bag.py --gigabytes 10 --ping-kilobytes 1000
    nice -n 19 python benchmarks/long_bag.py --gigabytes 0.12 --ping-kilobytes 6
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from dataclasses import replace
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np

from usmap_ros.io.bag_writer import new_bag
from usmap_ros.simulation import Scenario, simulate

SCENARIO = Path(__file__).parents[1] / "config/scenarios/poles.yaml"
#: Runs the command line.
USMAP = [sys.executable, "-c", "from usmap_ros.cli import main; main()"]


def write(bag: Path, gigabytes: float, ping_kilobytes: float) -> int:
    """Write a recording of a size; the number of its pings."""
    pings = list(simulate(Scenario.load(SCENARIO)))
    size = max(int(ping_kilobytes * 1e3 / 4) // 2 * 2, len(pings[0][1].samples))
    count = max(1, round(gigabytes * 1e9 / (4 * size)))
    with new_bag(bag) as writer:
        for number, (topic, trace) in zip(range(count), cycle(pings), strict=False):
            samples = np.zeros(size, np.float32)
            samples[: len(trace.samples)] = trace.samples
            stamp_ns = trace.stamp_ns + number // len(pings) * 3_600 * 10**9
            writer.write_trace(topic, replace(trace, samples=samples, stamp_ns=stamp_ns))
    return count


def measure(gigabytes: float, ping_kilobytes: float) -> dict[str, Any]:
    """Map a recording of a size, in one process."""
    with tempfile.TemporaryDirectory() as folder:
        bag, output = Path(folder) / "bag", Path(folder) / "map"
        count = write(bag, gigabytes, ping_kilobytes)
        size = sum(file.stat().st_size for file in bag.iterdir())
        subprocess.run(
            [*USMAP, "map", str(bag), "-o", str(output), "-j", "1"],
            stdout=subprocess.DEVNULL, check=True,
        )  # fmt: skip
        summary = json.loads((output / "summary.json").read_text())
    return {
        "gigabytes": round(size / 1e9, 3),
        "pings": count,
        "peak_memory_mb": round(summary["peak_memory_mb"], 1),
        "pings_per_second": round(summary["pings_per_second"], 1),
    }


def main() -> None:
    """Measure one recording."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--gigabytes", type=float, default=10.0)
    parser.add_argument("--ping-kilobytes", type=float, default=1000.0)
    arguments = parser.parse_args()
    print(json.dumps(measure(arguments.gigabytes, arguments.ping_kilobytes)))


if __name__ == "__main__":
    main()
