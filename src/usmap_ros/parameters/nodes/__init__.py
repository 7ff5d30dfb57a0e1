"""Every parameter of every node.

`common` has what several nodes share; the others are named after what their nodes do.
"""

from usmap_ros.parameters.nodes.common import NodeParameters
from usmap_ros.parameters.nodes.drivers import (
    DeviceDriverParameters,
    EchoDriverParameters,
    SerialDriverParameters,
)
from usmap_ros.parameters.nodes.fusion import MapFusionParameters
from usmap_ros.parameters.nodes.reconstructor import (
    BagRecorderParameters,
    BagReplayParameters,
    ConeReconstructorParameters,
)

__all__ = [
    "BagRecorderParameters",
    "BagReplayParameters",
    "ConeReconstructorParameters",
    "DeviceDriverParameters",
    "EchoDriverParameters",
    "MapFusionParameters",
    "NodeParameters",
    "SerialDriverParameters",
]
