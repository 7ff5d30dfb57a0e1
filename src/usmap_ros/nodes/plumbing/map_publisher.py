"""The map on its topics: whole, as nav2 wants it, and only when it has changed."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from usmap_ros.grids import NORMAL, UNKNOWN_VALUE, GridGeometry, OccupancyMap
from usmap_ros.io.conversions import (
    grid_to_message,
    grid_update_to_message,
    metadata_to_message,
    points_to_message,
)
from usmap_ros.live.interfaces import (
    MAP,
    MAP_AMBIGUITY,
    MAP_METADATA,
    MAP_NORMALS,
    MAP_PROBABILITY,
    MAP_UPDATES,
)
from usmap_ros.nodes.plumbing.endpoints import advertise, advertise_managed
from usmap_ros.nodes.plumbing.ros_types import RosMessageTypes

#: Published maps grow by whole blocks of so many cells: each growth makes nav2 allocate its
#: costmaps anew and forget what its other layers had marked.
BLOCK_CELLS = 64


def block_geometry(geometry: GridGeometry, at_least: GridGeometry | None = None) -> GridGeometry:
    """Smallest grid of whole blocks that covers a grid, and another one if it is given.

    Blocks lie at fixed places, so that cells never move as the grid grows.
    """
    covered = geometry if at_least is None else GridGeometry.around([geometry, at_least])
    first = np.array(covered.first_cell)
    last = first + covered.shape[::-1]
    first = first // BLOCK_CELLS * BLOCK_CELLS
    last = -(-last // BLOCK_CELLS) * BLOCK_CELLS
    columns, rows = (int(count) for count in last - first)
    x, y = (float(cell) * geometry.resolution_m for cell in first)
    return GridGeometry(geometry.resolution_m, (x, y), (rows, columns))


def placed(
    values: NDArray[np.int8], geometry: GridGeometry, target: GridGeometry
) -> NDArray[np.int8]:
    """`values` of one grid on a larger one, unknown around them."""
    whole = np.full(target.shape, UNKNOWN_VALUE, dtype=np.int8)
    whole[geometry.within(target)] = values
    return whole


def changed_part(
    before: NDArray[np.int8], after: NDArray[np.int8]
) -> tuple[tuple[int, int], NDArray[np.int8]] | None:
    """First row and column, and new values, of the smallest rectangle that holds all changes."""
    rows, columns = np.nonzero(before != after)
    if len(rows) == 0:
        return None
    first = (int(rows.min()), int(columns.min()))
    return first, after[first[0] : rows.max() + 1, first[1] : columns.max() + 1]


def normal_columns(occupancy: OccupancyMap) -> dict[str, NDArray[np.float32]]:
    """Columns of ``map_normals``; without points if the map has no such layer."""
    shape = occupancy.geometry.shape
    normal_rad = occupancy.layers.get(NORMAL, np.full(shape, np.nan, np.float32))
    rows, columns = np.nonzero(np.isfinite(normal_rad))
    x, y = occupancy.geometry.cell_centers_m(rows, columns).astype(np.float32).T
    angle = normal_rad[rows, columns]
    return {
        "x": x,
        "y": y,
        "z": np.zeros_like(x),
        "normal_x": np.cos(angle),
        "normal_y": np.sin(angle),
        "probability": occupancy.probability()[rows, columns].astype(np.float32),
    }


class MapPublisher:
    """Publishes the map in all its forms, and updates if wanted.

    While nobody listens to ``map_probability``, ``map_normals`` or ``map_ambiguity`` they are left
    out, until the map has ceased to change.

    Parameters
    ----------
    node : LifecycleNode
        Whose topics they are; they are silent unless it is active.
    with_updates : bool
        Whether ``map_updates`` is published too, if ``map_msgs`` is installed.
    whole_period_s : float
        Where it is, and the extent is the same: how long only updates go out after a whole map.
    clock : callable
        Seconds of a clock that never runs backwards.
    """

    def __init__(
        self,
        node: Any,
        with_updates: bool,
        whole_period_s: float = 0.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._node = node
        self._types = RosMessageTypes()
        self._map = advertise_managed(node, MAP)
        self._metadata = advertise_managed(node, MAP_METADATA)
        self._beside: dict[Any, Callable[[OccupancyMap, GridGeometry], Any]] = {
            advertise_managed(node, MAP_PROBABILITY): self._probability_message,
            advertise_managed(node, MAP_AMBIGUITY): self._ambiguity_message,
            advertise_managed(node, MAP_NORMALS): self._normals_message,
        }
        self._left_out: list[Any] = []
        self._updates = self._advertise_updates() if with_updates else None
        self._whole_period_s, self._clock, self._whole_s = whole_period_s, clock, 0.0
        self._geometry: GridGeometry | None = None
        self._values: NDArray[np.int8] | None = None

    @property
    def is_complete(self) -> bool:
        """Whether the last map was published in all its forms."""
        return not self._left_out

    def publish(self, occupancy: OccupancyMap) -> None:
        """Publish a map.

        Raises
        ------
        MalformedMessageError
            If nav2 would refuse it.
        """
        geometry = block_geometry(occupancy.geometry, self._geometry)
        values = placed(occupancy.trinary(), occupancy.geometry, geometry)
        is_update = self._updates is not None and geometry == self._geometry
        if is_update:
            self._publish_update(values, occupancy)
        self._geometry, self._values = geometry, values
        now_s = self._clock()
        if is_update and now_s < self._whole_s + self._whole_period_s:
            return
        self._whole_s = now_s
        stamp_ns = occupancy.stamp_ns
        grid = grid_to_message(geometry, values, occupancy.frame_id, stamp_ns, self._types)
        self._map.publish(grid)
        self._metadata.publish(metadata_to_message(geometry, stamp_ns, self._types))
        self._left_out = []
        for publisher, message in self._beside.items():
            if publisher.get_subscription_count():
                publisher.publish(message(occupancy, geometry))
            else:
                self._left_out.append(publisher)

    def complete(self, occupancy: OccupancyMap) -> None:
        """Publish what was left out of the last map, which has not changed since."""
        geometry = block_geometry(occupancy.geometry, self._geometry)
        while self._left_out:
            publisher = self._left_out.pop()
            publisher.publish(self._beside[publisher](occupancy, geometry))

    def message(self, occupancy: OccupancyMap) -> Any:
        """``nav_msgs/OccupancyGrid`` of a map, of the extent that it would be published with.

        Raises
        ------
        MalformedMessageError
            If nav2 would refuse it.
        """
        geometry = block_geometry(occupancy.geometry, self._geometry)
        return self._grid_message(occupancy.trinary(), occupancy, geometry)

    def forget_extent(self) -> None:
        """Let the next map be smaller than the last one."""
        self._geometry = self._values = None

    def destroy(self) -> None:
        """Take the topics back."""
        for publisher in (self._map, self._metadata, *self._beside):
            self._node.destroy_lifecycle_publisher(publisher)
        if self._updates is not None:
            self._node.destroy_publisher(self._updates)

    def _probability_message(self, occupancy: OccupancyMap, geometry: GridGeometry) -> Any:
        return self._grid_message(occupancy.percent(), occupancy, geometry)

    def _ambiguity_message(self, occupancy: OccupancyMap, geometry: GridGeometry) -> Any:
        return self._grid_message(occupancy.ambiguity_percent(), occupancy, geometry)

    def _grid_message(
        self, values: NDArray[np.int8], occupancy: OccupancyMap, geometry: GridGeometry
    ) -> Any:
        """Message of values of a map's cells, of the extent with which it is published."""
        whole = placed(values, occupancy.geometry, geometry)
        frame_id, stamp_ns = occupancy.frame_id, occupancy.stamp_ns
        return grid_to_message(geometry, whole, frame_id, stamp_ns, self._types)

    def _normals_message(self, occupancy: OccupancyMap, geometry: GridGeometry) -> Any:
        frame_id, stamp_ns = occupancy.frame_id, occupancy.stamp_ns
        return points_to_message(normal_columns(occupancy), frame_id, stamp_ns, self._types)

    def _advertise_updates(self) -> Any:
        try:
            return advertise(self._node, MAP_UPDATES)
        except ImportError:
            warning = "map_msgs is not installed: map_updates is not published"
            self._node.get_logger().warning(warning)
            return None

    def _publish_update(self, values: NDArray[np.int8], occupancy: OccupancyMap) -> None:
        assert self._values is not None
        assert self._updates is not None
        changed = changed_part(self._values, values)
        if changed is not None:
            first, part = changed
            self._updates.publish(
                grid_update_to_message(
                    part, first, occupancy.frame_id, occupancy.stamp_ns, self._types
                )
            )
