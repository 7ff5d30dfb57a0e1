"""``usmap info``: what is in a bag."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from usmap_ros.cli import console

if TYPE_CHECKING:
    from usmap_ros.pings.cone import EchoCone


def info(
    bags: Annotated[
        list[Path], typer.Argument(metavar="BAG...", help="rosbag2 folders, .mcap or .db3 files.")
    ],
    as_json: Annotated[bool, typer.Option("--json", help="Print it as JSON.")] = False,
) -> None:
    """Tell what is in a bag: robots, pings, duration, encodings, extent."""
    from usmap_ros.calibration.receiver_survey import ReceiverSurvey
    from usmap_ros.io.bag_info import describe_bag
    from usmap_ros.io.bag_reader import BagReader
    from usmap_ros.pings.trace import EchoTrace
    from usmap_ros.runs.pipeline import Pipeline
    from usmap_ros.runs.recorded import AmplitudeSurvey

    with (
        BagReader(bags) as bag,
        console.progress("reading", bag.trace_count + bag.cone_count + bag.range_count) as step,
    ):
        console.compile_loops()
        pipeline = Pipeline()
        survey = AmplitudeSurvey(pipeline)
        pulses = ReceiverSurvey(pipeline.parameters.reconstruction)

        def listen(topic: str, ping: EchoTrace | EchoCone) -> None:
            survey.add(topic, ping)
            if isinstance(ping, EchoTrace):
                pulses.add(topic, ping)
            step()

        description = describe_bag(bag, listen)
    description["amplitude_problems"] = survey.problems()
    description["pulse_problems"] = pulses.problems()
    if as_json:
        typer.echo(json.dumps(description, indent=2))
        return
    console.print_facts(", ".join(map(str, bags)), _facts(description))
    console.print_table(
        "", ["topic", "pings", "rate", "encoding", "samples", "range"],
        [_row(topic) for topic in description["topics"]],
    )  # fmt: skip


def _facts(description: dict[str, Any]) -> dict[str, str]:
    x_min, x_max, y_min, y_max = description["extent_m"]
    facts = {
        "pings": str(description["pings"]),
        "duration": f"{description['seconds']:.1f} s",
        "frames": ", ".join(description["frames"]),
        "pulse": _pulses(description["topics"]),
        "positions": f"x {x_min:.2f} to {x_max:.2f} m, y {y_min:.2f} to {y_max:.2f} m",
        "saturated": _saturated(description),
        "amplitudes": "; ".join(
            f"{topic}: {problem}" for topic, problem in description["amplitude_problems"].items()
        ),
        "pulse fit": "; ".join(
            f"{topic}: {problem}" for topic, problem in description["pulse_problems"].items()
        ),
        "other topics": ", ".join(description["other_topics"]),
        "skipped": ", ".join(f"{name} ({n})" for name, n in description["skipped"].items()),
    }
    return {name: value for name, value in facts.items() if value}


def _saturated(description: dict[str, Any]) -> str:
    """How many pings were driven to their converter's limit, if any."""
    pings = sum(topic["saturated_pings"] for topic in description["topics"])
    return f"{pings} pings: their echoes are louder than recorded" if pings else ""


def _row(topic: dict[str, Any]) -> list[str]:
    rate = f"{topic['rate_hz']:.1f} Hz" if topic["rate_hz"] else "–"
    sampling = f"{topic['sample_rate_hz'] / 1e3:g} kS/s" if topic["sample_rate_hz"] else "–"
    reach = f"{topic['min_range_m']:g} to {topic['max_range_m']:g} m"
    return [topic["topic"], str(topic["pings"]), rate, topic["encoding"], sampling, reach]


def _pulses(topics: list[dict[str, Any]]) -> str:
    """Pulse of all topics, or which of them have which."""
    users: dict[str, list[str]] = {}
    for topic in topics:
        pulse = f"{topic['pulse']}, {topic['pulse_duration_s'] * 1e3:g} ms"
        if topic["carrier_hz"]:
            pulse += f", {topic['carrier_hz'] / 1e3:g} kHz"
        users.setdefault(pulse, []).append(topic["topic"])
    if len(users) == 1:
        return next(iter(users))
    return "; ".join(f"{pulse} ({', '.join(names)})" for pulse, names in users.items())
