"""Parameters of nodes that replay and record bags, and of the one that makes cones of traces."""

from typing import ClassVar, Literal

from pydantic import field_validator

from usmap_ros.parameters.fields import quantity
from usmap_ros.parameters.nodes.common import (
    NodeParameters,
    check_globs,
    latency_limit,
    topic_globs,
)
from usmap_ros.parameters.pipeline import ReconstructionParameters


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
        5.0, "Longest wait for a subscriber on every topic before the start.", "s", ge=0.0, le=1e6
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


class ConeReconstructorParameters(NodeParameters):
    """Of cone_reconstructor."""

    fixed: ClassVar[frozenset[str]] = NodeParameters.fixed | {
        "input",
        "pose_source",
        "pose_timeout_s",
        "transducers",
        "reconstruction.known_walls",
        "world_frame",
    }

    input: Literal["echo", "range"] = quantity(
        "echo", "What it is given: traces, or the readings of sensors that measure ranges only."
    )
    pose_source: Literal["odometry", "tf"] = quantity(
        "odometry",
        "Where range sensors are: where the topic odom says their robot is, or where TF has their"
        " frames.",
    )
    pose_timeout_s: float = quantity(
        0.5, "Age from which on an odometry is too old for a reading.", "s", gt=0.0, le=1e6
    )
    world_frame: str = quantity("map", "Frame of those poses.", min_length=1)
    transducers: list[str] = quantity(
        [""],
        "For robots with several transducers: the namespace of each, such as left for left/echo"
        " and left/cone; an empty name stands for echo and cone.",
    )
    queue_depth: int = quantity(
        100,
        "Traces a transducer that wait to be reconstructed; beyond it the oldest is dropped.",
        ge=1,
        le=10000,
    )
    latency_limit_s: float = latency_limit()
    cell_resolution_m: float = quantity(
        0.05,
        "Side of the cells in cone_cells, and what free_scan keeps from echoes.",
        "m",
        ge=0.005,
        le=2.0,
    )
    greatest_coefficient: float = quantity(
        10.0, "Reflectivity beyond which a cell is no candidate.", gt=0.0, le=1e6
    )
    reconstruction: ReconstructionParameters = ReconstructionParameters()
