"""Ten robots for an hour, one fault after another: whether map, memory and names are right."""

from __future__ import annotations

import logging
import sys
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path

import numpy as np
from faults import FAULTS
from memory import resident_mb

from usmap_ros.evaluation.scoring import Score, score
from usmap_ros.live.live_fusion import LiveFusion
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.fields_of_view import PingViews
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.simulation import Scenario, simulate

#: Pings of each robot a second, as of a small robot that listens now and then.
RATE_HZ = 1.0
#: Time between two maps, s.
MAP_EVERY_S = 10.0
#: Of the time that each fault has, the share after which it is cleared.
CLEARED_AFTER = 0.5

Ping = tuple[str, EchoCone]


@dataclass
class Account:
    """What became of a soak.

    Parameters
    ----------
    named : dict
        Topics that were named before each fault was cleared, and at the end of its time.
    resident_mb : list of float
        Memory at the end of each fault's time.
    views : list of EchoCone
        What healthy pings looked at.
    """

    named: dict[str, tuple[set[str], set[str]]] = field(default_factory=dict)
    resident_mb: list[float] = field(default_factory=list)
    views: list[EchoCone] = field(default_factory=list)


def try_soak(
    names: list[str], minutes: float, robots: int, seed: int
) -> tuple[dict[str, str], list[str]]:
    """Let robots drive among poles while each of them fails in turn; figures, and troubles.

    Parameters
    ----------
    names : list of str
        Faults.
    minutes : float
        Of the robots' time, shared out among the faults.
    robots : int
        How many.
    seed : int
        Of the scene, and of noise.
    """
    logging.getLogger("usmap_ros").setLevel(logging.ERROR)
    scenario = fleet(60.0 * minutes, robots, seed)
    each_s = 60.0 * minutes / len(names)
    # Of its own time: nobody waits for a clock.
    fusion, account = LiveFusion(MappingParameters(), 0.0, 10_000, clock=lambda: 0.0), Account()
    traces = groupby(simulate(scenario), lambda each: int(_seconds(each[1]) / each_s))
    for number, (name, (_, period)) in enumerate(zip(names, traces, strict=False)):
        faulty = f"/robot{number % robots + 1}/echo"
        begin_s = number * each_s
        pings = heard(list(period), name, faulty, begin_s + CLEARED_AFTER * each_s, seed)
        account.named[name] = _soak(fusion, pings, faulty, begin_s, each_s, account)
        account.resident_mb.append(resident_mb())
        print(f"{name} of {faulty}: {account.named[name]}", file=sys.stderr, flush=True)
    found = score(fusion.occupancy_map(), scenario.truth_map(), PingViews.of(account.views))
    return _figures(account, found), _troubles(account, found)


def fleet(duration_s: float, robots: int, seed: int) -> Scenario:
    """Robots that walk about among poles."""
    content = {
        "seed": seed,
        "start_time_s": 0.0,
        "duration_s": duration_s,
        "world": {
            "area_m": [0.0, 10.0, 0.0, 10.0],
            "random_poles": {"count": 30, "separation_m": 0.6},
        },
        "robots": [{"name": f"robot{n + 1}", "ping_rate_hz": RATE_HZ} for n in range(robots)],
    }
    return Scenario.from_mapping(content, Path("soak.yaml"))


def heard(
    period: list[tuple[str, EchoTrace]], name: str, faulty: str, cleared_s: float, seed: int
) -> list[Ping]:
    """Cones of some minutes, for the first of which a robot has a fault."""
    pipeline, rng = Pipeline(), np.random.default_rng([seed, *name.encode()])
    is_faulty = [topic == faulty and _seconds(trace) < cleared_s for topic, trace in period]
    bad = FAULTS[name](
        iter([trace for (_, trace), is_bad in zip(period, is_faulty, strict=True) if is_bad]), rng
    )
    return [
        (topic, pipeline.reconstruct(next(bad) if is_bad else trace))
        for (topic, trace), is_bad in zip(period, is_faulty, strict=True)
    ]


def _soak(
    fusion: LiveFusion,
    pings: list[Ping],
    faulty: str,
    begin_s: float,
    each_s: float,
    account: Account,
) -> tuple[set[str], set[str]]:
    """Fuse pings, with maps and looks at the robots as they are due; who is named when."""
    cleared_s, next_map_s = begin_s + CLEARED_AFTER * each_s, begin_s
    during: set[str] | None = None
    for topic, cone in pings:
        now_s = _seconds(cone)
        if during is None and now_s >= cleared_s:
            during = suspects(fusion)
        fusion.receive(topic, cone)
        while fusion.fuse_next() is not None:
            pass
        if topic != faulty or now_s >= cleared_s:
            account.views.append(cone)
        if now_s >= next_map_s:
            fusion.live_map()
            next_map_s += MAP_EVERY_S
    return during or set(), suspects(fusion)


def suspects(fusion: LiveFusion) -> set[str]:
    """Topics with which something is wrong by now."""
    return {name for name, one in fusion.findings(lambda: None).items() if one.is_suspect}


def _figures(account: Account, found: Score) -> dict[str, str]:
    figures = {
        f"{name}: named, and still at the end": f"{sorted(during)}, {sorted(after)}"
        for name, (during, after) in account.named.items()
    }
    figures["resident, MB, after each fault"] = ", ".join(f"{mb:.0f}" for mb in account.resident_mb)
    figures["the map in the end"] = (
        f"F1 {found.f1:.3f}, known {found.known:.3f}, leak {found.leak:.3f}, lost {found.lost:.3f}"
    )
    return figures


def _troubles(account: Account, found: Score) -> list[str]:
    troubles = [
        f"{name}: {', '.join(sorted(after))} still named at the end"
        for name, (_, after) in account.named.items()
        if after
    ]
    first, last = account.resident_mb[len(account.resident_mb) // 3], account.resident_mb[-1]
    if last > 1.2 * first:
        troubles.append(f"memory grew from {first:.0f} to {last:.0f} MB")
    if found.f1 < 0.9 or found.lost > 0.03:
        troubles.append(f"the map in the end: F1 {found.f1:.2f}, lost {found.lost:.3f}")
    return troubles


def _seconds(ping: EchoTrace | EchoCone) -> float:
    return ping.stamp_ns * 1e-9
