"""A fleet over several hosts: robots and a fusion that a discovery server brings together.

The hosts are network namespaces on a bridge, without a route for multicast, by which nodes would
find each other otherwise.  On the first one are the discovery server and map_fusion, on each
other one a robot: echo_driver and cone_reconstructor.  Needs the right to make namespaces.

Rates are those of some seconds.  For what was lost, the drivers are ended and the nodes waited for
until they have done all that they had: cones that were published from the first on, less those
that a reconstructor published while nobody listened and says so, and less those that were fused.

    python benchmarks/hosts.py --robots 3 --seconds 10
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
SCENARIO = ROOT / "config/scenarios/poles.yaml"
SERVER = ROOT / "config/dds/server.xml"
PORT = 11811
DEADLINE_S = 120.0
#: What becomes of a cone that reaches map_fusion; late ones are fused, too.
FUSION = ("fused", "dropped", "repeated", "refused", "malformed")
#: Diagnostics come every second: without news for so long, there is nothing left to do.
SETTLED_S = 6.0


def ip(*arguments: str) -> str:
    """Run iproute2."""
    command = ["ip", *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True, timeout=10).stdout


class Hosts:
    """Network namespaces, each linked to a bridge in the first one.

    Parameters
    ----------
    count : int
        How many.
    """

    def __init__(self, count: int) -> None:
        number = os.getpid() % 100_000
        self.names = [f"usmap_{number}_{place}" for place in range(count)]
        try:
            self._make(number)
        except BaseException:
            self.remove()
            raise

    def _make(self, number: int) -> None:
        first = self.names[0]
        for name in self.names:
            ip("netns", "add", name)
            ip("-n", name, "link", "set", "lo", "up")
        ip("-n", first, "link", "add", "bridge", "type", "bridge")
        ip("-n", first, "address", "add", f"{self.address(0)}/24", "dev", "bridge")
        ip("-n", first, "link", "set", "bridge", "up")
        for place, name in enumerate(self.names[1:], start=1):
            near, far = f"un{number}_{place}", f"uf{number}_{place}"
            ip("link", "add", near, "type", "veth", "peer", "name", far)
            ip("link", "set", near, "netns", first)
            ip("link", "set", far, "netns", name)
            ip("-n", name, "link", "set", far, "name", "link")
            ip("-n", first, "link", "set", near, "master", "bridge", "up")
            ip("-n", name, "address", "add", f"{self.address(place)}/24", "dev", "link")
            ip("-n", name, "link", "set", "dev", "link", "up")

    def address(self, place: int) -> str:
        """Address of a host."""
        return f"10.78.0.{place + 1}"

    def on(self, place: int) -> list[str]:
        """Beginning of a command that runs on a host."""
        return ["ip", "netns", "exec", self.names[place]]

    def sent_bytes(self, place: int) -> int:
        """What a host other than the first has sent so far."""
        told = json.loads(ip("-n", self.names[place], "-s", "-j", "link", "show", "dev", "link"))
        return int(told[0]["stats64"]["tx"]["bytes"])

    def remove(self) -> None:
        """Take them away."""
        for name in self.names:
            subprocess.run(["ip", "netns", "delete", name], check=False, capture_output=True)


@contextmanager
def running(command: list[str], environment: dict[str, str]) -> Iterator[subprocess.Popen[str]]:
    """Run a program, and end it."""
    process = subprocess.Popen(
        command, env=os.environ | environment, stdout=subprocess.PIPE, text=True
    )
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.wait(20.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def node(name: str, namespace: str = "", **parameters: Any) -> list[str]:
    """Command of a node."""
    command = [sys.executable, "-m", f"usmap_ros.nodes.{name}", "--ros-args"]
    command += ["-r", f"__ns:=/{namespace}", "--log-level", "error"]
    for key, value in parameters.items():
        command += ["-p", f"{key}:={value}"]
    return command


def measure(robots: int, seconds: float) -> dict[str, Any]:
    """Run a fleet for some seconds."""
    hosts = Hosts(1 + robots)
    environment = {
        "ROS_DISCOVERY_SERVER": f"{hosts.address(0)}:{PORT}",
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
    }
    names = [f"robot{number}" for number in range(1, robots + 1)]
    try:
        with ExitStack() as stack:

            def start(place: int, command: list[str]) -> subprocess.Popen[str]:
                return stack.enter_context(running([*hosts.on(place), *command], environment))

            start(0, ["fast-discovery-server", "-i", "0", "-x", str(SERVER)])
            start(0, node("map_fusion"))
            drivers = []
            for place, name in enumerate(names, start=1):
                robot = "robot1" if robots > 3 else name
                driver = node("echo_driver", name, scenario=SCENARIO, robot=robot)
                drivers.append(start(place, driver))
                start(place, node("cone_reconstructor", name))
            watch = start(
                0, [sys.executable, __file__, "--watch", *names, "--seconds", str(seconds)]
            )
            assert watch.stdout is not None
            begun = watch.stdout.readline()
            if not begun:
                raise RuntimeError("the hosts do not find each other")
            before = [hosts.sent_bytes(place) for place in range(1, robots + 1)]
            told = json.loads(watch.stdout.readline())
            after = [hosts.sent_bytes(place) for place in range(1, robots + 1)]
            for driver in drivers:
                driver.terminate()
            total = json.loads(watch.stdout.readline())
    finally:
        hosts.remove()
    rates = [(now - then) / told["seconds"] for then, now in zip(before, after, strict=True)]
    pings_s = told["published"] / told["seconds"] / robots
    return {
        "hosts": 1 + robots,
        "pings_per_second_and_robot": round(pings_s, 1),
        **{f"cones_{name}": number for name, number in total.items()},
        "cones_lost": total["published"] - total["unheard"] - sum(total[n] for n in FUSION),
        "kilobytes_per_second_and_robot": round(sum(rates) / robots / 1e3, 1),
        "kilobytes_a_cone": round(sum(rates) / robots / 1e3 / max(pings_s, 1e-9), 2),
    }


def watch(robots: list[str], seconds: float) -> None:
    """Count what the nodes say that they published and fused, from when all of them do."""
    import rclpy

    from usmap_ros.live.interfaces import DIAGNOSTICS
    from usmap_ros.nodes.plumbing.endpoints import qos_profile
    from usmap_ros.nodes.plumbing.ros_types import interface_class
    from usmap_ros.nodes.plumbing.run import prepare_environment

    prepare_environment()
    rclpy.init()
    listener = rclpy.create_node("watch")
    totals: dict[str, dict[str, str]] = {}

    def listen(message: Any) -> None:
        for status in message.status:
            totals[status.name] = {value.key: value.value for value in status.values}

    listener.create_subscription(
        interface_class(DIAGNOSTICS.message_type), DIAGNOSTICS.name, listen,
        qos_profile(DIAGNOSTICS.qos),
    )  # fmt: skip

    def counts() -> dict[str, int]:
        of_robots = [totals.get(f"/{name}/cone_reconstructor", {}) for name in robots]
        published = [int(one.get("published", 0)) for one in of_robots]
        unheard = sum(int(one.get("unheard", 0)) for one in of_robots)
        fusion = {key: int(totals.get("/map_fusion", {}).get(key, 0)) for key in FUSION}
        return {
            "least": min(published), "published": sum(published), "unheard": unheard, **fusion
        }  # fmt: skip

    def listen_for(seconds: float) -> None:
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            rclpy.spin_once(listener, timeout_sec=0.1)

    end_s = time.monotonic() + DEADLINE_S
    # All of them publish, and are heard.
    while counts()["least"] < 20 or counts()["fused"] < 20 * len(robots):
        if time.monotonic() > end_s:
            print(totals, file=sys.stderr)
            return
        rclpy.spin_once(listener, timeout_sec=0.1)
    print("begun", flush=True)
    before, began_s = counts(), time.monotonic()
    listen_for(seconds)
    published = counts()["published"] - before["published"]
    told = {"published": published, "seconds": time.monotonic() - began_s}
    print(json.dumps(told), flush=True)
    known: dict[str, int] = {}
    while known != counts():
        known = counts()
        listen_for(SETTLED_S)
    del known["least"]
    print(json.dumps(known), flush=True)
    rclpy.try_shutdown()


def main() -> None:
    """Measure a fleet, or watch one."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", type=int, default=3, help="each on a host of its own")
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--watch", nargs="+", metavar="ROBOT", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.watch:
        watch(arguments.watch, arguments.seconds)
    else:
        print(json.dumps(measure(arguments.robots, arguments.seconds)))


if __name__ == "__main__":
    main()
