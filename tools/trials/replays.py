"""A recording replayed through the nodes at several rates: each is to give the same map."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import rclpy

from usmap_ros.grids import OccupancyMap
from usmap_ros.io.map_files import load_map
from usmap_ros.nodes.plumbing.ros_types import interface_class
from usmap_ros.nodes.plumbing.run import prepare_environment
from usmap_ros.nodes.plumbing.status import report_of

SCENARIO = Path(__file__).parents[2] / "config/scenarios/poles.yaml"
ROBOTS = ("robot1", "robot2", "robot3")
PINGS = 300
#: For nodes to find each other, and for the last cones; a busy machine is far from it.
START_S, QUIET_S = 300.0, 30.0
LOST = ("late", "dropped", "malformed", "refused", "failed")

_PROGRAM = [sys.executable, "-m", "usmap_ros"]


def try_replays(folder: Path, rates: list[float]) -> tuple[dict[str, str], list[str]]:
    """Replay at some rates, with every node at its defaults; figures, and what differed.

    Parameters
    ----------
    folder : path
        For the recording and the maps.
    rates : list of float
        Relative to real time.
    """
    prepare_environment()
    subprocess.run([*_PROGRAM, "simulate", str(SCENARIO), "-o", str(folder / "bag")], check=True)
    subprocess.run([*_PROGRAM, "map", str(folder / "bag"), "-o", str(folder / "map")], check=True)
    offline, _ = load_map(folder / "map")
    figures, troubles = {"rate": "seconds, pings fused, late, lost, cells that differ"}, list[str]()
    for rate in rates:
        live = folder / f"live_{rate:g}"
        began_s = time.monotonic()
        facts = _replay(folder / "bag", live, rate)
        took_s = time.monotonic() - began_s
        lost = sum(int(facts.get(what, "0")) for what in LOST[1:])
        differ = _different_cells(load_map(live)[0], offline)
        figures[f"{rate:g}"] = (
            f"{took_s:.0f}, {facts.get('fused')} of {PINGS}, {facts.get('late')}, {lost}, {differ}"
        )
        if differ or facts.get("fused") != str(PINGS) or any(facts.get(w) != "0" for w in LOST):
            troubles.append(f"rate {rate:g}: {figures[f'{rate:g}']}")
    return figures, troubles


def _replay(bag: Path, folder: Path, rate: float) -> dict[str, str]:
    """Map a bag live; what fusion said of it at last."""
    nodes: list[subprocess.Popen[bytes]] = []
    try:
        nodes.append(_node("map_fusion", "", checkpoint_path=folder))
        for robot in ROBOTS:
            nodes.append(_node("cone_reconstructor", robot))
        nodes.append(_node("bag_replay", "", bag=bag, rate=rate, wait_s=START_S))
        return _until_fused()
    finally:
        for process in nodes:
            process.send_signal(signal.SIGINT)
        for process in nodes:
            process.wait()


def _node(name: str, namespace: str, **parameters: Any) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", f"usmap_ros.nodes.{name}", "--ros-args", "-r"]
    command += [f"__ns:=/{namespace}", "-p", "use_sim_time:=true"]
    for key, value in parameters.items():
        command += ["-p", f"{key}:={value}"]
    return subprocess.Popen(command)


def _until_fused() -> dict[str, str]:
    """Listen to fusion until it has all pings, or no more come."""
    facts: dict[str, str] = {}

    def hear(message: Any) -> None:
        for status in message.status:
            if status.name == "/map_fusion":
                facts.update(report_of(status).facts)

    rclpy.init()
    node = rclpy.create_node("trial")
    try:
        diagnostics = interface_class("diagnostic_msgs/msg/DiagnosticArray")
        node.create_subscription(diagnostics, "/diagnostics", hear, 100)
        before, moved_s = None, time.monotonic() + START_S
        while facts.get("fused") != str(PINGS) and time.monotonic() - moved_s < QUIET_S:
            rclpy.spin_once(node, timeout_sec=0.1)
            if facts.get("fused", "0") not in ("0", before):
                before, moved_s = facts["fused"], time.monotonic()
        return facts
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def _different_cells(one: OccupancyMap, other: OccupancyMap) -> int:
    """Cells that two maps have not in common, or whose log-odds are not the same."""
    if one.geometry != other.geometry:
        return max(one.log_odds.size, other.log_odds.size)
    same = (one.observed == other.observed) & (one.log_odds == other.log_odds)
    return int(np.count_nonzero(~same))
