"""Brings maps out: on their topics, and to the disk."""

import time
from typing import Any

from usmap_ros.errors import MalformedMessageError, MapFileError, MapSizeError
from usmap_ros.live.checkpoint import Checkpoint
from usmap_ros.live.health import Health
from usmap_ros.live.live_fusion import LiveFusion
from usmap_ros.nodes.plumbing.corrected_poses import CorrectedPoses
from usmap_ros.nodes.plumbing.frames import Transforms
from usmap_ros.nodes.plumbing.map_publisher import MapPublisher
from usmap_ros.nodes.plumbing.parameter_server import ParameterServer
from usmap_ros.nodes.plumbing.worker import Worker
from usmap_ros.parameters.nodes import MapFusionParameters

#: How many of its periods a map is put off while cones wait to be fused, and how often it is looked
#: whether they still do.
_PUT_OFF_PERIODS, _LOOK_S = 2.0, 0.004
#: When nothing has come for so long, all that came is explained together.
_QUIET_S = 0.5


class MapBringer:
    """Publishes a map and keeps it, in a thread of its own.

    Parameters
    ----------
    node : LifecycleNode
        On whose topics the map is published.
    parameters : ParameterServer
        How often, and what of it.
    health : Health
        Counts what was published, and what could not be.
    fusion : LiveFusion
        Has the map.
    checkpoint : Checkpoint
        Where it is kept.
    transforms : Transforms
        TF, for frames of odometry that are corrected.
    """

    def __init__(
        self,
        node: Any,
        parameters: ParameterServer[MapFusionParameters],
        health: Health,
        fusion: LiveFusion,
        checkpoint: Checkpoint,
        transforms: Transforms,
    ) -> None:
        now = parameters.value
        self._parameters, self._health = parameters, health
        self._fusion, self._checkpoint = fusion, checkpoint
        self._publisher = MapPublisher(node, now.publish_updates, now.whole_map_period_s)
        self._corrected = CorrectedPoses(node, transforms, health)
        self._published_version = self._generation = 0
        # When there was a new ping the last time that it was looked, and whether the map that was
        # published then was that of all pings together.
        self._changed_s, self._is_whole = 0.0, False
        self._is_to_be_published = self._is_to_be_kept = False
        self._asked_s = 0.0
        self._is_unpublished = self._was_reset = False
        self._worker = Worker(node, self._step)

    def close(self) -> None:
        """End the work, keep the map on disk, and take its topics back."""
        self._worker.stop()
        self._keep()
        self._corrected.destroy()
        self._publisher.destroy()

    def publish(self) -> None:
        """Have the map published, if it has changed since the last time."""
        if not self._is_to_be_published:
            self._asked_s = time.monotonic()
        self._is_to_be_published = True
        self._worker.wake()

    def publish_again(self) -> None:
        """Have the map published, whether it has changed or not."""
        self._is_unpublished = True
        self.publish()

    def keep(self) -> None:
        """Have the checkpoint written, if the map has changed since the last time."""
        self._is_to_be_kept = True
        self._worker.wake()

    def _step(self) -> float | None:
        """Publish and keep the map as asked for; runs in a thread of its own."""
        # What is promised of the map on disk does not wait until a large map has been sent.
        if self._is_to_be_kept:
            self._is_to_be_kept = False
            self._keep(in_time=True)
        if not self._is_to_be_published:
            return None
        if self._is_better_later():
            return _LOOK_S
        self._is_to_be_published = False
        self._publish_if_changed()
        return 0.0 if self._is_to_be_published else None

    def _is_better_later(self) -> bool:
        """Whether cones would only wait for longer, and come into a later map, if one was made."""
        put_off_s = _PUT_OFF_PERIODS / self._parameters.value.publish_rate_hz
        return self._fusion.is_behind and time.monotonic() < self._asked_s + put_off_s

    def _publish_if_changed(self) -> None:
        version = self._fusion.version
        is_new = version != self._published_version
        now_s = time.monotonic()
        if is_new:
            self._changed_s = now_s
        # When nothing comes any more, all that came is explained together once.
        is_last = not is_new and now_s - self._changed_s >= _QUIET_S
        has_changed = is_new or self._is_unpublished or (is_last and not self._is_whole)
        if not has_changed and (self._publisher.is_complete or not is_last):
            return
        if self._was_reset or self._fusion.generation != self._generation:
            self._was_reset, self._generation = False, self._fusion.generation
            self._publisher.forget_extent()
        try:
            occupancy = self._fusion.live_map(is_last)
            is_whole = self._fusion.is_whole
            if self._fusion.is_map_behind:
                # What it lacks is in the next one, at once.
                self._is_to_be_published, version = True, self._published_version
            if is_last and not self._is_unpublished and not is_whole:
                # It is being worked out beside, and published when it is there.
                return
            self._is_unpublished, self._is_whole = False, is_whole
            if occupancy.frame_id and has_changed:
                self._publisher.publish(occupancy)
                self._corrected.update(self._fusion.poses.latest)
                self._health.count("published")
            elif occupancy.frame_id:
                self._publisher.complete(occupancy)
        except (MalformedMessageError, MapSizeError) as error:
            self._health.problem("unpublished", f"map: {error}", is_error=True)
        self._published_version = version

    def message(self) -> Any | None:
        """``nav_msgs/OccupancyGrid`` of the map as it is now; None while it has no frame."""
        try:
            occupancy = self._fusion.occupancy_map()
            if not occupancy.frame_id:
                return None
            return self._publisher.message(occupancy)
        except (MalformedMessageError, MapSizeError) as error:
            self._health.problem("unpublished", f"map: {error}", is_error=True)
            return None

    def forget(self) -> None:
        """Begin anew with the extent of the map, which was forgotten."""
        # And once more before the next map: one of before may just be going out.
        self._publisher.forget_extent()
        self._was_reset = self._is_unpublished = True

    def _keep(self, *, in_time: bool = False) -> None:
        try:
            self._checkpoint.keep(self._fusion, in_time=in_time)
        except MapFileError as error:
            self._health.problem("not kept", str(error), is_error=True)
