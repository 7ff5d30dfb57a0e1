"""Parameters of the nodes that replay and record bags."""

from __future__ import annotations

from typing import ClassVar

from pydantic import field_validator

from usmap_ros.parameters.fields import quantity
from usmap_ros.parameters.nodes.common import NodeParameters, check_globs, topic_globs


class BagReplayParameters(NodeParameters):
    """Of bag_replay."""

    fixed: ClassVar[frozenset[str]] = NodeParameters.fixed | frozenset(
        {"bag", "clock", "clock_rate_hz", "start_paused", "topic_pattern", "wait_s"}
    )

    bag: str = quantity("", "The recording; it must be given.")
    rate: float = quantity(1.0, "Speed, relative to that of the recording.", gt=0.0, le=1000.0)
    loop: bool = quantity(False, "Whether to start over at the end.")
    start_paused: bool = quantity(False, "Whether to wait for the service pause to let go.")
    topic_pattern: str = topic_globs("published")
    clock: bool = quantity(True, "Whether to publish the recording's time on /clock.")
    clock_rate_hz: float = quantity(100.0, "Rate of /clock, in real time.", "Hz", gt=0.0, le=1000.0)
    wait_s: float = quantity(
        5.0,
        "Longest wait for a subscriber on every topic before the start.",
        "s",
        ge=0.0,
        le=1e6,
    )

    _are_globs = field_validator("topic_pattern")(check_globs)


class BagRecorderParameters(NodeParameters):
    """Of bag_recorder."""

    fixed: ClassVar[frozenset[str]] = NodeParameters.fixed | {
        "bag",
        "discovery_period_s",
        "topic_pattern",
    }

    bag: str = quantity("", "Folder of the new recording; it must be given.")
    topic_pattern: str = topic_globs("recorded")
    discovery_period_s: float = quantity(
        0.5, "Time from one look for new topics to the next.", "s", ge=0.05, le=60.0
    )

    _are_globs = field_validator("topic_pattern")(check_globs)
