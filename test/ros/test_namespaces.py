"""Two hosts: robots on one, fusion on the other, and a link that goes down for a while.

And four hosts, which a discovery server brings together.  All are network namespaces.
"""

import itertools
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from usmap_ros.io.map_files import load_map

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
DEADLINE_S = 300.0
_NUMBERS = itertools.count(os.getpid() % 10_000 * 10)


def ip(*arguments: str) -> None:
    subprocess.run(["ip", *arguments], check=True, capture_output=True, timeout=10)


class TwoHosts:
    """Two network namespaces, and the link between them."""

    def __init__(self) -> None:
        number = next(_NUMBERS)
        self.names = (f"usmap_a{number}", f"usmap_b{number}")
        self._links = (f"ua{number}", f"ub{number}")
        one, other = self._links
        try:
            for name in self.names:
                ip("netns", "add", name)
            ip("link", "add", one, "type", "veth", "peer", "name", other)
            for place, (name, link) in enumerate(zip(self.names, self._links, strict=True)):
                ip("link", "set", link, "netns", name)
                ip("-n", name, "address", "add", f"10.77.0.{place + 1}/24", "dev", link)
                ip("-n", name, "link", "set", link, "up")
                ip("-n", name, "link", "set", "lo", "up")
                # Multicast, by which nodes find each other, needs a route.
                ip("-n", name, "route", "add", "default", "dev", link)
        except BaseException:
            self.remove()
            raise

    def on(self, host: int) -> tuple[str, ...]:
        """Prefix of a command that runs on a host."""
        return ("ip", "netns", "exec", self.names[host])

    def set_link(self, state: str) -> None:
        """Take the link 'down', or 'up'."""
        ip("-n", self.names[0], "link", "set", self._links[0], state)
        if state == "up":
            # A route goes with its link.
            ip("-n", self.names[0], "route", "add", "default", "dev", self._links[0])

    def remove(self) -> None:
        for name in self.names:
            subprocess.run(["ip", "netns", "delete", name], check=False, capture_output=True)


@pytest.fixture
def hosts(monkeypatch: pytest.MonkeyPatch) -> Iterator[TwoHosts]:
    """Give two hosts, or skip where they cannot be made."""
    if sys.platform != "linux" or shutil.which("ip") is None:
        pytest.skip("network namespaces need Linux and iproute2")
    try:
        made = TwoHosts()
    except (OSError, subprocess.SubprocessError) as error:
        detail = getattr(error, "stderr", b"") or b""
        pytest.skip(f"no network namespaces here: {detail.decode().strip() or error}")
    # They are on no other network, and reach each other by more than their loopback.
    monkeypatch.delenv("FASTRTPS_DEFAULT_PROFILES_FILE")
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    yield made
    made.remove()


def stamp_s(folder: Path) -> float:
    """Stamp of the newest cone in the map that fusion keeps; 0 if there is none."""
    path = folder / "map.npz"
    return load_map(path)[0].stamp_ns / 1e9 if path.exists() else 0.0


def wait_for_stamp(folder: Path, at_least_s: float) -> None:
    """Wait until the map holds a cone that is newer than `at_least_s`."""
    end_s = time.monotonic() + DEADLINE_S
    while stamp_s(folder) < at_least_s:
        assert time.monotonic() < end_s, "mapping does not go on"
        time.sleep(0.2)


def settled_stamp_s(folder: Path) -> float:
    """Wait until no cone comes any more; the stamp of the last."""
    end_s = time.monotonic() + DEADLINE_S
    before_s = -1.0
    while (now_s := stamp_s(folder)) != before_s:
        assert time.monotonic() < end_s, "mapping goes on"
        before_s = now_s
        time.sleep(5.0)
    return now_s


def test_mapping_resumes_by_itself_after_the_link_was_down(
    hosts: TwoHosts, processes: Any, tmp_path: Path
) -> None:
    folder = tmp_path / "map"
    fusion = processes.start(
        "map_fusion", prefix=hosts.on(1), checkpoint_path=folder, checkpoint_period_s=0.5
    )
    robots = []
    for robot in ("robot1", "robot2"):
        scenario = ROOT / "config/scenarios/poles.yaml"
        robots += [
            processes.start("echo_driver", robot, hosts.on(0), scenario=scenario, robot=robot),
            processes.start("cone_reconstructor", robot, hosts.on(0)),
        ]
    wait_for_stamp(folder, 1.0)
    hosts.set_link("down")
    # What was on its way arrives; nothing else does.
    last_s = settled_stamp_s(folder)
    hosts.set_link("up")
    wait_for_stamp(folder, last_s + 2.0)
    assert all(process.poll() is None for process in (fusion, *robots))


def test_a_discovery_server_brings_four_hosts_together(hosts: TwoHosts) -> None:
    server = Path(sys.executable).parent / "fast-discovery-server"
    if not server.exists() and shutil.which(server.name) is None:
        pytest.skip("there is no fast-discovery-server")
    path = os.pathsep.join([str(server.parent), os.environ["PATH"]])
    command = [sys.executable, "benchmarks/hosts.py", "--robots", "3", "--seconds", "2"]
    done = subprocess.run(
        command, cwd=ROOT, env=os.environ | {"PATH": path}, capture_output=True, text=True,
        check=False, timeout=DEADLINE_S,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["hosts"] == 4
    assert told["cones_fused"] > 0
    # A cone is about 1 kB, with what its packets and the diagnostics add; its trace is 6 kB.
    assert 0.5 < told["kilobytes_a_cone"] < 4.0
