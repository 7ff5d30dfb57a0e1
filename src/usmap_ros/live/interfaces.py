"""Every topic and service of every node, declared once.

The nodes make their publishers, subscriptions and services from these declarations, and the
reference page is written from them.  rclpy is not needed here.
"""

from dataclasses import dataclass

from usmap_ros.parameters.nodes import (
    BagRecorderParameters,
    BagReplayParameters,
    ConeReconstructorParameters,
    EchoDriverParameters,
    MapFusionParameters,
    NodeParameters,
    SerialDriverParameters,
)


@dataclass(frozen=True)
class Qos:
    """Quality of service: how many messages are kept, for whom, and whether they are resent."""

    depth: int
    is_reliable: bool = True
    is_latched: bool = False

    def __str__(self) -> str:
        reliability = "reliable" if self.is_reliable else "best effort"
        durability = "transient local" if self.is_latched else "volatile"
        return f"{reliability}, {durability}, depth {self.depth}"


SENSOR_DATA = Qos(depth=5, is_reliable=False)
LATCHED = Qos(depth=1, is_latched=True)


@dataclass(frozen=True)
class Topic:
    """A topic of a node."""

    name: str
    message_type: str
    qos: Qos
    description: str
    #: When it is there, if not always.
    condition: str = ""


@dataclass(frozen=True)
class ServiceInterface:
    """A service of a node."""

    name: str
    service_type: str
    description: str


@dataclass(frozen=True)
class NodeInterface:
    """What a node has to do with the rest of the system."""

    name: str
    summary: str
    parameters: type[NodeParameters]
    publishes: tuple[Topic, ...] = ()
    subscribes: tuple[Topic, ...] = ()
    services: tuple[ServiceInterface, ...] = ()
    is_managed: bool = False


DIAGNOSTICS = Topic(
    "/diagnostics",
    "diagnostic_msgs/msg/DiagnosticArray",
    Qos(depth=10),
    "What was received, refused and dropped, and why; rate and latency.",
)
ECHO = Topic(
    "echo",
    "usmap_msgs/msg/EchoTrace",
    Qos(depth=10),
    "One message a ping. A robot with several transducers has NAME/echo for each.",
)
TRANSDUCERS = Topic(
    "transducers",
    "usmap_msgs/msg/TransducerArray",
    Qos(depth=64, is_latched=True),
    "Which transducers ping at once, and how far chirps sweep, if there are any such:"
    " what EchoTrace does not say.",
)
RANGE = Topic(
    "range",
    "sensor_msgs/msg/Range",
    SENSOR_DATA,
    "Range of the first echo; exactly max_range if there is none.",
)
ODOM = Topic(
    "odom",
    "nav_msgs/msg/Odometry",
    Qos(depth=10),
    "True pose of the robot's base in the scenario's frame.",
    "pose_source is odometry",
)
DEVICE_ODOM = Topic(
    "odom",
    "nav_msgs/msg/Odometry",
    Qos(depth=10),
    "Pose of the robot's base in the frame that the sensor's description names.",
    "pose_source is odometry",
)
READING = Topic(
    "range",
    "sensor_msgs/msg/Range",
    SENSOR_DATA,
    "Readings of a sensor that measures ranges only, each of which becomes a cone with one echo.",
    "input is range",
)
BASE_ODOM = Topic(
    "odom",
    "nav_msgs/msg/Odometry",
    Qos(depth=10),
    "Pose of a robot whose sensors measure ranges only, in the frame world_frame.",
    "input is range and pose_source is odometry",
)
CONE = Topic(
    "cone",
    "usmap_msgs/msg/EchoCone",
    Qos(depth=50),
    "Echoes found in a trace, and how loud an unheard one might have been: about 1 kB.",
)
CONE_CELLS = Topic(
    "cone_cells",
    "sensor_msgs/msg/PointCloud2",
    SENSOR_DATA,
    "x, y, z and coefficient of every cell that may have returned an echo, in the world frame.",
)
FREE_SCAN = Topic(
    "free_scan",
    "sensor_msgs/msg/LaserScan",
    SENSOR_DATA,
    "Rays through what the ping says is free, in the transducer's frame: they clear, and mark"
    " nothing.",
)
MAP = Topic(
    "map", "nav_msgs/msg/OccupancyGrid", LATCHED, "The map: -1 unknown, 0 free, 100 occupied."
)
MAP_PROBABILITY = Topic(
    "map_probability",
    "nav_msgs/msg/OccupancyGrid",
    LATCHED,
    "Probability that each cell is occupied, 0 to 100, or -1 where nothing was observed.",
)
MAP_NORMALS = Topic(
    "map_normals",
    "sensor_msgs/msg/PointCloud2",
    LATCHED,
    "x, y, z, normal_x, normal_y and probability of every occupied cell whose surface is known to"
    " face in some direction.",
)
MAP_AMBIGUITY = Topic(
    "map_ambiguity",
    "nav_msgs/msg/OccupancyGrid",
    LATCHED,
    "How undecided each cell is, 0 to 100, or -1 where nothing was observed or suspected.",
)
MAP_METADATA = Topic(
    "map_metadata", "nav_msgs/msg/MapMetaData", LATCHED, "Size, resolution and origin of the map."
)
MAP_UPDATES = Topic(
    "map_updates",
    "map_msgs/msg/OccupancyGridUpdate",
    Qos(depth=10),
    "The part of the map that has changed, while its extent has not.",
    "publish_updates is true and map_msgs is installed",
)
TRAJECTORIES = Topic(
    "~/trajectories",
    "nav_msgs/msg/Path",
    LATCHED,
    "One for each robot, ~/trajectories/ROBOT: where it was at its pings, corrected.",
    "poses are corrected",
)
CLOCK = Topic(
    "/clock",
    "rosgraph_msgs/msg/Clock",
    Qos(depth=1, is_reliable=False),
    "Time of the recording.",
    "clock is true",
)

PAUSE = ServiceInterface("~/pause", "std_srvs/srv/SetBool", "Pause (true) or go on (false).")
GET_MAP = ServiceInterface("~/get_map", "nav_msgs/srv/GetMap", "The map as it is now.")
SAVE_MAP = ServiceInterface(
    "~/save_map", "std_srvs/srv/Trigger", "Write map.yaml, map.pgm and map.npz into save_path."
)
RESET = ServiceInterface("~/reset", "std_srvs/srv/Empty", "Forget the map.")

ECHO_DRIVER = NodeInterface(
    "echo_driver",
    "Simulates the transducers of one robot of a scenario.",
    EchoDriverParameters,
    publishes=(ECHO, TRANSDUCERS, RANGE, DIAGNOSTICS),
    subscribes=(ODOM,),
)
SERIAL_DRIVER = NodeInterface(
    "serial_driver",
    "Lets a transducer behind a serial line or a network connection ping.",
    SerialDriverParameters,
    publishes=(ECHO, RANGE, DIAGNOSTICS),
    subscribes=(DEVICE_ODOM,),
)
CONE_RECONSTRUCTOR = NodeInterface(
    "cone_reconstructor",
    "Recovers the echoes in each trace.",
    ConeReconstructorParameters,
    publishes=(CONE, CONE_CELLS, FREE_SCAN, DIAGNOSTICS),
    subscribes=(ECHO, TRANSDUCERS, READING, BASE_ODOM),
)
MAP_FUSION = NodeInterface(
    "map_fusion",
    "Fuses the cones of all robots into one map.",
    MapFusionParameters,
    publishes=(
        MAP,
        MAP_PROBABILITY,
        MAP_NORMALS,
        MAP_AMBIGUITY,
        MAP_METADATA,
        MAP_UPDATES,
        TRAJECTORIES,
        DIAGNOSTICS,
    ),
    subscribes=(CONE,),
    services=(GET_MAP, SAVE_MAP, RESET, PAUSE),
    is_managed=True,
)
BAG_REPLAY = NodeInterface(
    "bag_replay",
    "Publishes a recording: its topics, with their own QoS.",
    BagReplayParameters,
    publishes=(CLOCK, DIAGNOSTICS),
    subscribes=(CONE, DIAGNOSTICS),
    services=(PAUSE,),
)
BAG_RECORDER = NodeInterface(
    "bag_recorder",
    "Records live topics, with their own QoS, into MCAP that survives being killed.",
    BagRecorderParameters,
    publishes=(DIAGNOSTICS,),
)

NODES = (ECHO_DRIVER, SERIAL_DRIVER, CONE_RECONSTRUCTOR, MAP_FUSION, BAG_REPLAY, BAG_RECORDER)
