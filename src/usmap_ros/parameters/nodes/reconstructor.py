"""Parameters of the node that makes cones of traces."""

from __future__ import annotations

from typing import ClassVar, Literal

from usmap_ros.parameters.fields import quantity
from usmap_ros.parameters.nodes.common import NodeParameters, latency_limit
from usmap_ros.parameters.pipeline import ReconstructionParameters


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
