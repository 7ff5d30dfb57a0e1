"""A fusion and a recorder that are killed while cones come in, over and over."""

from __future__ import annotations

import logging
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import rclpy
from fleets import PROFILE

from usmap_ros.errors import UsmapError
from usmap_ros.io.bag_reader import BagReader
from usmap_ros.io.conversions import cone_to_cdr
from usmap_ros.io.map_files import GRID_FILE, load_map
from usmap_ros.live.supervisor import PARENT_VARIABLE
from usmap_ros.nodes.plumbing.ros_types import interface_class
from usmap_ros.nodes.plumbing.run import prepare_environment
from usmap_ros.pings.cone import EchoCone
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.simulation import Scenario, simulate

ROOT = Path(__file__).parents[2]
#: Time from one checkpoint to the next.
INTERVAL_S = 1.0
#: More than the recorder writes at once, which is what it may lose.
A_CHUNK_BYTES = 34 * 2**10
#: Cones a second.
RATE_HZ = 20.0
START_S = 300.0


class _Robot:
    """Publishes cones, each with the present for its stamp, and sees how far the map is."""

    def __init__(self) -> None:
        pipeline = Pipeline()
        pings = islice(simulate(Scenario.load(ROOT / "config/scenarios/poles.yaml")), 60)
        self._cones: list[EchoCone] = [pipeline.reconstruct(trace) for _, trace in pings]
        self._node = rclpy.create_node("trial")
        cone, grid = map(interface_class, ("usmap_msgs/msg/EchoCone", "nav_msgs/msg/OccupancyGrid"))
        self._publisher = self._node.create_publisher(cone, "/robot1/cone", 50)
        self._node.create_subscription(grid, "/map", self._hear, 1)
        self._next_s = time.monotonic()
        self._number = 0
        self.mapped_ns = 0

    def _hear(self, message: Any) -> None:
        self.mapped_ns = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec

    def until(self, condition: Callable[[], bool], longest_s: float) -> bool:
        """Publish until something is true, or it is too late; whether it is."""
        end_s = time.monotonic() + longest_s
        while time.monotonic() < end_s:
            rclpy.spin_once(self._node, timeout_sec=max(0.0, self._next_s - time.monotonic()))
            if time.monotonic() >= self._next_s:
                self._next_s = time.monotonic() + 1.0 / RATE_HZ
                cone = self._cones[self._number % len(self._cones)]
                self._number += 1
                now = replace(cone, stamp_ns=time.time_ns(), child_frame_id="robot1/sonar")
                self._publisher.publish(cone_to_cdr(now))
            if condition():
                return True
        return False

    def close(self) -> None:
        """End it."""
        self._node.destroy_node()


def try_kills(
    folder: Path, count: int, seed: int, slack_s: float
) -> tuple[dict[str, str], list[str]]:
    """Kill the two nodes, and see what they leave; figures, and what went wrong.

    Parameters
    ----------
    folder : path
        For their files.  Fusion goes on from what it kept, every time.
    count : int
        How often.
    seed : int
        Of the times at which they are killed.
    slack_s : float
        What a busy machine may add to the interval of checkpoints.
    """
    prepare_environment()
    # That recordings are cut off is no news here.
    logging.getLogger("usmap_ros").setLevel(logging.ERROR)
    os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"] = str(PROFILE)
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    rclpy.init(args=[])
    robot, generator = _Robot(), random.Random(seed)
    losses_s: list[float] = []
    troubles: list[str] = []
    for number in range(count):
        lost_s, found = _kill_once(robot, folder, number, generator.uniform(0.0, 2.0))
        losses_s.append(lost_s)
        if lost_s > INTERVAL_S + slack_s:
            found.append(f"{lost_s:.2f} s of the map are lost")
        troubles += [f"kill {number}: {trouble}" for trouble in found]
        if (number + 1) % 10 == 0:
            print(f"{number + 1} of {count}, {len(troubles)} troubles", file=sys.stderr, flush=True)
    robot.close()
    rclpy.shutdown()
    losses_s.sort()
    return {
        "kills": f"{count}, a checkpoint every {INTERVAL_S:g} s",
        "map lost": f"median {losses_s[count // 2]:.2f} s, most {losses_s[-1]:.2f} s",
        "troubles": str(len(troubles)),
    }, troubles


def _kill_once(robot: _Robot, folder: Path, number: int, after_s: float) -> tuple[float, list[str]]:
    """Start both nodes, kill them at some time; how much of the map is lost (s), and troubles."""
    kept, bag = folder / "map", folder / f"bag{number}"
    options = {"checkpoint_path": kept, "checkpoint_period_s": INTERVAL_S, "publish_rate_hz": 20.0}
    nodes = [
        _start("map_fusion", folder, options),
        _start("bag_recorder", folder, {"bag": bag, "topic_pattern": "/*/cone"}),
    ]
    before_ns = _kept_ns(kept)

    def are_at_work() -> bool:
        """Whether the map has been kept again, and the bag has a chunk."""
        return _kept_ns(kept) > before_ns and _size(bag) > A_CHUNK_BYTES

    def is_one_gone() -> bool:
        return any(node.poll() is not None for node in nodes)

    robot.until(lambda: is_one_gone() or are_at_work(), START_S)
    has_begun = are_at_work()
    robot.until(lambda: False, after_s)
    for node in nodes:
        node.send_signal(signal.SIGKILL)
    for node in nodes:
        node.wait()
    troubles = [] if has_begun else ["the nodes did not begin to work"]
    lost_s = 0.0
    try:
        lost_s = max(0.0, (robot.mapped_ns - load_map(kept)[0].stamp_ns) / 1e9)
        with BagReader([bag]) as reader:
            if not sum(1 for _ in reader.cones()):
                troubles.append("the recording is empty")
    except UsmapError as error:
        troubles.append(f"unreadable: {error}")
    return lost_s, troubles


def _start(node: str, folder: Path, options: dict[str, Any]) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", f"usmap_ros.nodes.{node}", "--ros-args"]
    for name, value in options.items():
        command += ["-p", f"{name}:={value}"]
    with (folder / f"{node}.log").open("ab") as log:
        return subprocess.Popen(
            command,
            stdout=log,
            stderr=subprocess.STDOUT,
            env={**os.environ, PARENT_VARIABLE: str(os.getpid())},
            start_new_session=True,
        )


def _kept_ns(folder: Path) -> int:
    """Stamp of the newest cone in the map on disk; 0 if there is none."""
    return load_map(folder)[0].stamp_ns if (folder / GRID_FILE).exists() else 0


def _size(bag: Path) -> int:
    return sum(file.stat().st_size for file in bag.glob("*.mcap")) if bag.exists() else 0
