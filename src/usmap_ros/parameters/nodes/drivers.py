"""Parameters of the nodes that send pings."""

from typing import ClassVar, Literal

from usmap_ros.parameters.fields import quantity
from usmap_ros.parameters.nodes.common import NodeParameters


class DriverParameters(NodeParameters):
    """Of all of them."""

    fixed: ClassVar[frozenset[str]] = NodeParameters.fixed | frozenset(
        {"base_frame", "ping_rate_hz", "pose_source", "pose_timeout_s"}
    )

    base_frame: str = quantity("", "The robot's base frame on TF; empty: ROBOT/base_link.")
    pose_timeout_s: float = quantity(
        0.5, "Age from which on a pose from TF or odometry is too old to ping.", "s", gt=0.0, le=1e6
    )
    publish_range: bool = quantity(True, "Whether the first echo goes out as sensor_msgs/Range.")


class EchoDriverParameters(DriverParameters):
    """Of echo_driver."""

    fixed: ClassVar[frozenset[str]] = DriverParameters.fixed | frozenset(
        {
            "scenario",
            "robot",
            "publish_tf",
            "publish_base_tf",
            "publish_transducer_tf",
            "start_time_s",
        }
    )

    scenario: str = quantity("", "Scenario file with the world and the robot; it must be given.")
    robot: str = quantity("", "Name of the robot in it; empty: the scenario's first.")
    pose_source: Literal["path", "tf", "odometry"] = quantity(
        "path",
        "Where the robot is: on the scenario's path, where TF has its base frame, or where the"
        " topic 'odom' says.",
    )
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


class DeviceDriverParameters(DriverParameters):
    """Of drivers of real hardware."""

    fixed: ClassVar[frozenset[str]] = DriverParameters.fixed | {"sensor", "longest_pause_s"}

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


class SerialDriverParameters(DeviceDriverParameters):
    """Of serial_driver."""

    fixed: ClassVar[frozenset[str]] = DeviceDriverParameters.fixed | {
        "device",
        "baud_rate",
        "answer_timeout_s",
    }

    device: str = quantity(
        "", "Serial port, such as /dev/ttyUSB0, or tcp://HOST:PORT; it must be given."
    )
    baud_rate: int = quantity(
        921600, "Of a serial port; most USB devices ignore it.", ge=50, le=4_000_000
    )
    answer_timeout_s: float = quantity(
        0.5, "Longest time from a trigger to the end of its frame.", "s", gt=0.0, le=60.0
    )
