"""Parameters of the node that fuses cones into the map."""

from __future__ import annotations

from typing import ClassVar

from pydantic import field_validator, model_validator

from usmap_ros.parameters.fields import quantity
from usmap_ros.parameters.nodes.common import (
    NodeParameters,
    check_globs,
    latency_limit,
    topic_globs,
)
from usmap_ros.parameters.pipeline import MappingParameters
from usmap_ros.parameters.poses import PoseParameters
from usmap_ros.parameters.reception import Numbers


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
            "poses",
            "publish_updates",
            "resume",
            "whole_map_period_s",
        }
    )

    autostart: bool = quantity(True, "Whether the node configures and activates itself.")
    topic_pattern: str = topic_globs("fused")
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
    absence_s: float = quantity(
        60.0,
        "How long nobody publishes on a cone topic before its subscription is let go of; when"
        " somebody does again, it is taken up again.",
        "s",
        ge=0.0,
        le=86_400.0,
    )
    frame_id: str = quantity(
        "", "The map's frame; empty: the one that most robots share in the first seconds."
    )
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
        10_000, "Cones that wait to be fused; beyond it the oldest is dropped.", ge=1, le=1_000_000
    )
    latency_limit_s: float = latency_limit()
    checkpoint_path: str = quantity("", "Folder that the map is kept in; empty: none.")
    checkpoint_period_s: float = quantity(
        10.0, "Longest that the map on disk lags behind.", "s", ge=0.1, le=86_400.0
    )
    resume: bool = quantity(True, "Whether to start from the checkpoint, if there is one.")
    save_path: str = quantity("usmap_map", "Folder that the service save_map writes into.")
    mapping: MappingParameters = MappingParameters()
    poses: PoseParameters = PoseParameters()

    _are_globs = field_validator("topic_pattern")(check_globs)

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
