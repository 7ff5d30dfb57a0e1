"""Ten robots for an hour, one fault after another: whether map, memory and names are right."""

from __future__ import annotations

import logging
import math
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

#: Pings of each robot a second: in the six minutes that each of ten faults has, 90 with it and as
#: many after it.
RATE_HZ = 0.5
#: Time between two maps, s; and pings of the faulty robot between two looks at who is wrong, as
#: long as that is not right.
MAP_EVERY_S, LOOK_EVERY = 10.0, 12
#: Of the time that each fault has, the share after which it is cleared.
CLEARED_AFTER = 0.5

Ping = tuple[str, EchoCone]


@dataclass
class Course:
    """What became of one fault.

    Parameters
    ----------
    named_after, cleared_after : int, optional
        Pings of the faulty robot from when it began, or ended, until that was said.
    accused : set of str
        Who never had it, and was named.
    resident_mb : float
        The least memory in its time: at others, whole maps are worked out beside.
    """

    named_after: int | None = None
    cleared_after: int | None = None
    accused: set[str] = field(default_factory=set)
    resident_mb: float = math.inf

    def row(self) -> str:
        """In a line."""
        named, cleared = (
            "never" if pings is None else f"after {pings}"
            for pings in (self.named_after, self.cleared_after)
        )
        if self.named_after is None:
            cleared = ""
        others = ", ".join(sorted(self.accused)) or "nobody"
        return f"{named}; {cleared}; {others}; {self.resident_mb:.0f} MB"


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
    fusion = LiveFusion(MappingParameters(), 0.0, 10_000, clock=lambda: 0.0)
    courses: dict[str, Course] = {}
    views: list[PingViews] = []
    traces = groupby(simulate(scenario), lambda each: int(_seconds(each[1]) / each_s))
    for number, (name, (_, period)) in enumerate(zip(names, traces, strict=False)):
        faulty, begin_s = f"/robot{number % robots + 1}/echo", number * each_s
        cleared_s = begin_s + CLEARED_AFTER * each_s
        pings = heard(list(period), name, faulty, cleared_s, seed)
        courses[name] = course = soak(fusion, pings, faulty, cleared_s, begin_s)
        views.append(
            PingViews.of(
                cone for topic, cone in pings if topic != faulty or _seconds(cone) >= cleared_s
            )
        )
        print(f"{name} of {faulty}: {course.row()}", file=sys.stderr, flush=True)
    seen = PingViews(
        np.concatenate([one.positions_m for one in views]),
        np.concatenate([one.beams for one in views]),
    )
    found = score(fusion.occupancy_map(), scenario.truth_map(), seen)
    return _figures(courses, found), _troubles(courses, found)


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


def soak(
    fusion: LiveFusion, pings: list[Ping], faulty: str, cleared_s: float, begin_s: float
) -> Course:
    """Fuse pings, with maps and looks at the robots as they are due; who is named when."""
    course, next_map_s, own, before = Course(), begin_s, 0, 0
    for topic, cone in pings:
        now_s = _seconds(cone)
        fusion.receive(topic, cone)
        while fusion.fuse_next() is not None:
            pass
        if now_s >= next_map_s:
            fusion.live_map()
            next_map_s += MAP_EVERY_S
        if topic != faulty:
            continue
        own += 1
        course.resident_mb = min(course.resident_mb, resident_mb())
        if now_s < cleared_s:
            before = own
        is_decided = (course.named_after if own == before else course.cleared_after) is not None
        if (own - before or own) % LOOK_EVERY == 0 and not is_decided:
            _look(fusion, course, faulty, own, before)
    _look(fusion, course, faulty, own, before)
    return course


def _look(fusion: LiveFusion, course: Course, faulty: str, own: int, before: int) -> None:
    """See who is named, so many pings of the faulty robot on, of which some were wrong."""
    named = suspects(fusion)
    course.accused |= named - {faulty}
    if own == before and faulty in named:
        course.named_after = own
    elif own > before:
        still = faulty in named
        course.cleared_after = None if still else course.cleared_after or own - before


def suspects(fusion: LiveFusion) -> set[str]:
    """Topics with which something is wrong by now."""
    return {name for name, one in fusion.findings(lambda: None).items() if one.is_suspect}


def _figures(courses: dict[str, Course], found: Score) -> dict[str, str]:
    figures = {"fault": "named after so many pings; cleared after; others accused; least resident"}
    figures |= {name: course.row() for name, course in courses.items()}
    figures["the map in the end"] = (
        f"F1 {found.f1:.3f}, known {found.known:.3f}, leak {found.leak:.3f}, lost {found.lost:.3f}"
    )
    return figures


def _troubles(courses: dict[str, Course], found: Score) -> list[str]:
    troubles = [f"{name}: others accused" for name, course in courses.items() if course.accused]
    troubles += [f"{name}: not cleared" for name, one in courses.items() if not one.cleared_after]
    # The window of pings fills first.
    used_mb = [course.resident_mb for course in courses.values()]
    third = max(1, len(used_mb) // 3)
    middle_mb, last_mb = (
        float(np.median(some)) for some in (used_mb[third:-third] or used_mb, used_mb[-third:])
    )
    if last_mb > 1.2 * middle_mb:
        troubles.append(f"memory grew from {middle_mb:.0f} to {last_mb:.0f} MB")
    if found.f1 < 0.9 or found.lost > 0.03:
        troubles.append(f"the map in the end: F1 {found.f1:.2f}, lost {found.lost:.3f}")
    return troubles


def _seconds(ping: EchoTrace | EchoCone) -> float:
    return ping.stamp_ns * 1e-9
