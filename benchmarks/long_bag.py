"""How much memory ``usmap map`` takes for a long recording.

The recording is made first: pings of three robots that go round among poles again and again, as
I/Q of 6 kB each or padded to the size of raw samples.  It is removed at the end.  What takes more
memory the longer a recording is are its index, the robots' paths and the stamps of pings;
``--without-mapping`` measures these alone, in a fraction of the time.

    nice -n 19 python benchmarks/long_bag.py --gigabytes 0.3 --ping-kilobytes 30
    nice -n 19 python benchmarks/long_bag.py --gigabytes 2 --ping-kilobytes 6 --without-mapping
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np

from usmap_ros.io.bag_reader import BagReader
from usmap_ros.io.bag_writer import new_bag
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.robot_paths import RobotPaths
from usmap_ros.processes.memory import peak_memory_mb
from usmap_ros.runs.offline import map_bag
from usmap_ros.runs.parallel import Reconstructors
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.runs.recorded import learn_reception
from usmap_ros.simulation import Scenario, simulate

SCENARIO = Path(__file__).parents[1] / "config/scenarios/poles.yaml"
#: Runs the command line.
USMAP = [sys.executable, "-m", "usmap_ros"]


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


def measure(gigabytes: float, ping_kilobytes: float, *, with_mapping: bool) -> dict[str, Any]:
    """Map a recording of a size, in one process."""
    with tempfile.TemporaryDirectory() as folder:
        bag, output = Path(folder) / "bag", Path(folder) / "map"
        count = write(bag, gigabytes, ping_kilobytes)
        size = sum(file.stat().st_size for file in bag.iterdir())
        if with_mapping:
            command = [*USMAP, "map", str(bag), "-o", str(output), "-j", "1", "--json"]
            done = subprocess.run(command, stdout=subprocess.PIPE, check=True)
            peak_mb = json.loads(done.stdout)["peak_memory_mb"]
        else:
            command = [sys.executable, __file__, "--read", str(bag)]
            peak_mb = float(subprocess.run(command, stdout=subprocess.PIPE, check=True).stdout)
    return {
        "gigabytes": round(size / 1e9, 3),
        "pings": count,
        "peak_memory_mb": round(peak_mb, 1),
    }


def read(bag: Path) -> None:
    """All that `measure` has a process do but reconstruction and fusion; prints its memory."""
    pipeline = Pipeline()
    cone = pipeline.reconstruct(next(simulate(Scenario.load(SCENARIO)))[1])

    class Told(Reconstructors):
        def cones(self, bag: BagReader) -> Iterator[tuple[str, EchoCone]]:
            for topic, trace in bag.traces():
                named = {"child_frame_id": trace.child_frame_id, "pose": trace.pose}
                yield topic, replace(cone, stamp_ns=trace.stamp_ns, **named)

    pipeline.fuse = lambda cone: None  # type: ignore[method-assign]
    with BagReader([bag]) as reader:
        workers = Told(pipeline)
        learn_reception(reader, pipeline, workers)
        map_bag(reader, pipeline, RobotPaths(), workers=workers)
    print(peak_memory_mb())


def main() -> None:
    """Measure one recording."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--gigabytes", type=float, default=10.0)
    parser.add_argument("--ping-kilobytes", type=float, default=1000.0)
    parser.add_argument("--without-mapping", action="store_true")
    parser.add_argument("--read", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.read:
        read(arguments.read)
        return
    size = arguments.gigabytes, arguments.ping_kilobytes
    print(json.dumps(measure(*size, with_mapping=not arguments.without_mapping)))


if __name__ == "__main__":
    main()
