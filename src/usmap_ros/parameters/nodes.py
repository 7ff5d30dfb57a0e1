"""Every parameter of every node."""

from __future__ import annotations

import re
from typing import Any, ClassVar, Literal

from pydantic import field_validator, model_validator

from usmap_ros.parameters.fields import ParameterGroup, quantity
from usmap_ros.parameters.pipeline import MappingParameters, ReconstructionParameters
from usmap_ros.parameters.reception import Numbers


class NodeParameters(ParameterGroup):
    """What all nodes have."""

    #: Parameters, or groups of them, that cannot be changed while the node runs.
    fixed: ClassVar[frozenset[str]] = frozenset({"diagnostics_period_s"})

    diagnostics_period_s: float = quantity(
        1.0, "Time from one diagnostic message to the next.", "s", ge=0.05, le=60.0
    )


def _latency_limit() -> Any:
    """For nodes through which messages go."""
    return quantity(
        1.0,
        "Latency beyond which the node warns in /diagnostics, if half of the messages take longer.",
        "s",
        gt=0.0,
        le=3600.0,
    )


class EchoDriverParameters(NodeParameters):
    """Of echo_driver."""

    fixed: ClassVar[frozenset[str]] = NodeParameters.fixed | frozenset(
        {
            "scenario",
            "robot",
            "pose_source",
            "base_frame",
            "ping_rate_hz",
            "publish_tf",
            "publish_base_tf",
            "publish_transducer_tf",
            "start_time_s",
            "pose_timeout_s",
        }
    )

    scenario: str = quantity("", "Scenario file with the world and the robot; it must be given.")
    robot: str = quantity("", "Name of the robot in it; empty: the scenario's first.")
    pose_source: Literal["path", "tf", "odometry"] = quantity(
        "path",
        "Where the robot is: on the scenario's path, where TF has its base frame, or where the"
        " topic 'odom' says.",
    )
    base_frame: str = quantity("", "The robot's base frame on TF; empty: ROBOT/base_link.")
    ping_rate_hz: float = quantity(
        0.0, "Pings of each transducer; 0: as the scenario says.", "Hz", ge=0.0, le=1000.0
    )
    start_time_s: float = quantity(
        0.0,
        "ROS time at which the scenario begins: the same for all robots lets them share its moving"
        " objects, and one that is restarted rejoin its path; 0: when this node starts.",
        "s",
        ge=0.0,
        le=4e9,
    )
    pose_timeout_s: float = quantity(
        0.5, "Age from which on a pose from TF or odometry is too old to ping.", "s", gt=0.0, le=1e6
    )
    publish_range: bool = quantity(True, "Whether the first echo goes out as sensor_msgs/Range.")
    publish_tf: bool = quantity(
        False, "Whether the robot's frames are broadcast on TF, if it is there."
    )
    publish_base_tf: bool = quantity(
        True,
        "Whether the base frame is among them, in the world; never with pose source tf. A frame has"
        " one parent: false if something else broadcasts it.",
    )
    publish_transducer_tf: bool = quantity(
        True,
        "Whether the transducers are among them, in the base frame; false if a description of the"
        " robot has them.",
    )


class DeviceDriverParameters(NodeParameters):
    """Of drivers of real hardware."""

    fixed: ClassVar[frozenset[str]] = NodeParameters.fixed | frozenset(
        {
            "sensor",
            "ping_rate_hz",
            "longest_pause_s",
            "pose_source",
            "base_frame",
            "pose_timeout_s",
        }
    )

    sensor: str = quantity(
        "", "Description of the sensor, as for `usmap import`; it must be given."
    )
    ping_rate_hz: float = quantity(10.0, "Pings.", "Hz", gt=0.0, le=1000.0)
    longest_pause_s: float = quantity(
        8.0,
        "Longest pause between attempts to open a device that is lost; the first is half a second,"
        " and each next one twice as long.",
        "s",
        ge=0.5,
        le=3600.0,
    )
    pose_source: Literal["odometry", "tf"] = quantity(
        "odometry",
        "Where the robot is: where the topic 'odom' says, or where TF has its base frame.",
    )
    base_frame: str = quantity("", "The robot's base frame on TF; empty: ROBOT/base_link.")
    pose_timeout_s: float = quantity(
        0.5, "Age from which on a pose from TF or odometry is too old to ping.", "s", gt=0.0, le=1e6
    )
    publish_range: bool = quantity(True, "Whether the first echo goes out as sensor_msgs/Range.")


class SerialDriverParameters(DeviceDriverParameters):
    """Of serial_driver."""

    fixed: ClassVar[frozenset[str]] = DeviceDriverParameters.fixed | frozenset(
        {"device", "baud_rate", "answer_timeout_s"}
    )

    device: str = quantity(
        "", "Serial port, such as /dev/ttyUSB0, or tcp://HOST:PORT; it must be given."
    )
    baud_rate: int = quantity(
        921600, "Of a serial port; most USB devices ignore it.", ge=50, le=4_000_000
    )
    answer_timeout_s: float = quantity(
        0.5, "Longest time from a trigger to the end of its frame.", "s", gt=0.0, le=60.0
    )


def _check_pattern(pattern: str) -> str:
    try:
        re.compile(pattern)
    except re.error as error:
        raise ValueError(f"is no regular expression: {error}") from error
    return pattern


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
        20,
        "Traces a transducer that wait to be reconstructed; beyond it the oldest is dropped.",
        ge=1,
        le=10000,
    )
    latency_limit_s: float = _latency_limit()
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


class MapFusionParameters(NodeParameters):
    """Of map_fusion."""

    #: Paths among them: nobody on the network is to choose what files are overwritten.
    fixed: ClassVar[frozenset[str]] = NodeParameters.fixed | {
        "autostart",
        "checkpoint_path",
        "save_path",
    }
    #: Taken over when the node is configured.
    fixed_while_configured: ClassVar[frozenset[str]] = frozenset(
        {
            "cone_topics",
            "frame_id",
            "mapping",
            "publish_updates",
            "resume",
            "whole_map_period_s",
        }
    )

    autostart: bool = quantity(True, "Whether the node configures and activates itself.")
    topic_pattern: str = quantity(
        ".*", "Regular expression that the whole name of a cone topic must match to be fused."
    )
    cone_topics: list[str] = quantity(
        [""], "Cone topics to fuse; empty: every one there is, found by its type."
    )
    without: list[str] = quantity(
        [""], "Robots, or cone topics, whose cones are left out of the map from now on."
    )
    area_m: Numbers = quantity(
        [0.0, 0.0, 0.0, 0.0],
        "Lowest and highest x, lowest and highest y of the pings that are fused, the highest not"
        " among them: others are for other fusions, whose maps `usmap merge` joins; all 0:"
        " everywhere.",
        "m",
        min_length=4,
        max_length=4,
    )
    check_period_s: float = quantity(
        10.0,
        "Time from one comparison of each robot's echoes with the others' map to the next.",
        "s",
        ge=0.1,
        le=86_400.0,
    )
    discovery_period_s: float = quantity(
        0.5, "Time from one look for new cone topics to the next.", "s", ge=0.05, le=60.0
    )
    frame_id: str = quantity("", "The map's frame; empty: that of the first cone.")
    transform_wait_s: float = quantity(
        0.2, "How long a cone in another frame waits for its transform.", "s", ge=0.0, le=10.0
    )
    publish_rate_hz: float = quantity(
        1.0, "Rate at which the map is published if it has changed.", "Hz", gt=0.0, le=100.0
    )
    publish_updates: bool = quantity(
        False, "Whether changes go out on map_updates too, if map_msgs is there."
    )
    whole_map_period_s: float = quantity(
        0.0,
        "With publish_updates: time from one whole map to the next while its extent is the same;"
        " 0: a whole map with every change.",
        "s",
        ge=0.0,
        le=86_400.0,
    )
    order_wait_s: float = quantity(
        0.25, "How long a cone waits for older ones of other robots.", "s", ge=0.0, le=60.0
    )
    queue_depth: int = quantity(
        1000, "Cones that wait to be fused; beyond it the oldest is dropped.", ge=1, le=1_000_000
    )
    latency_limit_s: float = _latency_limit()
    checkpoint_path: str = quantity("", "Folder that the map is kept in; empty: none.")
    checkpoint_period_s: float = quantity(
        10.0, "Longest that the map on disk lags behind.", "s", ge=0.1, le=86_400.0
    )
    resume: bool = quantity(True, "Whether to start from the checkpoint, if there is one.")
    save_path: str = quantity("usmap_map", "Folder that the service save_map writes into.")
    mapping: MappingParameters = MappingParameters()

    _pattern_compiles = field_validator("topic_pattern")(_check_pattern)

    @model_validator(mode="after")
    def _area_is_one(self) -> MapFusionParameters:
        west, east, south, north = self.area_m
        if any(self.area_m) and not (west < east and south < north):
            raise ValueError("area_m: must ascend in x and in y")
        return self

    def is_in_area(self, x_m: float, y_m: float) -> bool:
        """Whether a ping from there is to be fused here."""
        west, east, south, north = self.area_m
        return not any(self.area_m) or (west <= x_m < east and south <= y_m < north)


class BagReplayParameters(NodeParameters):
    """Of bag_replay."""

    fixed: ClassVar[frozenset[str]] = NodeParameters.fixed | frozenset(
        {"bag", "clock", "clock_rate_hz", "start_paused", "topic_pattern", "wait_s"}
    )

    bag: str = quantity("", "The recording; it must be given.")
    rate: float = quantity(1.0, "Speed, relative to that of the recording.", gt=0.0, le=1000.0)
    loop: bool = quantity(False, "Whether to start over at the end.")
    start_paused: bool = quantity(False, "Whether to wait for the service pause to let go.")
    topic_pattern: str = quantity(
        ".*", "Regular expression that the whole name of a topic must match to be published."
    )
    clock: bool = quantity(True, "Whether to publish the recording's time on /clock.")
    clock_rate_hz: float = quantity(100.0, "Rate of /clock, in real time.", "Hz", gt=0.0, le=1000.0)
    wait_s: float = quantity(
        5.0,
        "Longest wait for a subscriber on every topic before the start.",
        "s",
        ge=0.0,
        le=1e6,
    )

    _pattern_compiles = field_validator("topic_pattern")(_check_pattern)


class BagRecorderParameters(NodeParameters):
    """Of bag_recorder."""

    fixed: ClassVar[frozenset[str]] = NodeParameters.fixed | {
        "bag",
        "discovery_period_s",
        "topic_pattern",
    }

    bag: str = quantity("", "Folder of the new recording; it must be given.")
    topic_pattern: str = quantity(
        ".*", "Regular expression that the whole name of a topic must match to be recorded."
    )
    discovery_period_s: float = quantity(
        0.5, "Time from one look for new topics to the next.", "s", ge=0.05, le=60.0
    )

    _pattern_compiles = field_validator("topic_pattern")(_check_pattern)
