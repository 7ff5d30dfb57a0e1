"""Corrected poses of pings as they come: worked out when a map is asked for, as offline."""

import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import NamedTuple

from usmap_ros.errors import MalformedMessageError, MapSizeError
from usmap_ros.grids import OccupancyMap
from usmap_ros.live.anchors import Anchor, anchored
from usmap_ros.live.located import LocatedRobots, locate, of_latest_lives
from usmap_ros.localisation.pose_kind import PoseKind, is_own_frame, robot_of
from usmap_ros.mapping.far_off import Ping
from usmap_ros.mapping.fusion import Fusion
from usmap_ros.mapping.joint.drawing import copied
from usmap_ros.mapping.joint.fusion import RETIRED_SHARE
from usmap_ros.parameters import PipelineParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.runs.corrected import Corrected
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.runs.poses import PoseWatch
from usmap_ros.runs.restarts import Restarts
from usmap_ros.runs.set_apart import SetApart, pings_of_one_map

#: Poses are corrected together again when there are such a share more pings than the last time.
MORE_SHARE = 0.25
#: Windows of pings that are kept at the most, if nobody looks at maps.
FULL_WINDOWS = 2


class LivePoses:
    """Pings as told, and the map of them with corrected poses; for one thread at a time to add to.

    Parameters
    ----------
    parameters : PipelineParameters
        ``poses`` says which poses are wanted.
    frame_id : str
        The map's frame; empty: the one that most robots share.
    """

    def __init__(self, parameters: PipelineParameters, frame_id: str = "") -> None:
        self._parameters, self._frame_id = parameters, frame_id
        self._lock = threading.Lock()
        self._told: list[Ping] = []
        self._restarts = Restarts()
        self._anchors: dict[str, Anchor] = {}
        self._kinds: dict[str, PoseKind] = {}
        self._earlier: OccupancyMap | None = None
        self._watch = PoseWatch(parameters.poses.use != "auto")
        # Rises with every ping.
        self._version = 0
        #: Rises when other pings than the newest change.
        self.generation = 0
        self._made: _Made | None = None
        self._going_on: _GoingOn | None = None
        #: Frames of odometry that pings were kept in.
        self.own_frames: set[str] = set()
        #: Where robots are by the newest map.
        self.latest = LocatedRobots(Corrected([]), "", {})
        #: What its newest map was made by.
        self.fusion: Fusion | None = None

    @property
    def is_wanted(self) -> bool:
        """Whether any poses may have to be corrected."""
        return self._parameters.poses.use != "told" or bool(self._parameters.poses.starts())

    @property
    def is_full(self) -> bool:
        """Whether so many pings are kept that a map has to be made, for the oldest to go.

        That is seconds after maps that are published would have let them go.
        """
        return len(self._told) > FULL_WINDOWS * self._parameters.mapping.window

    def takes(self, cone: EchoCone) -> bool:
        """Whether a ping in another frame than the map's may be joined to it later."""
        return self.is_wanted and is_own_frame(cone.frame_id)

    def add(self, topic: str, cone: EchoCone) -> None:
        """Keep a ping."""
        if self.is_wanted:
            self._told.append(self._restarts.renamed((topic, cone)))
            self._watch.add(self._told[-1])
            self._version += 1
            if is_own_frame(cone.frame_id):
                self.own_frames.add(cone.frame_id)

    def leave_out(self, is_left_out: Callable[[str], bool]) -> int:
        """Forget the pings of some topics; how many there were."""
        before = len(self._told)
        self._told = [ping for ping in self._told if not is_left_out(ping[0])]
        self._version, self.generation = self._version + 1, self.generation + 1
        return before - len(self._told)

    def resume(self, occupancy: OccupancyMap) -> None:
        """Start from an earlier map."""
        self._earlier = occupancy
        self._version, self.generation = self._version + 1, self.generation + 1

    def snapshot(self, is_live: bool = False) -> Callable[[], OccupancyMap] | None:
        """What makes the map as it is now, in any thread; None where poses are right as told.

        Parameters
        ----------
        is_live : bool
            Whether robots may go on from where they were found to be the last time, until there
            are many more pings.
        """
        if not self.must_correct:
            return None
        pings, anchors = list(self._told), self._anchors
        state = self._version, self.generation
        if is_live:
            return lambda: self._live_map(pings, *state) or self._map(pings, anchors, *state)
        return lambda: self._map(pings, anchors, *state)

    @property
    def is_whole(self) -> bool:
        """Whether all poses were corrected together since the newest ping."""
        return self._made is not None and self._made.version == self._version

    @property
    def must_correct(self) -> bool:
        """Whether any poses are not right as told."""
        return self.is_wanted and bool(self._told) and self._watch.must_correct

    def _map(
        self, told: list[Ping], anchors: dict[str, Anchor], version: int, generation: int
    ) -> OccupancyMap:
        with self._lock:
            if self._made is None or self._made.version < version:
                pipeline = Pipeline(self._parameters)
                pipeline.fusion.frame_id = self._frame_id
                if self._earlier is not None:
                    pipeline.resume(self._earlier)
                frame_id = pipeline.fusion.frame_id
                pings = [anchored(ping, anchors) for ping in told]
                # Here, because it takes long to load, and most poses stay as told.
                from usmap_ros.runs.correction import correct_poses

                done = correct_poses(
                    pings, self._parameters, frame_id, self._kinds, pipeline.resumed
                )
                for topic, cone in pings_of_one_map(done.pings, pipeline, SetApart()):
                    # What is wrong with a ping was said when it came.
                    with suppress(MalformedMessageError):
                        pipeline.fuse(cone, topic)
                # From now on what is new is asked for, too.
                pipeline.fusion.live_snapshot()
                occupancy = pipeline.occupancy_map()
                self._made = _Made(version, generation, occupancy, done)
                self._going_on = _GoingOn(pipeline, told, done)
                self.latest = locate(told, done, occupancy.frame_id)
                self.fusion = pipeline.fusion
            return copied(self._made.occupancy)

    def _live_map(self, told: list[Ping], version: int, generation: int) -> OccupancyMap | None:
        """The map with pings beyond those of the last one; None if all are to be corrected."""
        with self._lock:
            made, on = self._made, self._going_on
            if made is None or on is None or made.generation != generation:
                return None
            count = len(made.corrected.pings)
            if not count <= len(told) <= (1.0 + MORE_SHARE) * count or made.version >= version:
                return None
            on.take_up(told)
            try:
                return on.pipeline.fusion.live_snapshot(in_time=True)()
            except MapSizeError:
                # All of them together tell which pings are far off.
                self._going_on = None
                return None

    def retire(self, occupancy: OccupancyMap, generation: int) -> None:
        """Let the oldest pings go if there are too many, and what they said stay.

        Those that are left go on from where their robots were found to be.  While a map is made,
        it is left to the next time.

        Parameters
        ----------
        occupancy : OccupancyMap
            The map of all pings so far, which others may change.
        generation : int
            What it was when the map's pings were taken.
        """
        window = self._parameters.mapping.window
        if len(self._told) <= window or not self._lock.acquire(blocking=False):
            return
        try:
            made, count = self._made, len(self._told) - window + window // RETIRED_SHARE
            if (made.generation if made else generation) != self.generation:
                return
            if made and len(made.corrected.pings) < count:
                return
            self._earlier = made.occupancy if made else copied(occupancy)
            if made:
                self._kinds = {robot: one.kind for robot, one in made.corrected.robots.items()}
                found = made.corrected.pings
                stays = of_latest_lives(self._told[: len(found)], found)
                stays += [True] * (len(self._told) - len(found))
                anchors = self._anchors_from(made.corrected, count, stays)
                self._anchors = self._anchors | anchors
                kept = zip(self._told[count:], stays[count:], strict=True)
                self._told = [ping for ping, is_kept in kept if is_kept]
            else:
                self._told = self._told[count:]
            self.generation += 1
        finally:
            self._lock.release()

    def _anchors_from(
        self, done: Corrected, first: int, stays: Sequence[bool]
    ) -> dict[str, Anchor]:
        """Where robots that drift were found to be at their first pings that are kept."""
        anchors: dict[str, Anchor] = {}
        for row in range(first, len(done.pings)):
            (topic, told), (_, one) = self._told[row], done.pings[row]
            robot = robot_of(topic, told)
            if stays[row] and done.drifts(robot):
                anchors.setdefault(robot, Anchor(told.pose, one.pose, one.frame_id))
        return anchors


class _GoingOn:
    """The last map, and where robots were by then, from where they go on by odometry.

    Parameters
    ----------
    pipeline : Pipeline
        With the map.
    told : sequence of (topic, EchoCone)
        Its pings, as they were told.
    done : Corrected
        The same, as they were corrected.
    """

    def __init__(self, pipeline: Pipeline, told: Sequence[Ping], done: Corrected) -> None:
        self.pipeline, self._count = pipeline, len(told)
        # What is off by chance at one ping is not at the next.
        self._anchors = {
            robot: Anchor(
                cone.pose if done.drifts(robot) else found.pose, found.pose, found.frame_id
            )
            for (topic, cone), (_, found) in zip(told, done.pings, strict=True)
            for robot in [robot_of(topic, cone)]
        }

    def take_up(self, told: Sequence[Ping]) -> None:
        """Let the map have the pings beyond those that it has."""
        for ping in told[self._count :]:
            anchor = self._anchors.get(robot_of(*ping))
            # A robot that was not in the map has to be found first.
            if anchor is not None and anchor.frame_id == self.pipeline.fusion.frame_id:
                with suppress(MalformedMessageError):
                    self.pipeline.fuse(anchor.moved(ping)[1], ping[0])
        self._count = max(self._count, len(told))


class _Made(NamedTuple):
    """A map, of which pings it is, and with which poses."""

    version: int
    generation: int
    occupancy: OccupancyMap
    corrected: Corrected
