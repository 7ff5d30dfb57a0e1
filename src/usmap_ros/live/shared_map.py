"""A map that is changed, looked at and judged by several threads."""

import threading
from collections.abc import Callable, Collection

from usmap_ros.grids import OccupancyMap
from usmap_ros.live.live_poses import LivePoses
from usmap_ros.mapping.common_frame import CommonFrame
from usmap_ros.mapping.fusion import Fusion
from usmap_ros.mapping.robot_check.consistency import Consistency, is_of
from usmap_ros.mapping.robot_check.finding import Finding
from usmap_ros.parameters import PipelineParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.processes.workers import Beside
from usmap_ros.runs.pipeline import Pipeline


class SharedMap:
    """A map under a lock; what takes long is done beside it, while cones are fused.

    Parameters
    ----------
    parameters : PipelineParameters
        Of the map, and which poses it is made with.
    frame_id : str
        The map's frame; empty: the one that most robots share in the first seconds.
    """

    def __init__(self, parameters: PipelineParameters, frame_id: str) -> None:
        self._parameters, self._stated_frame = parameters, frame_id
        #: What corrects poses that drift.
        self.poses = LivePoses(parameters, frame_id)
        self._pipeline = Pipeline(parameters)
        self._frame = CommonFrame(frame_id)
        self._map_lock = threading.Lock()
        self._consistency = Consistency(parameters.mapping)
        self._left_out = frozenset[str]()
        #: Rise with every change of the map, and when it begins anew.
        self.version, self.generation = 0, 0
        self._pings = 0

    @property
    def frame_id(self) -> str:
        """The map's frame, or the one that stands in for it; empty before the first cone."""
        return self._frame.frame_id

    def _fuse(self, topic: str, cone: EchoCone) -> None:
        """Put a cone into the map, under its lock."""
        if cone.frame_id == self.frame_id:
            self._pipeline.fuse(cone, topic)
            self._consistency.add(topic, cone)
        self.poses.add(topic, cone)
        self.version += 1
        self._pings += 1

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
    def is_map_behind(self) -> bool:
        """Whether the newest live map lacks pings that had come, which the next one has."""
        return self._latest.is_behind

    @property
    def thinned(self) -> int:
        """Pings that more came than could be explained with, and that went for it."""
        return self._latest.thinned

    @property
    def doubted(self) -> str:
        """Robots whom others contradict in the newest map, and for how much of it they count."""
        doubted = self._latest.doubted
        return ", ".join(f"{topic} {share:.0%}" for topic, share in doubted.items())

    @property
    def common_error(self) -> str:
        """What is wrong with all pings, and is not in the newest map of all pings any more."""
        return "; ".join(self._latest.common_error.reasons)

    @property
    def _latest(self) -> Fusion:
        """What made the newest map."""
        corrected = self.poses.fusion if self.poses.must_correct else None
        return corrected or self._pipeline.fusion

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

    def findings(self, meanwhile: Callable[[], None] = lambda: None) -> dict[str, Finding]:
        """Judge the robots by the pings of late, and let suspects count for nothing.

        Cones are fused meanwhile.

        Parameters
        ----------
        meanwhile : callable
            As of `usmap_ros.processes.workers.Beside.result`.
        """
        with self._map_lock:
            consistency, left_out = self._consistency.copy(), self._left_out
        found = Beside(Consistency.findings, consistency).result(meanwhile)
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
            self.version += 1

    def _begin_anew(self) -> None:
        """Forget the map, under its lock."""
        self._pipeline = Pipeline(self._parameters)
        self._pipeline.fusion.frame_id = self.frame_id
        self.poses = LivePoses(self._parameters, self._stated_frame)
        self._consistency = Consistency(self._parameters.mapping)
        self._pings = 0
        self.version += 1
        self.generation += 1
