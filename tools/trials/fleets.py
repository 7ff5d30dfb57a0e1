"""Fleets of real processes, several at once, started and stopped over and over."""

from __future__ import annotations

import os
import random
import re
import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

from usmap_ros.errors import UsmapError
from usmap_ros.io.map_files import GRID_FILE, load_map
from usmap_ros.live.supervisor import PARENT_VARIABLE

#: A fleet that has kept no map by then never will.
START_S = 300.0
#: Share of the patience with endings that a kept map may lack of the time until the fleet was
#: asked to end: the wait for other robots, and a queue on a busy machine.
LAG = 0.3
#: Low enough for many processes to keep up on two cores.
PING_RATE_HZ = 2.0
#: Words in a log that mean that something was lost, or went wrong.
BAD_WORDS = re.compile(
    r"Traceback|dropped:|failed:|malformed:|refused:|not kept:|starting it again|does not end"
)

#: How the nodes reach each other: by loopback alone.
PROFILE = Path(__file__).parents[2] / "config/dds/one_machine.xml"
_PROGRAM = [sys.executable, "-m", "usmap_ros"]
_PARAMETERS = "/**:\n  ros__parameters: {checkpoint_period_s: 1.0}\n"


@dataclass
class _Fleet:
    """A fleet that runs."""

    number: int
    folder: Path
    process: subprocess.Popen[bytes] = field(init=False)
    asked_s: float = 0.0

    def start(self, scenario: Path, parameters: Path) -> None:
        """Start it in a ROS domain of its own."""
        self.folder.mkdir()
        domain = 1 + (int(os.environ.get("ROS_DOMAIN_ID", "0")) + self.number) % 100
        own = {"ROS_DOMAIN_ID": str(domain), "FASTRTPS_DEFAULT_PROFILES_FILE": str(PROFILE)}
        command = [*_PROGRAM, "fleet", str(scenario), "-o", str(self.folder / "map")]
        with (self.folder / "log").open("wb") as log:
            self.process = subprocess.Popen(
                [*command, "-p", str(parameters)],
                stdout=log,
                stderr=subprocess.STDOUT,
                env={**os.environ, **own},
                start_new_session=True,
            )

    def ask_to_end(self, number: signal.Signals) -> None:
        """Send it a signal."""
        self.asked_s = time.time()
        self.process.send_signal(number)

    def wait(self, longest_s: float) -> float:
        """Wait until it has ended, and end it by force if it does not; how long it took (s)."""
        try:
            self.process.wait(longest_s)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        return time.time() - self.asked_s

    def end(self, longest_s: float) -> None:
        """End it, if the trial is interrupted before it does."""
        if self.process.poll() is None:
            self.ask_to_end(signal.SIGINT)
            self.wait(longest_s)

    def troubles(self, took_s: float, patience_s: float) -> list[str]:
        """What was not as it should be."""
        found = []
        if self.process.returncode != 0:
            found.append(f"ended with {self.process.returncode}")
        if took_s > patience_s:
            found.append(f"took {took_s:.1f} s to end")
        log = (self.folder / "log").read_text(encoding="utf-8", errors="replace")
        found += sorted({f"said {match.group()!r}" for match in BAD_WORDS.finditer(log)})
        left = _children(self.process.pid)
        if left:
            found.append(f"left {len(left)} processes behind")
        try:
            missing_s = self.asked_s - load_map(self.folder / "map")[0].stamp_ns / 1e9
            if missing_s > LAG * patience_s:
                found.append(f"kept a map that lacks the last {missing_s:.1f} s")
        except UsmapError as error:
            found.append(f"kept no map: {error}")
        return [f"fleet {self.number}: {trouble}" for trouble in found]


def try_fleets(
    folder: Path, count: int, at_once: int, robots: int, seed: int, patience_s: float
) -> tuple[dict[str, str], list[str]]:
    """Start and stop fleets; figures, and what went wrong.

    Parameters
    ----------
    folder : path
        For their maps and logs.
    count, at_once, robots : int
        Fleets in all, fleets that run at the same time, and robots in each.
    seed : int
        Of the times at which they are stopped.
    patience_s : float
        Longest that an ending may take.
    """
    scenario, parameters = folder / "scenario.yaml", folder / "nodes.yaml"
    scenario.write_text(_scenario(robots), encoding="utf-8")
    parameters.write_text(_PARAMETERS, encoding="utf-8")
    generator = random.Random(seed)
    ends_s: list[float] = []
    troubles: list[str] = []
    for first in range(0, count, at_once):
        fleets = [_Fleet(n, folder / str(n)) for n in range(first, min(first + at_once, count))]
        with ExitStack() as running:
            for fleet in fleets:
                fleet.start(scenario, parameters)
                running.callback(fleet.end, patience_s)
            _wait_for_maps(fleets)
            time.sleep(generator.uniform(0.0, 3.0))
            for fleet in fleets:
                fleet.ask_to_end(generator.choice([signal.SIGINT, signal.SIGTERM]))
            for fleet in fleets:
                took_s = fleet.wait(4.0 * patience_s)
                ends_s.append(took_s)
                troubles += fleet.troubles(took_s, patience_s)
        print(f"{len(ends_s)} of {count}, {len(troubles)} troubles", file=sys.stderr, flush=True)
    ends_s.sort()
    return {
        "fleets": f"{count} of {robots} robots, {at_once} at once",
        "time to end": f"median {ends_s[len(ends_s) // 2]:.1f} s, longest {ends_s[-1]:.1f} s",
        "troubles": str(len(troubles)),
    }, troubles


def _scenario(robots: int) -> str:
    lines = ["duration_s: 600", "world: {area_m: [0, 8, 0, 8], random_poles: {count: 12}}"]
    robot = "  - {{name: robot{}, ping_rate_hz: {:g}}}"
    lines += ["robots:", *(robot.format(n, PING_RATE_HZ) for n in range(1, robots + 1))]
    return "\n".join(lines) + "\n"


def _wait_for_maps(fleets: list[_Fleet]) -> None:
    """Until every fleet has kept a map, or it is too late."""
    end_s = time.monotonic() + START_S
    while time.monotonic() < end_s:
        if all((fleet.folder / "map" / GRID_FILE).exists() for fleet in fleets):
            return
        time.sleep(0.1)


def _children(supervisor: int) -> list[int]:
    """Processes that this one had started, and that have not ended."""
    wanted, found = f"{PARENT_VARIABLE}={supervisor}".encode(), []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if wanted in (folder / "environ").read_bytes().split(b"\0"):
                found.append(int(folder.name))
        except OSError:
            continue
    return found
