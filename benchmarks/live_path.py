"""How many robots the live nodes keep up with, and how long an echo takes into the published map.

Real processes: one map_fusion, and one cone_reconstructor a robot, or one for several (`--shared`).
This process stands for the robots' drivers: it publishes traces that were simulated and serialized
before, stamped with the time at which they are sent, and listens to the map; what that costs is
given as "load cores", and as "others cores" what all other programs took of the machine: where
they take much, latencies are theirs.  What nodes say of their own part of the latency is given
beside it: fusion's has the wait for the other robots' cones in it, but not for the next map.
"Helper cores" are what nodes' processes beside them take of what others leave.
"Dropped" is what fusion says that it dropped from its queue, "dropped before" what reconstructors
say.

    python benchmarks/live_path.py --robots 1 2 4 8
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import os
import random
import signal
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from usmap_ros.io.conversions import trace_to_cdr
from usmap_ros.live.interfaces import DIAGNOSTICS, ECHO, MAP
from usmap_ros.live.supervisor import PARENT_VARIABLE
from usmap_ros.nodes.plumbing.endpoints import advertise, qos_profile
from usmap_ros.nodes.plumbing.ros_types import interface_class
from usmap_ros.nodes.plumbing.run import prepare_environment
from usmap_ros.simulation import Scenario, simulate

ROOT = Path(__file__).parents[1]
#: How the nodes reach each other: by loopback alone.
PROFILE = ROOT / "config/dds/one_machine.xml"
#: What every serialized message begins with: its byte order.
_HEADER_BYTES = 4
#: Name of a figure that is a list.
BY_SECOND = "latency_p95_by_second_ms"
#: Name of all processes beside nodes, which work on what nobody waits for when others need cores.
HELPERS = "helpers"
#: Nothing more is fused if nothing was for so long: the last pings wait 5 s for earlier ones.
SETTLES_S = 6.0
ENDINGS = (signal.SIGINT, signal.SIGTERM)
_TICKS_PER_SECOND = os.sysconf("SC_CLK_TCK")


@dataclass
class Observed:
    """What the benchmark saw of the nodes."""

    map_arrivals: list[tuple[float, float]] = field(default_factory=list)
    totals: dict[str, dict[str, str]] = field(default_factory=dict)

    def on_map(self, message: Any) -> None:
        """Note when a map came, and the stamp of the newest echo in it."""
        stamp_s = message.header.stamp.sec + message.header.stamp.nanosec / 1e9
        self.map_arrivals.append((time.time(), stamp_s))

    def on_diagnostics(self, message: Any) -> None:
        """Note a node's latest figures."""
        for status in message.status:
            self.totals[status.name] = {value.key: value.value for value in status.values}

    def total(self, node: str, what: str) -> int:
        """Latest figure of a node."""
        return int(self.totals.get(node, {}).get(what, "0"))

    def slowest_ms(self, nodes: list[str]) -> float:
        """Greatest of the latencies that nodes report of 95 % of their latest messages."""
        name = "latency p95 (ms)"
        return max(float(self.totals.get(node, {}).get(name, "nan")) for node in nodes)


class Fleet:
    """The nodes under test, as processes."""

    def __init__(self) -> None:
        self.processes: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, robots: list[str], publish_rate_hz: float, is_shared: bool) -> None:
        """Start one reconstructor for all robots, or one for each, and a fusion."""
        if is_shared:
            self._start("cone_reconstructor", "", "-p", f"transducers:={json.dumps(robots)}")
        else:
            for robot in robots:
                self._start("cone_reconstructor", robot)
        self._start("map_fusion", "", "-p", f"publish_rate_hz:={publish_rate_hz}")

    def _start(self, node: str, namespace: str, *arguments: str) -> None:
        command = [sys.executable, "-m", f"usmap_ros.nodes.{node}", "--ros-args"]
        command += ["-r", f"__ns:=/{namespace}", "--log-level", "error", *arguments]
        # None of them is to outlive this process, however that ends.
        environment = os.environ | {PARENT_VARIABLE: str(os.getpid())}
        name = f"/{namespace}/{node}" if namespace else f"/{node}"
        self.processes[name] = subprocess.Popen(command, env=environment)

    def cpu_seconds(self) -> dict[str, float]:
        """Processor time that each node has used, and helpers of all together."""
        used = {name: cpu_seconds(process.pid) for name, process in self.processes.items()}
        return used | {HELPERS: sum(map(cpu_seconds, self._helpers()))}

    def _helpers(self) -> list[int]:
        return [pid for process in self.processes.values() for pid in children(process.pid)]

    def memory_mb(self) -> dict[str, int]:
        """Memory of all nodes, and of all helpers, what they share divided among them."""
        nodes = [process.pid for process in self.processes.values()]
        return {
            "nodes_mb": round(sum(map(memory_mb, nodes))),
            "helpers_mb": round(sum(map(memory_mb, self._helpers()))),
        }

    def end(self) -> None:
        """End all processes, those that hang too: Fast DDS can, when others leave."""
        for process in self.processes.values():
            # Not SIGINT, of which a Python that is just being started complains.
            process.terminate()
        for process in self.processes.values():
            try:
                process.wait(15.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def cpu_seconds(pid: int) -> float:
    """Processor time that a process has used."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS_PER_SECOND


def memory_mb(pid: int) -> float:
    """Memory that a process takes, what it shares with others divided among them."""
    lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    return next(int(line.split()[1]) * 1024 / 1e6 for line in lines if line.startswith("Pss:"))


def children(pid: int) -> list[int]:
    """Processes that a process has started."""
    tasks = Path(f"/proc/{pid}/task").iterdir()
    return [int(child) for task in tasks for child in (task / "children").read_text().split()]


def busy_seconds() -> float:
    """Processor time that all programs of this machine have used."""
    ticks = [int(field) for field in Path("/proc/stat").read_text().split("\n")[0].split()[1:9]]
    idle, waiting = ticks[3:5]
    return (sum(ticks) - idle - waiting) / _TICKS_PER_SECOND


def traces(robots: int, count: int) -> list[list[bytearray]]:
    """Serialized messages of simulated traces, for each robot."""
    scenario = Scenario.load(ROOT / "config/scenarios/poles.yaml")
    found = [trace for _, trace in itertools.islice(simulate(scenario), count)]
    return [
        [bytearray(trace_to_cdr(replace(t, child_frame_id=f"robot{number}/sonar"))) for t in found]
        for number in range(robots)
    ]


def stamped(trace: bytearray, now_ns: int) -> bytes:
    """Set the stamp of a serialized trace, which begins with it."""
    struct.pack_into("<iI", trace, _HEADER_BYTES, *divmod(now_ns, 10**9))
    return bytes(trace)


def measure(
    robots: int, rate_hz: float, seconds: float, publish_rate_hz: float, is_shared: bool = False
) -> dict[str, Any]:
    """Run a fleet for some seconds."""
    # A domain of its own: the nodes of the measurement before may still be leaving theirs.
    os.environ["ROS_DOMAIN_ID"] = str(random.randint(1, 100))
    os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"] = str(PROFILE)
    names = [f"robot{number}" for number in range(robots)]
    # Who ends this process ends a measurement, and not ROS under the threads that use it.
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    fleet, node = Fleet(), rclpy.create_node("benchmark")
    # Maps are listened to in a thread of their own, so that a ping costs no more than publishing.
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    listener = threading.Thread(target=executor.spin)
    listener.start()
    try:
        fleet.start(names, publish_rate_hz, is_shared)
        return _measure(node, fleet, names, rate_hz, seconds)
    finally:
        fleet.end()
        executor.shutdown()
        listener.join()
        node.destroy_node()
        rclpy.shutdown()


def _measure(
    node: Any, fleet: Fleet, names: list[str], rate_hz: float, seconds: float
) -> dict[str, Any]:
    observed = Observed()
    for topic, callback in ((MAP, observed.on_map), (DIAGNOSTICS, observed.on_diagnostics)):
        node.create_subscription(
            interface_class(topic.message_type), topic.name, callback, qos_profile(topic.qos)
        )
    publishers = [advertise(node, ECHO, f"/{name}/echo") for name in names]
    _wait_until(lambda: all(p.get_subscription_count() for p in publishers))
    _wait_until(lambda: all(node.count_subscribers(f"/{n}/cone") for n in names))
    content = [itertools.cycle(found) for found in traces(len(names), 60)]
    _send(publishers, content, rate_hz, 2.0)
    # What was sent first must not be counted among what comes later.
    before = _settled(observed)
    cpu, own_cpu, all_cpu = fleet.cpu_seconds(), time.process_time(), busy_seconds()
    sent_s = _send(publishers, content, rate_hz, seconds)
    reconstructors = [name for name in fleet.processes if name != "/map_fusion"]
    used = {name: spent - cpu[name] for name, spent in fleet.cpu_seconds().items()}
    within_ms = observed.slowest_ms(reconstructors), observed.slowest_ms(["/map_fusion"])
    load_cores = (time.process_time() - own_cpu) / seconds
    all_cores = (busy_seconds() - all_cpu) / seconds
    fused = _settled(observed) - before
    latencies_s = _latencies(sent_s, observed.map_arrivals)
    fusion_cores = used.pop("/map_fusion") / seconds
    helper_cores = used.pop(HELPERS) / seconds
    reconstruction_cores = sum(used.values()) / seconds
    others_cores = all_cores - fusion_cores - helper_cores - reconstruction_cores - load_cores
    return {
        "robots": len(names),
        "sent": len(sent_s),
        "lost": len(sent_s) - fused,
        "dropped": observed.total("/map_fusion", "dropped"),
        "dropped_before": sum(observed.total(name, "dropped") for name in used),
        "late": observed.total("/map_fusion", "late"),
        "thinned": observed.total("/map_fusion", "thinned"),
        "latency_p50_ms": round(1000 * float(np.percentile(latencies_s, 50)), 1),
        "latency_p95_ms": round(1000 * float(np.percentile(latencies_s, 95)), 1),
        BY_SECOND: _p95_by_second_ms(sent_s, latencies_s),
        "reconstruction_p95_ms": within_ms[0],
        "fusion_p95_ms": within_ms[1],
        "fusion_cores": round(fusion_cores, 2),
        "helper_cores": round(helper_cores, 2),
        "reconstruction_cores": round(reconstruction_cores, 2),
        "load_cores": round(load_cores, 2),
        "others_cores": round(others_cores, 2),
        **fleet.memory_mb(),
    }


def _send(
    publishers: list[Any],
    content: list[Iterator[bytearray]],
    rate_hz: float,
    seconds: float,
) -> list[float]:
    """Publish at a rate for each robot, spread over time; when each message was stamped."""
    start_s, count = time.monotonic(), round(rate_hz * seconds)
    offsets_s = [number / len(publishers) / rate_hz for number in range(len(publishers))]
    due = sorted(
        (start_s + ping / rate_hz + offset_s, number)
        for ping in range(count)
        for number, offset_s in enumerate(offsets_s)
    )
    sent_s = []
    for due_s, number in due:
        while (left_s := due_s - time.monotonic()) > 0.0:
            time.sleep(left_s)
        now = time.time_ns()
        publishers[number].publish(stamped(next(content[number]), now))
        sent_s.append(now / 1e9)
    return sent_s


def _latencies(sent_s: list[float], arrivals: list[tuple[float, float]]) -> list[float]:
    """From each echo until the first map that holds it; not a number if none does."""
    stamps_s = np.maximum.accumulate([stamp_s for _, stamp_s in arrivals])
    first = np.searchsorted(stamps_s, np.array(sent_s) - 1e-6)
    pairs = zip(sent_s, first, strict=True)
    return [arrivals[i][0] - s for s, i in pairs if i < len(arrivals)] or [math.nan]


def _p95_by_second_ms(sent_s: list[float], latencies_s: list[float]) -> list[int]:
    """The same of what was sent in each second: places are new in the first two of them."""
    seconds = [int(s - sent_s[0]) for s in sent_s[: len(latencies_s)]]
    of_each: dict[int, list[float]] = {}
    for second, latency_s in zip(seconds, latencies_s, strict=True):
        of_each.setdefault(second, []).append(1000 * latency_s)
    return [round(np.nan_to_num(np.percentile(some, 95))) for some in of_each.values()]


def _settled(observed: Observed) -> int:
    """How many cones are fused once no more are: what waits in a queue is not lost."""
    fused = -1
    while fused != (now := observed.total("/map_fusion", "fused")):
        fused = now
        time.sleep(SETTLES_S)
    return fused


def _wait_until(condition: Any, timeout_s: float = 60.0) -> None:
    end_s = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > end_s:
            raise TimeoutError("the nodes do not find each other")
        time.sleep(0.1)


def run() -> dict[str, Any]:
    """Figures of two fleets, for benchmarks/run.py."""
    prepare_environment()
    return {
        f"{robots}_robots_{name}": value
        for robots in (2, 4)
        for name, value in measure(robots, 15.0, 10.0, 10.0).items()
        if name not in ("robots", BY_SECOND)
    }


def main() -> None:
    """Measure fleets of growing size; one JSON object a line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", type=int, nargs="+", default=[1, 2, 4, 8])
    parser.add_argument("--rate", type=float, default=15.0, help="pings a robot, Hz")
    parser.add_argument("--seconds", type=float, default=10.0, help="duration of each measurement")
    parser.add_argument("--publish-rate", type=float, default=10.0, help="of the map, Hz")
    parser.add_argument(
        "--shared", action="store_true", help="one cone_reconstructor for all robots"
    )
    arguments = parser.parse_args()
    prepare_environment()
    for ending in ENDINGS:
        signal.signal(ending, _end)
    for robots in arguments.robots:
        result = measure(
            robots,
            arguments.rate,
            arguments.seconds,
            arguments.publish_rate,
            arguments.shared,
        )
        print(json.dumps(result), flush=True)


def _end(number: int, frame: FrameType | None) -> None:
    """End as a shell expects it of a program that a signal ends, all nodes before it."""
    for ending in ENDINGS:
        # Asking again changes nothing.
        signal.signal(ending, signal.SIG_IGN)
    sys.exit(128 + number)


if __name__ == "__main__":
    main()
