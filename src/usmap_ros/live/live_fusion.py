"""The fusion of cones as they come: ordering, counting, and a map that can be looked at.

No rclpy here: the node `map_fusion` runs it in a worker's thread.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Collection
from dataclasses import dataclass

import numpy as np

from usmap_ros.errors import MalformedMessageError, MapSizeError
from usmap_ros.grids import OccupancyMap
from usmap_ros.io.conversions.grid import MAX_SIDE
from usmap_ros.live.ordering import StampOrder
from usmap_ros.mapping.extent import Extent
from usmap_ros.mapping.robot_check.consistency import Consistency, is_of
from usmap_ros.mapping.robot_check.finding import Finding
from usmap_ros.parameters import MappingParameters, PipelineParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.repeats import SeenPings
from usmap_ros.runs.pipeline import Pipeline

#: Longest range that is believed, as a share of half the greatest map: 82 m at 5 cm.
_LONGEST_REACH = 0.1
#: No place on Earth has larger UTM coordinates.  A first cone from nowhere must not become the
#: middle of the map.
_FARTHEST_M = 1e7


@dataclass(frozen=True)
class _Received:
    """A cone, and when it came."""

    cone: EchoCone
    at_s: float


@dataclass(frozen=True)
class Fused:
    """What became of one cone.

    Parameters
    ----------
    topic : str
        Where it came from.
    latency_s : float
        From its arrival until it was in the map, the wait for older ones included.
    """

    topic: str
    latency_s: float


class LiveFusion:
    """Fuses cones in the order of their stamps; safe to use from several threads.

    Parameters
    ----------
    parameters : MappingParameters
        Of the map.
    order_wait_s : float
        How long a cone waits for older ones of other sources.
    capacity : int
        Cones that may wait.
    frame_id : str
        The map's frame; empty: that of the first cone.
    clock : callable
        Seconds of a clock that never runs backwards.
    """

    def __init__(
        self,
        parameters: MappingParameters,
        order_wait_s: float,
        capacity: int,
        frame_id: str = "",
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._parameters = PipelineParameters(mapping=parameters)
        self._pipeline = Pipeline(self._parameters)
        self._pipeline.fusion.frame_id = frame_id
        self._clock = clock
        self._order: StampOrder[_Received] = StampOrder(order_wait_s, capacity)
        self._consistency = Consistency(parameters)
        # Two locks, so that cones go on being received while one is fused.
        self._map_lock = threading.Lock()
        self._order_lock = threading.Lock()
        self._extent = Extent(parameters, MAX_SIDE)
        self._seen = SeenPings()
        self.version = 0

    @property
    def frame_id(self) -> str:
        """The map's frame; empty until it is known."""
        return self._pipeline.fusion.frame_id

    @property
    def dropped(self) -> int:
        """Cones dropped because too many waited."""
        return self._order.dropped

    @property
    def waiting(self) -> int:
        """Cones that wait to be fused."""
        return len(self._order)

    @property
    def is_behind(self) -> bool:
        """Whether a cone waits whose turn has come."""
        return self.due_in_s() == 0.0

    @property
    def late(self) -> int:
        """Cones that came after a newer one had been fused."""
        return self._order.late

    @property
    def last_late(self) -> str:
        """Topic of the last of them, and how far behind it was."""
        return self._order.last_late

    def set_limits(self, order_wait_s: float, capacity: int) -> None:
        """Change how long and how many cones may wait."""
        with self._order_lock:
            self._order.wait_s, self._order.capacity = order_wait_s, capacity

    def set_sources(self, present: dict[str, bool]) -> None:
        """Wait for the sources that are present, and not for those that are gone."""
        with self._order_lock:
            for source, is_present in present.items():
                if is_present:
                    self._order.add_source(source)
                else:
                    self._order.remove_source(source)

    def receive(self, topic: str, cone: EchoCone) -> None:
        """Take a cone in, to be fused when its turn comes; its frame must be the map's.

        Raises
        ------
        RepeatedPingError
            If the ping was there before.
        MalformedMessageError
            If it lies or reaches so far away that the map could not be published any more.
        """
        self._check_reach(cone)
        self._seen.add(cone)
        if not self.frame_id:
            # From the first cone on, though it may still wait to be fused: the next ones must fit.
            self._pipeline.fusion.frame_id = cone.frame_id
        now_s = self._clock()
        with self._order_lock:
            self._order.push(topic, cone.stamp_ns, _Received(cone, now_s), now_s)

    def fuse_next(self) -> Fused | None:
        """Fuse the next cone, if its turn has come.

        Raises
        ------
        MalformedMessageError
            If it cannot be fused.
        """
        with self._order_lock:
            released = self._order.pop(self._clock())
        if released is None:
            return None
        topic, received = released
        with self._map_lock:
            self._pipeline.fuse(received.cone, topic)
            self._consistency.add(topic, received.cone)
            self.version += 1
        return Fused(topic, self._clock() - received.at_s)

    def due_in_s(self) -> float | None:
        """How long until `fuse_next` has something to do; None: not before another cone comes."""
        with self._order_lock:
            return self._order.due_in_s(self._clock())

    def occupancy_map(self) -> OccupancyMap:
        """The map so far; cones are fused while it is made."""
        with self._map_lock:
            make = self._pipeline.fusion.snapshot()
        return make()

    def findings(self, between: Callable[[], None]) -> dict[str, Finding]:
        """Judge the robots by the pings of late; cones are fused meanwhile.

        Parameters
        ----------
        between : callable
            As in `Consistency.findings`.
        """
        with self._map_lock:
            consistency, by_others = self._consistency.copy(), self._pipeline.fusion.by_others()
        return consistency.findings(by_others, between)

    def leave_out(self, names: Collection[str]) -> None:
        """Take back what some robots, or topics, have said, as far as that is still known."""
        if not names:
            return
        with self._map_lock:
            self._consistency.forget(names)
            if self._pipeline.fusion.leave_out(lambda topic: is_of(topic, names)):
                self.version += 1

    def resume(self, occupancy: OccupancyMap) -> None:
        """Start from an earlier map.

        Raises
        ------
        ValueError
            If its resolution, origin or frame does not fit.
        MapSizeError
            If it is larger than a map may be.
        """
        if self.frame_id and occupancy.frame_id and occupancy.frame_id != self.frame_id:
            raise ValueError(f"its frame is '{occupancy.frame_id}' and not '{self.frame_id}'")
        with self._map_lock:
            self._pipeline.resume(occupancy)
            self._extent.cover(occupancy.geometry)
            self.version += 1

    def _check_reach(self, cone: EchoCone) -> None:
        """Refuse what would make the map larger than memory, or than nav2 takes."""
        limit_m = 0.5 * MAX_SIDE * self._parameters.mapping.resolution_m
        reach_m, position_m = cone.transducer.max_range_m, cone.pose.position_m[:2]
        if reach_m > _LONGEST_REACH * limit_m:
            raise MalformedMessageError(
                "transducer.max_range", f"is {reach_m:g} m, too far for the resolution of the map"
            )
        if np.abs(position_m).max() > _FARTHEST_M:
            raise MalformedMessageError(
                "pose.position", f"is {np.abs(position_m).max():g} m from the frame's origin"
            )
        try:
            self._extent.add(cone)
        except MapSizeError as error:
            raise MalformedMessageError("pose.position", str(error)) from error

    def reset(self) -> None:
        """Forget the map and the cones that wait; frame and stamp stay."""
        with self._map_lock, self._order_lock:
            before = self._pipeline.fusion
            self._pipeline = Pipeline(self._parameters)
            self._pipeline.fusion.frame_id = before.frame_id
            self._pipeline.fusion.stamp_ns = before.stamp_ns
            self._consistency = Consistency(self._parameters.mapping)
            self._order.clear()
            self._extent = Extent(self._parameters.mapping, MAX_SIDE)
            self._seen = SeenPings()
            self.version += 1
