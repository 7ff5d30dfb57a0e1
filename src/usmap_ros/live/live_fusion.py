"""The fusion of cones as they come: which of them are of this map, and in what order.

No rclpy here: the node `map_fusion` runs it in a worker's thread.
"""

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from usmap_ros.bounds import MAX_MAP_SIDE
from usmap_ros.errors import MalformedMessageError
from usmap_ros.grids import OccupancyMap
from usmap_ros.live.cone_queue import ConeQueue
from usmap_ros.live.shared_map import SharedMap
from usmap_ros.mapping.common_frame import CommonFrame
from usmap_ros.mapping.far_off import FarOff, FarOffError, Ping
from usmap_ros.mapping.robot_check.consistency import is_of
from usmap_ros.parameters import MappingParameters, PipelineParameters, PoseParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.repeats import SeenPings

#: Longest range that is believed, as a share of half the greatest map: 82 m at 5 cm.
_LONGEST_REACH = 0.1


@dataclass(frozen=True)
class FusionOutcome:
    """What became of one cone."""

    #: Where it came from.
    topic: str
    #: From its arrival until it was in the map, the wait for older ones included.
    latency_s: float


class LiveFusion(SharedMap):
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
        The map's frame; empty: the one that most robots share in the first seconds.
    clock : callable
        Seconds of a clock that never runs backwards.
    on_set_apart : callable
        Told how many pings were set apart, and why, when that is known only after they came.
    poses : PoseParameters
        Which poses are mapped with.
    """

    def __init__(
        self,
        parameters: MappingParameters,
        order_wait_s: float,
        capacity: int,
        frame_id: str = "",
        clock: Callable[[], float] = time.monotonic,
        on_set_apart: Callable[[int, str], None] = lambda count, cause: None,
        poses: PoseParameters = PoseParameters(),  # noqa: B008 - it cannot be changed
    ) -> None:
        super().__init__(PipelineParameters(mapping=parameters, poses=poses), frame_id)
        self._far = FarOff(parameters)
        self._clock, self._on_set_apart = clock, on_set_apart
        # It has a lock of its own, so that cones go on being received while one is fused.
        #: The cones that wait.
        self.queue = ConeQueue(order_wait_s, capacity, clock)
        self._seen = SeenPings()
        # What is to be fused next, since its place is known now.
        self._ready: deque[Ping] = deque()

    @property
    def is_frame_decided(self) -> bool:
        """Whether the frame stays as it is."""
        return self._frame.is_decided

    @property
    def waiting(self) -> int:
        """Cones that wait to be fused."""
        return len(self.queue) + len(self._ready)

    @property
    def is_behind(self) -> bool:
        """Whether a cone waits whose turn has come."""
        return self.due_in_s() == 0.0

    def receive(self, topic: str, cone: EchoCone) -> None:
        """Take a cone in, to be fused when its turn comes.

        Until it is known which frame most robots share, those in another than the first cone's
        are held; the map may then begin anew with them.

        Raises
        ------
        RepeatedPingError
            If the ping was there before.
        MalformedMessageError
            If it is in another frame than the map, or reaches too far for a map to be published.
        """
        self._check_reach(cone)
        self._seen.add(cone)
        was_decided = self._frame.is_decided
        if self._frame.add(topic, cone) or (was_decided and self.poses.takes(cone)):
            self.queue.push(topic, cone)
        elif was_decided:
            raise MalformedMessageError(
                "header.frame_id", f"is '{cone.frame_id}', the map's is '{self.frame_id}'"
            )
        if not was_decided:
            self._decide_on_frame()

    def takes(self, cone: EchoCone) -> bool:
        """Whether a ping is in the map's frame, or in one that may be joined to it."""
        return cone.frame_id == self.frame_id or self.poses.takes(cone)

    def _decide_on_frame(self) -> None:
        """Go on with the frame of most robots, if it is known now."""
        if self._frame.decide():
            with self._map_lock:
                lost = self._pings + self.waiting
                self._begin_anew()
                self.queue.clear()
                self._far = FarOff(self._parameters.mapping)
            self._tell_apart(lost, "are not in the frame of most robots", "; the map begins anew")
        if self._frame.is_decided:
            held = self._frame.take_held()
            fitting = [ping for ping in held if self.takes(ping[1])]
            for topic, cone in fitting:
                self.queue.push(topic, cone)
            self._tell_apart(len(held) - len(fitting), "are in other frames")

    def _tell_apart(self, count: int, why: str, then: str = "") -> None:
        if count:
            self._on_set_apart(count, f"{count} pings {why}, '{self.frame_id}'{then}")

    def fuse_next(self) -> FusionOutcome | None:
        """Fuse the next cone, if its turn has come.

        Raises
        ------
        FarOffError
            If it is set apart, for now or for good.
        MalformedMessageError
            If it cannot be fused.
        """
        came_s, released = self._clock(), None
        if not self._ready:
            released = self.queue.pop()
            if released is None:
                return None
            came_s = released.came_s
        with self._map_lock:
            if released is not None:
                self._sort_out(released.topic, released.cone)
            if not self._ready:
                # The map began anew meanwhile, or its robot is left out.
                return None
            topic, cone = self._ready.popleft()
            if is_of(topic, self._left_out):
                return None
            self._fuse(topic, cone)
        if self.poses.is_full:
            # Nobody looks at maps; what the oldest pings said has to stay in one.
            self.occupancy_map()
        self.queue.spend(topic, cone)
        return FusionOutcome(topic, self._clock() - came_s)

    def _sort_out(self, topic: str, cone: EchoCone) -> None:
        """Find what is to be fused now that there is this cone, under the map's lock.

        Its error is raised if nothing is.
        """
        if is_of(topic, self._left_out):
            return
        if cone.frame_id != self.frame_id:
            if self.poses.takes(cone):
                self._ready.append((topic, cone))
            return
        apart: FarOffError | None = None
        try:
            self._ready.extend(self._far.add(topic, cone))
        except FarOffError as error:
            apart = error
        anew = self._far.decide()
        if anew is not None:
            self._tell_apart(self._pings, "are far from most robots in", "; the map begins anew")
            self._begin_anew()
            self._ready.extend(anew)
        if apart is not None and not self._ready:
            raise apart

    def due_in_s(self) -> float | None:
        """How long until `fuse_next` has something to do; None: not before another cone comes."""
        if self._ready:
            return 0.0
        return self.queue.due_in_s()

    def _check_reach(self, cone: EchoCone) -> None:
        """Refuse what a map of a size that nav2 takes has no room for."""
        limit_m = 0.5 * MAX_MAP_SIDE * self._parameters.mapping.resolution_m
        reach_m = cone.transducer.max_range_m
        if reach_m > _LONGEST_REACH * limit_m:
            raise MalformedMessageError(
                "transducer.max_range", f"is {reach_m:g} m, too far for the resolution of the map"
            )

    def reset(self) -> None:
        """Forget the map and the cones that wait; frame and stamp stay."""
        with self._map_lock:
            stamp_ns = self._pipeline.fusion.stamp_ns
            self._frame = CommonFrame(self.frame_id)
            self._begin_anew()
            self._pipeline.fusion.stamp_ns = stamp_ns
            self.queue.clear()
            self._far = FarOff(self._parameters.mapping)
            self._seen = SeenPings()

    def resume(self, occupancy: OccupancyMap) -> None:
        """Start from an earlier map, as `SharedMap.resume` does."""
        super().resume(occupancy)
        if occupancy.observed.any():
            self._far.cover(occupancy.geometry)

    def _begin_anew(self) -> None:
        """Forget the map, under its lock, and what would be fused next."""
        super()._begin_anew()
        self._ready.clear()
