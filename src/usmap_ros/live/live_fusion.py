"""The fusion of cones as they come: ordering, counting, and a map that can be looked at.

No rclpy here: the node `map_fusion` runs it in a worker's thread.
"""

import threading
import time
from collections import deque
from collections.abc import Callable, Collection
from dataclasses import dataclass

from usmap_ros.bounds import MAX_MAP_SIDE
from usmap_ros.errors import MalformedMessageError
from usmap_ros.grids import OccupancyMap
from usmap_ros.live.cone_queue import ConeQueue
from usmap_ros.live.live_poses import LivePoses
from usmap_ros.mapping.common_frame import CommonFrame
from usmap_ros.mapping.far_off import FarOff, FarOffError, Ping
from usmap_ros.mapping.robot_check.consistency import Consistency, is_of
from usmap_ros.mapping.robot_check.finding import Finding
from usmap_ros.parameters import MappingParameters, PipelineParameters, PoseParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.repeats import SeenPings
from usmap_ros.runs.pipeline import Pipeline

#: Longest range that is believed, as a share of half the greatest map: 82 m at 5 cm.
_LONGEST_REACH = 0.1


@dataclass(frozen=True)
class FusionOutcome:
    """What became of one cone."""

    #: Where it came from.
    topic: str
    #: From its arrival until it was in the map, the wait for older ones included.
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
        The map's frame; empty: the one that most robots share in the first seconds.
    clock : callable
        Seconds of a clock that never runs backwards.
    on_set_apart : callable
        Told how many pings were set apart, and why, when that is known only after they came.
    poses : PoseParameters
        Which poses are mapped with.

    Attributes
    ----------
    version : int
        Rises with every change of the map.
    generation : int
        Rises when the map begins anew.
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
        self._parameters = PipelineParameters(mapping=parameters, poses=poses)
        #: What corrects poses that drift.
        self.poses = LivePoses(self._parameters, frame_id)
        self._stated_frame = frame_id
        self._pipeline = Pipeline(self._parameters)
        self._frame, self._far = CommonFrame(frame_id), FarOff(parameters)
        self._clock, self._on_set_apart = clock, on_set_apart
        # It has a lock of its own, so that cones go on being received while one is fused.
        #: The cones that wait.
        self.queue = ConeQueue(order_wait_s, capacity, clock)
        self._map_lock = threading.Lock()
        self._consistency = Consistency(parameters)
        self._seen = SeenPings()
        # What is to be fused next, since its place is known now.
        self._ready: deque[Ping] = deque()
        self._left_out = frozenset[str]()
        self.version = self.generation = self._pings = 0

    @property
    def frame_id(self) -> str:
        """The map's frame, or the one that stands in for it; empty before the first cone."""
        return self._frame.frame_id

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

    def _fuse(self, topic: str, cone: EchoCone) -> None:
        """Put a cone into the map, under its lock."""
        if cone.frame_id == self.frame_id:
            self._pipeline.fuse(cone, topic)
            self._consistency.add(topic, cone)
        self.poses.add(topic, cone)
        self.version += 1
        self._pings += 1

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

    def occupancy_map(self) -> OccupancyMap:
        """The map so far, all pings explained together; cones are fused while it is made."""
        return self._made(is_live=False)

    def live_map(self, is_last: bool = False) -> OccupancyMap:
        """The same while pings come: what is new alone is worked out, all the rest beside it.

        Parameters
        ----------
        is_last : bool
            Whether no more seem to come: a later map is then that of `occupancy_map`.
        """
        return self._made(is_live=True, is_last=is_last)

    @property
    def is_whole(self) -> bool:
        """Whether the newest map of either kind is that of `occupancy_map`."""
        with self._map_lock:
            poses = self.poses
            return poses.is_whole if poses.must_correct else self._pipeline.fusion.is_whole

    @property
    def doubted(self) -> str:
        """Robots whom others contradict in the newest map, and for how much of it they count."""
        corrects = self.poses.must_correct
        doubted = self.poses.doubted if corrects else self._pipeline.fusion.doubted
        return ", ".join(f"{topic} {share:.0%}" for topic, share in doubted.items())

    def _made(self, is_live: bool, is_last: bool = False) -> OccupancyMap:
        with self._map_lock:
            fusion = self._pipeline.fusion
            make = self.poses.snapshot(is_live and not is_last) or (
                fusion.live_snapshot(in_time=True, is_last=is_last) if is_live
                else fusion.snapshot()
            )  # fmt: skip
            generation = self.poses.generation
        occupancy = make()
        with self._map_lock:
            self.poses.retire(occupancy, generation)
        return occupancy

    def findings(self, between: Callable[[], None]) -> dict[str, Finding]:
        """Judge the robots by the pings of late, and let suspects count for nothing.

        Cones are fused meanwhile.

        Parameters
        ----------
        between : callable
            As in `Consistency.findings`.
        """
        with self._map_lock:
            consistency, left_out = self._consistency.copy(), self._left_out
        found = consistency.findings(between)
        with self._map_lock:
            if self._left_out != left_out:
                # What was found beside a robot that is gone does not hold any more.
                return found
            shares = {topic: finding.trust for topic, finding in found.items()}
            if self._pipeline.fusion.trust(shares):
                self.version += 1
        return found

    def leave_out(self, names: Collection[str]) -> None:
        """Leave some robots, or topics, out from now on, and nobody else.

        What they have said is taken back, as far as it is still known, and what was found of others
        beside them.
        """
        new = set(names) - self._left_out
        with self._map_lock:
            self._left_out = frozenset(names)
            if not new:
                return
            self._consistency.forget(new)
            self.poses.leave_out(lambda topic: is_of(topic, new))
            if self._pipeline.fusion.leave_out(lambda topic: is_of(topic, new)):
                self._pipeline.fusion.trust({})
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
            self.poses.resume(occupancy)
            self._frame = CommonFrame(self._pipeline.fusion.frame_id or self.frame_id)
            if self._pipeline.resumed is not None:
                self._far.cover(self._pipeline.resumed.geometry)
            self.version += 1

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

    def _begin_anew(self) -> None:
        """Forget the map, under its lock."""
        self._pipeline = Pipeline(self._parameters)
        self._pipeline.fusion.frame_id = self.frame_id
        self.poses = LivePoses(self._parameters, self._stated_frame)
        self._consistency = Consistency(self._parameters.mapping)
        self._ready.clear()
        self._pings = 0
        self.version += 1
        self.generation += 1
